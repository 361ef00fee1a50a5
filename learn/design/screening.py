"""Separability of many flights at little cost: effects linearised once for each piece of flight.

For a piece of flight and every effect B of a group, at its own size theta_B, what it adds to the measured wrench and
how that changes with its parameters:

    p_B = W(model + B(theta_B)) - W(model),    J_B = dW(model + B(theta)) / dtheta at theta_B

The imitation of A by B on any sequence of pieces is then the bounded linear least-squares problem p_A ~ J_B x with the
same terms as in `learn.identify.fit`: the plausible range of B, an accelerometer's bias, nuisance (at zero), axes
weighted by what is left on them. Exact for effects that are linear in their parameters; for the others (a lag, a force
times its lever, a width) it says what B can do in the neighbourhood of its own size, which is good enough to choose
by. `learn.design.separability` then says what the choice is worth.

A reference is tried before it is flown (`rehearse`): open loop, by a vehicle that tracks perfectly, and on the plant.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array, Flight, Samples
from wrenchgap.learn.data.candidates import unexcited
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.data.measurement import Record, prepare
from wrenchgap.learn.data.prediction import predict
from wrenchgap.learn.design.manoeuvres import MANOEUVRES, Limits, violations
from wrenchgap.learn.design.separability import Separability, absent, in_pairs, visibility
from wrenchgap.learn.identify.bias_and_trim import ACCELEROMETER_BIAS
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.controller import control_law, pushes_along_z_only
from wrenchgap.plant.model import Model
from wrenchgap.plant.sensors import imu_errors
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.trajectory import Trajectory
from wrenchgap.plant.wrench_model import ModelEffect, about_origin


@dataclass(frozen=True)
class ScreenSettings:
    """How many flights are judged at little cost."""

    dull: float = 0.1
    """Factor on the merit of a flight that leaves an effect of the group unexcited."""
    passes: int = 3
    """How often the axes' weights follow from what is left."""
    rate: float = 100.0
    """Rate of the open-loop flights [Hz]."""
    use: float = 0.95
    """Share of the actuators' limits that an open-loop flight may use: the closed loop needs the rest."""


SCREEN = ScreenSettings()


@dataclass(frozen=True)
class Piece:
    """One piece of flight: `added` (K, 6) of each effect at its own size, `jacobian` (K, 6, P) at that size.

    `excited` are the effects that such a flight can show at all (`Effect.unexcited`).
    """

    record: Record
    added: dict[str, Array]
    jacobian: dict[str, Array]
    excited: frozenset[str]


