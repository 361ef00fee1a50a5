"""The controller that flew, from the log: whether known gains did, and the gains of the attitude loop.

Known gains, of the controller of a model file or of an autopilot with the parameters of the log, flew it where their
law, on the recorded motion, makes the torques of the log.

Unknown ones follow from what the controller asked for, regressed on what it saw. The law of `plant.controller` is
linear in its gains once the torque of the rigid body is taken off,

    J^-1 (M_des - omega x J omega) = -2 zeta w e_omega - w^2 e_R - w^2 k_i q + a_k R_BD domega_D + b

axis by axis, with e_R and e_omega from the logged attitude and reference, q the integral of e_R, clamped where the
model clamps it, and least squares for the coefficients. The controller computes M_des from measured values, so that
sensor noise is in regressors and result alike and does not bias them; one filter (`learn.data.measurement`) is on
both, since they are not of the same instants to a fraction of a period. What is not of this form leaves a residual.
Gains count where e_R and e_omega explain at least 97 % of the variance that the other regressors leave, on
every axis, and both coefficients are positive: a vehicle that follows without error shows none.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array, Flight, Mask, Samples
from wrenchgap.flight.formats import ardupilot_rate_loop, px4_rate_loop
from wrenchgap.flight.formats.rate_loop import LoggedLoop, RateLoop
from wrenchgap.flight.stamps import interpolated
from wrenchgap.learn.data.measurement import CUTOFF_HZ, commands_of, low_pass
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.plant import controller
from wrenchgap.plant.controller import ControllerGains
from wrenchgap.plant.effectiveness import linear_matrix
from wrenchgap.plant.model import Model
from wrenchgap.plant.state import State
from wrenchgap.plant.targets.quantities import hover_speeds, still_wrench
from wrenchgap.plant.trajectory.shapes import Recorded
from wrenchgap.plant.wrench_model import WrenchModel, about_com, cross


def flown_by_controller(model: Model, flights: Sequence[OpenFlight]) -> bool:
    """Whether the controller of the model file flew these: whether its torques, from the recorded motion and reference,
    go with the desired ones, both about the centre of mass and behind the flights' low-pass, their means aside, with a
    correlation and a slope of 0.9 (`_alike`).
    """  # noqa: D205
    body, along_z = model.vehicle.body, controller.pushes_along_z_only(model.vehicle)
    for flight, s, cutoff_hz in ((f.flight, s, f.records[0].cutoff_hz) for f in flights for s in f.flown):
        if flight.reference is None or s.quat_EB is None or s.position_E is None or s.velocity_E is None:
            return False
        state = State(s.time, s.position_E, s.quat_EB, s.velocity_E, s.omega_B)
        reference = Recorded(flight.reference, 0.0).at(s.time)
        _, error = controller.control_law(model.controller, body, state, reference, np.zeros((len(s), 3)), along_z)
        integral = controller.integral_series(model.controller, error, s.dt)
        law, _ = controller.control_law(model.controller, body, state, reference, integral, along_z)
        desired = commands_of(s, model.vehicle)[0].wrench_B if s.wrench_des_B is None else s.wrench_des_B
        asked, own = (low_pass(np.ascontiguousarray(x[:, 3:]), s.dt, cutoff_hz) for x in (desired, law))
        if not _alike(asked, own).all():
            return False
    return True


def _alike(asked: Array, own: Array, least: float = 0.9) -> Mask:
    """In which columns what was asked for (N, C) goes with a law's own (N, C), their means aside: `least` of the
    correlation, and of the slope to either side; a gain that is off by more than a tenth is another.
    """  # noqa: D205
    asked, own = asked - asked.mean(axis=0), own - own.mean(axis=0)
    both, size = (asked * own).mean(axis=0), np.maximum((own**2).mean(axis=0), 1e-30)
    correlation, slope = both / np.sqrt(size * np.maximum((asked**2).mean(axis=0), 1e-30)), both / size
    return np.asarray((correlation > least) & (slope > least) & (slope < 1.0 / least))


@dataclass(frozen=True)
class Autopilot:
    """An autopilot's controller as it flew: `gains`; about which `axes` (3,) they made rates and torques of the logs;
    the angular `acceleration` (3,) [rad/s^2] that the nominal vehicle makes of a steady unit of torque; and, of the
    same unit, what the speeds of the rotors change by: `reaction` (3,) [rad/s], -sum_r spin_r dOmega_r n_r.
    """  # noqa: D205

    name: str
    gains: RateLoop
    axes: Mask
    acceleration: Array
    reaction: Array

    def lead(self, rotor_inertia: float, inertia: Array) -> Array:
        """Lead (3,) [s] of the torque by which rotors of this inertia turn the body as they speed up, J_r dOmega/dt,
        over the steady torque; `inertia` (3, 3) [kg m^2] is the body's.
        """  # noqa: D205
        return np.asarray(rotor_inertia * self.reaction / (np.diag(inertia) * self.acceleration))


def flown_by_autopilot(
    model: Model, flights: Sequence[OpenFlight], voltage: float | None, small: float = 0.05
) -> Autopilot | None:
    """The controller of an autopilot with the gains of these logs; None where they are no such logs, or not of the same
    gains.

    `voltage` [V] is that of the battery, where the model's thrust depends on it; `small` the share of torque about
    hover over which the thrust curve is taken for a line. The torques are compared at the samples that both are logged
    of; the rates behind the flights' low-pass, since attitudes have other stamps.
    """  # noqa: D205
    kinds = (px4_rate_loop, ardupilot_rate_loop)
    each = [(f.records[0].cutoff_hz, kind.logged_loop(f.flight.path)) for f in flights for kind in kinds]
    loops = [(cutoff_hz, loop) for cutoff_hz, loop in each if loop is not None]
    if not loops or len(loops) < len(flights) or model.command is None:
        return None
    first, axes = loops[0][1], np.ones(3, dtype=bool)
    for cutoff_hz, loop in loops:
        asked, own = (low_pass(x, loop.dt, min(cutoff_hz, 0.2 / loop.dt)) for x in loop.rates)
        axes &= _alike(*loop.torques) & _alike(asked, own)
    same = all(repr(loop.gains) == repr(first.gains) for _, loop in loops)
    speeds = _speeds(first, model, voltage, small)
    if speeds is None or not (same and axes.any()):
        return None
    arms, rotors = model.vehicle.geometry()
    wrench = about_com(model.vehicle.body, still_wrench(WrenchModel(model.vehicle, ()), speeds))
    torque = np.diag(wrench[:3, 3:] - wrench[3:, 3:]) / (2.0 * small)
    turning = -(speeds[:3] - speeds[3:]) / (2.0 * small) @ (rotors.spin[:, None] * arms.normal_B[rotors.arm])
    acceleration = np.asarray(torque / np.diag(model.vehicle.body.inertia))
    return Autopilot(first.autopilot, first.gains, axes, acceleration, np.diag(turning))


def _speeds(loop: LoggedLoop, model: Model, voltage: float | None, small: float) -> Array | None:
    """Rotor speeds (6, R) [rad/s] about hover for `small` torques about x, y and z, and for the opposite ones."""
    assert model.command is not None
    vehicle, hover, motors = model.vehicle, loop.hover, loop.motors
    if hover is not None and motors is not None:
        if model.command.unit != "normalised" or len(hover) != len(hover_speeds(vehicle)):
            return None
        ends = np.concatenate([hover + sign * small * motors.T for sign in (1.0, -1.0)])
        return model.command.speeds(ends, None if voltage is None else np.full(len(ends), voltage), vehicle)
    full, torque = model.command.full_speed(voltage, vehicle), linear_matrix(model, [])[3:]
    mixer = 0.5 * torque / np.abs(torque).max(axis=1, keepdims=True)
    share = (hover_speeds(vehicle) / full) ** 2  # of full thrust, which is linear in what the mixer asks for
    return np.asarray(full * np.sqrt(np.concatenate([share + sign * small * mixer for sign in (1.0, -1.0)])))


@dataclass(frozen=True)
class FoundGains:
    """Attitude gains (3,), natural frequencies in rad/s, and the least share of an axis that they explain."""

    zeta: Array
    omega: Array
    explained: float

    def into(self, gains: ControllerGains) -> ControllerGains:
        """`gains` with these of the attitude."""
        zeta, omega = ((float(v[0]), float(v[1]), float(v[2])) for v in (self.zeta, self.omega))
        return replace(gains, zeta_attitude=zeta, omega_attitude=omega)


def attitude_gains(
    flights: Sequence[OpenFlight], model: Model, enough: float = 0.97, fewest: int = 200
) -> FoundGains | None:
    """The gains that flew; None where the logs lack command or attitude reference, or do not have this form.

    `enough` is the least share that they explain of what feed-forward, integral and constant leave of the commanded
    angular acceleration, from `fewest` samples on. A vehicle that turns in order to move follows no logged attitude,
    and is not asked.
    """
    if controller.pushes_along_z_only(model.vehicle):
        return None
    parts = [_regression(s, f.flight, model) for f in flights for s in f.flown]
    known = [p for p in parts if p is not None]
    if len(known) < len(parts) or sum(len(y) for _, y in known) < fewest:
        return None
    X, y = np.concatenate([x for x, _ in known]), np.concatenate([v for _, v in known])
    slope, explained = np.empty((3, 2)), np.empty(3)
    for k in range(3):
        slope[k], left = _fitted(X[:, k], y[:, k])
        _, without = _fitted(X[:, k, 2:], y[:, k])
        explained[k] = 1.0 - left / max(without, 1e-300)
    if explained.min() < enough or slope.min() <= 0.0:
        return None
    omega = np.sqrt(slope[:, 1])
    return FoundGains(slope[:, 0] / (2.0 * omega), omega, float(explained.min()))


def _fitted(X: Array, y: Array) -> tuple[Array, float]:
    """The first two coefficients of least squares, and the variance of what is left."""
    found, *_ = np.linalg.lstsq(X, y, rcond=None)
    return np.asarray(found[:2]), float(np.var(y - X @ found))


def gains_source(model: Model) -> str:
    """Where the gains of a model come from: "model", or "typical" where they are those of any vehicle of its size."""
    found, usual = model.controller, controller.default_gains(model.vehicle, {"rate_hz": model.controller.rate_hz})
    same = (found.omega_attitude, found.zeta_attitude) == (usual.omega_attitude, usual.zeta_attitude)
    return "typical" if same else "model"


def _regression(samples: Samples, flight: Flight, model: Model) -> tuple[Array, Array] | None:
    """Regressors (N, 3, 5) and angular accelerations (N, 3) that were asked for."""
    asked = samples.wrench_cmd_B if samples.wrench_des_B is None else samples.wrench_des_B
    reference = flight.reference
    if asked is None or reference is None or samples.quat_EB is None or reference.omega_D is None:
        return None
    inside = (samples.time >= reference.time[0]) & (samples.time <= reference.time[-1])
    time, omega = samples.time[inside], samples.omega_B[inside]
    J = model.vehicle.body.inertia
    y = np.asarray(np.linalg.solve(J, (asked[inside, 3:] - cross(omega, omega @ J)).T).T)
    quat_EB, quat_ED = samples.quat_EB[inside], so3.interpolate(time, reference.time, reference.quat_ED)
    quat_BD = so3.multiply(so3.conjugate(quat_EB), quat_ED)
    e = controller.attitude_error(quat_EB, quat_ED)
    turning, growing = interpolated(time, reference.time, reference.omega_D), np.zeros_like(omega)
    if reference.omega_dot_D is not None:
        growing = interpolated(time, reference.time, reference.omega_dot_D)
    e_omega = omega - so3.rotate(quat_BD, turning)
    ahead = so3.rotate(quat_BD, growing)
    integral = controller.integral_series(model.controller, e, samples.dt)
    X = np.stack((-e_omega, -e, -integral, ahead, np.ones_like(e)), axis=2)
    return low_pass(X, samples.dt, CUTOFF_HZ), low_pass(y, samples.dt, CUTOFF_HZ)
