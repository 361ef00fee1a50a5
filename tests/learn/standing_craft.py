"""A quadrotor on four feet, flown by an integrator of its own: Newton and Euler, rotors with a lag, ground of springs.

Semi-implicit Euler, 500 steps a second; the rotation is a matrix, turned by Rodrigues' formula. Nothing here comes from
`plant`.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchgap.flight.flight import ActuatorSeries, Flight, ImuSeries, OdometrySeries, WrenchSeries

GRAVITY, STEP = 9.80665, 0.002
MASS, INERTIA, ARM = 1.2, np.array([0.012, 0.012, 0.021]), 0.2
C_F, KAPPA, SPEED_MAX, LAG = 1.1e-5, 0.016, 900.0, 0.03
AZIMUTH, SPIN = np.radians([45.0, 135.0, 225.0, 315.0]), np.array([1, -1, 1, -1])
PLACES = ARM * np.stack((np.cos(AZIMUTH), np.sin(AZIMUTH), np.zeros(4)), axis=1)
FEET = 0.8 * PLACES + [0.0, 0.0, -0.1]
STIFF, DAMPED, RUBS = 2500.0, 30.0, 8.0
TAKES = np.stack((np.ones(4), PLACES[:, 1], -PLACES[:, 0], -SPIN * KAPPA))
UNDOES = np.linalg.inv(TAKES)
MODEL = (
    f'schema = 1\n[vehicle]\nname = "standing"\nmass = {MASS}\ninertia = {INERTIA.tolist()}\n'
    f"[vehicle.arm]\nlength = {ARM}\ntilts = false\n[vehicle.rotor]\nc_f = {C_F}\nkappa = {KAPPA}\nradius = 0.1\n"
    f"speed_max = {SPEED_MAX}\n"
) + "".join(
    f"[[vehicle.arms]]\nazimuth_deg = {np.degrees(a):.6g}\nrotors = [{{ spin = {s} }}]\n"
    for a, s in zip(AZIMUTH, SPIN, strict=True)
)


@dataclass(frozen=True)
class Plan:
    """What is flown over `seconds` [s].

    Rotors spin up from `start` over `spool`; then the height follows `height`. `off` is when the descent ends and the
    rotors stop; `dead` when rotor 0 stops for good; `blow` is a push of 12 weights for 8 ms. `cut` are times without
    any thrust, `flip` when it turns over.
    """

    seconds: float = 12.0
    start: float = 1.5
    spool: float = 1.5
    off: float | None = 10.0
    dead: float | None = None
    blow: float | None = None
    cut: tuple[float, float] | None = None
    flip: float | None = None
    on_ground: bool = True
    high: float = 2.0
    shaken: float = 1.0
    noise: tuple[float, float] = (0.004, 0.15)
    seed: int = 0
    path: str = "standing.mcap"


@dataclass(frozen=True)
class Flown:
    """The flight as a reader gives it, and at `time` (N,) [s] whether a foot touched the ground (N,)."""

    flight: Flight
    time: np.ndarray
    touches: np.ndarray

    def first_contact_after(self, start: float) -> float:
        return float(self.time[(self.time > start) & self.touches][0])

    def last_contact_before(self, stop: float) -> float:
        return float(self.time[(self.time < stop) & self.touches][-1])


def fly(plan: Plan) -> Flown:
    rng = np.random.default_rng(plan.seed)
    shake = rng.uniform(0.0, 2.0 * np.pi, (4, 3)), np.array([0.7, 1.6, 3.1])
    state, turn = np.zeros((3, 3)), np.eye(3)
    state[0, 2] = 0.1 - MASS * GRAVITY / (4 * STIFF) if plan.on_ground else plan.high
    thrust = np.zeros(4) if plan.on_ground else np.full(4, MASS * GRAVITY / 4)
    rows, turns, touched, times = [], [], [], np.arange(0.0, plan.seconds, STEP)
    for k, t in enumerate(times):
        if k % 2 == 0:
            sent = _pilot(plan, t, state, turn, shake)
        thrust += (sent - thrust) * (1.0 - np.exp(-STEP / LAG))
        dead = plan.dead is not None and t > plan.dead
        now = np.concatenate((sent, state.ravel()))
        turns.append(turn.copy())
        felt, touch = _step(
            state, turn, thrust * [not dead, 1, 1, 1], plan.blow is not None and 0 <= t - plan.blow < 0.008
        )
        touched.append(touch)
        rows.append(np.concatenate((now, felt)))
    return Flown(_recorded(np.array(rows), np.array(turns), times, rng, plan), times, np.array(touched))


def _pilot(plan, t, state, turn, shake):
    """Thrusts (4,) that a plain controller asks for."""
    lift = np.clip((t - plan.start) / plan.spool, 0.0, 1.0) if plan.on_ground else 1.0
    if lift == 0.0 or (plan.off is not None and t > plan.off):
        return np.zeros(4)
    place, speed, omega = state
    up = plan.start + plan.spool
    goal = np.clip(0.8 * (t - up), 0.0, plan.high) if plan.on_ground else plan.high
    if plan.off is not None and t > plan.off - 4.5:
        goal = min(goal, 0.05 + 0.6 * (plan.off - 1.0 - t))
    phases, f = shake
    waves = plan.shaken * np.clip(place[2] - 0.4, 0.0, 1.0) * np.sin(2.0 * np.pi * f * t + phases).sum(axis=1)
    force = MASS * (np.array([-1.5, -1.5, -6.0]) * (place - [0.0, 0.0, goal]) - np.array([2.0, 2.0, 4.0]) * speed)
    force[2] += MASS * GRAVITY
    if t < up and plan.on_ground:
        force = np.array([0.0, 0.0, MASS * GRAVITY * lift])
    axis = force / np.sqrt(force @ force)
    side = np.cross(axis, [1.0, 0.0, 0.0])
    side /= np.sqrt(side @ side)
    wanted = np.stack((np.cross(side, axis), side, axis), axis=1)
    push = max(float(force @ turn[:, 2]), 0.1 * MASS * GRAVITY) * (1.0 + 0.06 * waves[3])
    phase = -1.0 if plan.flip is None else (t - plan.flip) / 0.8
    if 0.0 < phase < 1.0:
        angle = 2.0 * np.pi * phase**3 * (10.0 - 15.0 * phase + 6.0 * phase**2)
        wanted, push = wanted @ _rodrigues(np.array([0.0, angle, 0.0])), 0.6 * MASS * GRAVITY
    off = wanted.T @ turn
    error = np.array([off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]]) / 2.0
    turned = -180.0 * error * [1, 1, 0.2] - 24.0 * omega * [1, 1, 0.5] + 4.0 * waves[:3] * [1, 1, 0.3]
    if plan.cut is not None and plan.cut[0] < t < plan.cut[1]:
        return np.zeros(4)
    return np.clip(UNDOES @ np.concatenate(([push], INERTIA * turned)), 0.0, C_F * SPEED_MAX**2)


def _step(state, turn, thrust, blown):
    """One step of `state` (place, speed, rate) and `turn` (3, 3); the felt force and rate in B, whether a foot
    touches."""
    place, speed, omega = state[0], state[1], state[2]
    total = TAKES @ thrust
    force, torque = np.array([0.0, 0.0, total[0]]), total[1:]
    touch = False
    if place[2] < 0.3:
        feet = FEET @ turn.T
        speeds = speed + np.cross(turn @ omega, feet)
        press = np.where(place[2] + feet[:, 2] < 0.0, -STIFF * (place[2] + feet[:, 2]) - DAMPED * speeds[:, 2], 0.0)
        push = np.column_stack((-RUBS * speeds[:, :2] * (press > 0.0)[:, None], np.maximum(press, 0.0))) @ turn
        force, torque, touch = (
            force + push.sum(axis=0),
            torque + np.cross(FEET, push).sum(axis=0),
            bool((press > 0).any()),
        )
        hull = place[2] - 0.03 - 0.15 * np.hypot(turn[2, 0], turn[2, 1])
        if hull < 0.0 and turn[2, 2] < 0.7:  # it lies on its side or back
            force = force + turn.T @ np.array([*(-RUBS * speed[:2]), max(-STIFF * hull - 60.0 * speed[2], 0.0)])
            torque, touch = torque - 0.08 * omega, True
    if blown:
        force = force + MASS * GRAVITY * np.array([12.0, 0.0, 0.0])
    felt = np.concatenate((omega, force / MASS))
    state[1] += STEP * (turn @ force / MASS - [0.0, 0.0, GRAVITY] - 0.1 * speed)
    state[2] += STEP * (torque - np.cross(omega, INERTIA * omega)) / INERTIA
    state[0] += STEP * state[1]
    turn[:] = turn @ _rodrigues(STEP * state[2])
    return felt, touch


def _rodrigues(v):
    """The rotation (3, 3) by a vector."""
    angle = np.sqrt(v @ v) + 1e-12
    x, y, z = v / angle
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)


def _recorded(rows, turns, times, rng, plan):
    """At 250 Hz, with noise."""
    some = slice(0, None, 2)
    time, (sent, place, speed, omega, gyro, felt) = times[some], np.split(rows[some], [4, 7, 10, 13, 16], axis=1)
    n = (len(time), 3)

    def noisy(values, size):
        return values + size * rng.standard_normal(n)

    wrench = np.hstack((np.zeros((len(time), 2)), sent @ TAKES.T))
    speeds, none = np.sqrt(sent / C_F), np.zeros((len(time), 0))
    return Flight(
        name=Path(plan.path).stem,
        path=Path(plan.path),
        content_hash=f"{plan}",
        start_ns=0,
        commanded=WrenchSeries("/command/wrench", time, wrench_B=wrench),
        actuators=ActuatorSeries("/command/actuators", time, tilt=none, rotor_speed=speeds),
        imu=ImuSeries("/imu", time, omega_B=noisy(gyro, plan.noise[0]), specific_force_B=noisy(felt, plan.noise[1])),
        odometry=OdometrySeries(
            "/odometry",
            time,
            position_E=noisy(place, 5e-4),
            quat_EB=Rotation.from_matrix(turns[some]).as_quat(scalar_first=True),
            velocity_E=noisy(speed, 5e-3),
            omega_B=noisy(omega, 2e-3),
        ),
    )