class Screen:
    """Judges sequences of pieces for one group of effects with values, on top of `base`."""

    def __init__(self, base: Model, effects: Sequence[ModelEffect], along: Sequence[str], floor: Array | None) -> None:
        self.base = base
        self.effects = tuple(effects)
        self.floor = floor
        self.nuisance = (*base.effects, *(absent(n, base) for n in along))

    def piece(self, record: Record) -> Piece:
        """Predictions of all effects and their derivatives, by forward differences of 2 % of the typical size."""
        plain = predict(record, self.base.wrench_model)
        added, jacobian = {}, {}
        for effect in (*self.effects, *self.nuisance):
            own = effect in self.base.effects
            at = plain if own else self._with(record, effect)
            added[effect.name] = at - plain
            columns = []
            for k, p in enumerate(effect.effect.parameters(self.base.vehicle)):
                step = 0.02 * p.scale * (1.0 if effect.theta[k] + 0.02 * p.scale <= p.high else -1.0)
                theta = effect.theta.copy()
                theta[k] += step
                columns.append((self._with(record, replace(effect, theta=theta)) - at) / step)
            jacobian[effect.name] = np.stack(columns, axis=-1)
        excited = (e.name for e in self.effects if unexcited(e.name, self.base, [record]) is None)
        return Piece(record, added, jacobian, frozenset(excited))

    def _with(self, record: Record, effect: ModelEffect) -> Array:
        return predict(record, self.base.with_replaced([effect]).wrench_model)

    def merit(self, pieces: Sequence[Piece]) -> float:
        """`Separability.merit`, much less where an effect is not excited: `explain` would not even try it."""
        every = all(any(e.name in p.excited for p in pieces) for e in self.effects)
        return self.judge(pieces).merit * (1.0 if every else SCREEN.dull)

    def judge(self, pieces: Sequence[Piece]) -> Separability:
        """All ordered pairs on these pieces, one after the other."""
        data = dataset([p.record for p in pieces], self.base)
        sensor = data.noise
        if self.floor is not None:
            data = dataset([replace(p.record, noise=self.floor) for p in pieces], self.base)
        added = {e.name: np.concatenate([p.added[e.name] for p in pieces]) for e in self.effects}

        def left(truth: str, other: ModelEffect) -> Array:
            return self._left(data, pieces, added[truth], other)

        return in_pairs(data, self.base, self.effects, sensor, added, left)

    def _left(self, data: Dataset, pieces: Sequence[Piece], added: Array, imitator: ModelEffect) -> Array:
        """What the imitator leaves of `added` (K, 6), alone or with the nuisance: whichever leaves less to see."""
        sets = [(imitator, *self.base.effects), (imitator, *self.nuisance)]
        found = [self._solved(data, pieces, added, effects) for effects in (sets if sets[0] != sets[1] else sets[:1])]
        return min(found, key=lambda left: visibility(left, data.noise))

    def _solved(self, data: Dataset, pieces: Sequence[Piece], added: Array, effects: Sequence[ModelEffect]) -> Array:
        """What these effects and a bias leave of `added` (K, 6)."""
        from scipy.optimize import lsq_linear  # here: others need not wait for it

        bias = np.zeros((len(added), 6, 3))
        bias[:, range(3), range(3)] = self.base.vehicle.body.mass
        J = np.concatenate([*(np.concatenate([p.jacobian[e.name] for p in pieces]) for e in effects), bias], axis=-1)
        known = [p for e in effects for p in e.effect.parameters(self.base.vehicle)]
        middle = np.array([v if e in self.base.effects else 0.0 for e in effects for v in e.theta] + [0.0] * 3)
        low = np.array([p.low for p in known] + [-ACCELEROMETER_BIAS] * 3) - middle
        high = np.array([p.high for p in known] + [ACCELEROMETER_BIAS] * 3) - middle
        sizes = np.array([p.scale for p in known] + [0.5 * ACCELEROMETER_BIAS] * 3)
        seen = data.measured_axes
        if not seen.all():
            added, J = np.where(seen, added, 0.0), np.where(seen[:, None], J, 0.0)
        weights = data.weights / np.sqrt(np.mean((added * data.weights) ** 2))
        left = added
        for _ in range(SCREEN.passes):  # argmin |(added - J x) weights|^2 + |x / sizes|^2 within bounds
            A = (J * weights[:, None]).reshape(-1, len(sizes)) * sizes
            L = np.linalg.cholesky(A.T @ A + np.eye(len(sizes)))
            aim = np.linalg.solve(L, A.T @ (added * weights).reshape(-1))
            bounds = (low / sizes - 1e-9, high / sizes + 1e-9)
            left = added - J @ (lsq_linear(L.T, aim, bounds=bounds, method="bvls").x * sizes)
            size = np.sqrt(np.mean(left**2, axis=0))
            weights = np.where(seen, 1.0 / np.where(seen, np.maximum(size, data.noise), 1.0), 0.0)
        return left


def rehearse(trajectory: Trajectory, model: Model, limits: Limits, *, seed: int = 0) -> tuple[Record, list[str]]:
    """What a vehicle that tracks perfectly commands and measures, with the model's sensor noise; what breaks limits.

    Actuators may go to the share `SCREEN.use` of their limits.
    """
    time = np.arange(round(trajectory.duration * SCREEN.rate)) / SCREEN.rate
    r = trajectory.at(time)
    state = State(time, r.position_E, r.quat_ED, r.velocity_E, r.omega_D)
    vehicle, dt = model.vehicle, 1.0 / SCREEN.rate
    along_z, rest = pushes_along_z_only(vehicle), np.zeros_like(r.omega_D)
    wrench, _ = control_law(model.controller, vehicle.body, state, r, rest, along_z=along_z)
    commands, beyond = Commands(wrench), []
    if vehicle.has_rotors:
        allocation = Allocation(vehicle)
        about_O = about_origin(vehicle.body, wrench)
        commands = replace(allocation.allocate(about_O, dt=dt)[0], wrench_B=wrench)
        missing = np.linalg.norm((about_O - allocation.achievable(about_O))[:, :3], axis=1).max()
        if missing > 0.02 * np.linalg.norm(about_O[:, :3], axis=1).max():
            beyond.append("asks for a force that the rotors cannot make")
    beyond += violations(vehicle, limits, r.position_E, r.quat_ED, r.velocity_E, commands, dt, SCREEN.use)
    noise = imu_errors(replace(model.sensors, imu_rate_hz=SCREEN.rate), len(time), np.random.default_rng(seed))
    motion = model.wrench_model.motion(model.wrench_model.actuate(commands, state, dt)[0], state.omega_B)
    samples = Samples(
        "rehearsal",
        time,
        dt,
        r.omega_D + noise[:, :3],
        motion.specific_force_B + noise[:, 3:],
        wrench_cmd_B=wrench,
        tilt_cmd=commands.tilt,
        rotor_speed_cmd=commands.rotor_speed,
        position_E=r.position_E,
        velocity_E=r.velocity_E,
        quat_EB=r.quat_ED,
        unmeasured=model.unmeasured,
    )
    return prepare(samples, vehicle), beyond


def tracking(flight: Flight, trajectory: Trajectory) -> tuple[float, float]:
    """Largest position error [m] and attitude error [rad] of a flight along a trajectory."""
    assert flight.odometry is not None
    want = trajectory.at(flight.odometry.time)
    off = so3.log(so3.multiply(so3.conjugate(want.quat_ED), flight.odometry.quat_EB))
    position = np.linalg.norm(flight.odometry.position_E - want.position_E, axis=1)
    return float(position.max()), float(np.linalg.norm(off, axis=1).max())


def lost_after(flight: Flight, trajectory: Trajectory) -> float | None:
    """Time [s] at which control was lost: the plant ends a flight there, before its trajectory ends."""
    assert flight.odometry is not None
    last, gap = float(flight.odometry.time[-1]), 2.0 * flight.odometry.period
    return last if last + gap < trajectory.duration else None


def broken(flight: Flight, trajectory: Trajectory, model: Model, limits: Limits, *, believed: bool) -> list[str]:
    """What a flight on the plant did beyond the limits, in words.

    Where the model is `believed` to be the vehicle, also where it was far from the trajectory, and where the actuators
    were at their limits.
    """
    odometry, actuators = flight.odometry, flight.actuators
    assert odometry is not None
    assert odometry.velocity_E is not None
    commands, dt = Commands(np.zeros((0, 6))), 1.0
    if actuators is not None and believed:
        commands, dt = replace(commands, tilt=actuators.tilt, rotor_speed=actuators.rotor_speed), actuators.period
    motion = (odometry.position_E, odometry.quat_EB, odometry.velocity_E)
    found = violations(model.vehicle, limits, *motion, commands, dt)
    position, attitude = tracking(flight, trajectory) if believed else (0.0, 0.0)
    if position > MANOEUVRES.largest_error[0]:
        found.append(f"is {position:.2f} m from the reference, allowed are {MANOEUVRES.largest_error[0]:g} m")
    if attitude > MANOEUVRES.largest_error[1]:
        allowed = np.degrees(MANOEUVRES.largest_error[1])
        found.append(f"is {np.degrees(attitude):.0f} deg from the reference, allowed are {allowed:.0f} deg")
    lost = lost_after(flight, trajectory)
    return found if lost is None else [*found, f"loses control after {lost:.1f} s"]


def rotor_use(flight: Flight, model: Model) -> float:
    """Largest share of a rotor's largest speed."""
    if flight.actuators is None or not model.vehicle.has_rotors:
        return 0.0
    _, rotors = model.vehicle.geometry()
    return float((flight.actuators.rotor_speed / rotors.speed_max).max())
