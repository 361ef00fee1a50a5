"""A quadrotor under an autopilot's cascade, whose laws, air and log are arguments: Newton and Euler in numpy.

Nothing here comes from `plant`. All flights of a list are flown together, 250 steps a second by the midpoint rule; the
loop closes at each step. Motors get commands; the laws of `Case` make thrust and drag torque of the speeds that follow.
The gyroscope's noise goes into the loop. What is logged are snapshots, as autopilots take them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchgap.flight.flight import GRAVITY, ActuatorSeries, Flight, ImuSeries, OdometrySeries
from wrenchgap.plant import model_file

RATE = 250.0
MASS, INERTIA, ARM = 1.2, np.array([0.012, 0.013, 0.022]), 0.22
C_F, KAPPA, SPEED_MAX = 1.0e-5, 0.016, 1000.0
AZIMUTH, SPIN = np.radians([45.0, 135.0, 225.0, 315.0]), np.array([1, -1, 1, -1])
PLACES = ARM * np.stack((np.cos(AZIMUTH), np.sin(AZIMUTH), np.zeros(4)), axis=1)
HOVER = np.sqrt(MASS * GRAVITY / 4 / C_F)
"""rad/s."""
UNMIX = np.linalg.inv(np.stack((np.ones(4), PLACES[:, 1], -PLACES[:, 0], -SPIN * KAPPA)))
STIR, GUST_SECONDS = np.array([1.0, 1.0, 0.4]), 1.5
"""What gusts of 1 m/s turn [rad/s^2]; how long they last."""
GYRO_NOISE, ACCELEROMETER_NOISE = 0.01, 0.2
"""Each step, in the loop and in the log [rad/s, m/s^2]."""
ROTORS = "".join(
    f"[[vehicle.arms]]\nazimuth_deg = {np.degrees(a):.6g}\nrotors = [{{ spin = {s} }}]\n"
    for a, s in zip(AZIMUTH, SPIN, strict=True)
)
MODEL = model_file.loads(
    f'schema = 1\n[vehicle]\nname = "quadrotor"\nmass = {MASS}\ninertia = {INERTIA.tolist()}\n[vehicle.arm]\n'
    f"length = {ARM}\ntilts = false\n[vehicle.rotor]\nc_f = {C_F}\nkappa = {KAPPA}\nradius = 0.12\n"
    f"speed_max = {SPEED_MAX}\n{ROTORS}"
)


Law = Callable[..., tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Case:
    """One flight. At the hover speed shares `thrust_linear` and `torque_linear` of thrust and torque go with w, the
    rest with w^2; `torque` is a factor of all torques, `blades` (4,) one of both for each rotor. Motors follow `delay`
    [s] later, with `lag` [s] upwards and downwards at hover, by the difference of speeds or, if `squared`, of squared
    speeds. `com` [m] is from O, `gusts` [m/s] rms push with `drag` [N s/m], `heading` [Nm] times sin(2 heading) turns
    about z. `excited` is a share of +-8 rad/s^2 in all torques, `fast` a factor of the velocities then. `law` adds a
    force and a torque in B (3,), (3,) at a time [s], position and velocity in E, attitude R_EB, body rate and thrusts.
    """

    name: str
    excited: float = 0.0
    seed: int = 0
    seconds: float = 24.0
    motor_hz: float = RATE
    imu_hz: float = RATE
    blades: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    torque: float = 1.0
    thrust_linear: float = 0.0
    torque_linear: float = 0.0
    lag: tuple[float, float] = (0.02, 0.02)
    squared: bool = False
    delay: float = 0.0
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mass: float = 1.0
    gusts: float = 0.0
    heading: float = 0.0
    drag: float = 0.2
    imu_early: float = 0.0
    fast: float = 1.0
    law: Law | None = None


def wanted(case, time):
    """Velocity in E (N, 3), yaw rate (N,) and torque added (N, 3) in rad/s^2; of a hover, zeros."""
    velocity, yaw_rate, turn = np.zeros((len(time), 3)), np.zeros(len(time)), np.zeros((len(time), 3))
    rng = np.random.default_rng([case.seed, 1])

    def tones(low, high, count):
        hz, phase = rng.uniform(low, high, (count, 1)), 2 * np.pi * rng.random((count, 1))
        return np.sin(2 * np.pi * hz * time + phase).sum(axis=0) / np.sqrt(count)

    if case.excited:
        velocity = case.fast * np.stack([size * tones(0.05, 0.3, 4) for size in (1.5, 1.5, 0.6)], axis=1)
        yaw_rate = 1.5 * tones(0.05, 0.3, 3)
        turn = case.excited * np.stack([size * tones(0.4, 4.0, 8) for size in (8.0, 8.0, 2.0)], axis=1)
    return velocity, yaw_rate, turn


def fly(cases):
    """The flights of these cases."""
    dt = 1.0 / RATE
    time = np.arange(round(max(c.seconds for c in cases) * RATE)) * dt
    plans = [np.stack(each, axis=1) for each in zip(*(wanted(c, time) for c in cases), strict=True)]
    plant = Plant(cases)
    loop = Loop(len(cases))
    draws = np.stack([np.random.default_rng([c.seed, 2]).normal(size=(len(time), 12)) for c in cases], axis=1)
    count = len(cases)
    state = [np.zeros((count, 3)), np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))]
    state.append(np.full((count, 4), HOVER))
    log = {key: np.empty((len(time), count, n)) for key, n in (("sent", 4), ("imu", 6), ("pose", 18))}
    wind, stir = np.zeros((2, count, 3))
    keep = np.exp(-dt / GUST_SECONDS)
    sent = np.full((round(0.1 * RATE), count, 4), HOVER)
    """Of the last 0.1 s."""
    late = np.array([round(c.delay * RATE) for c in cases])
    for k in range(len(time)):
        seen = state[3] + GYRO_NOISE * draws[k, :, :3]
        kick = np.sqrt(1 - keep**2) * plant.gusts[:, None]
        wind, stir = keep * wind + kick * draws[k, :, 6:9], keep * stir + STIR * kick * draws[k, :, 9:]
        sent = np.roll(sent, 1, axis=0)
        sent[0] = loop.command(state, seen, *(plan[k] for plan in plans))
        acting = sent[late, np.arange(count)]
        slopes = plant.slopes(state, acting, wind, stir, time[k])
        log["sent"][k], log["imu"][k] = sent[0], plant.felt(state, slopes)
        log["imu"][k, :, :3] = seen
        log["imu"][k, :, 3:] += ACCELEROMETER_NOISE * draws[k, :, 3:6]
        log["pose"][k] = np.concatenate((state[0], state[1], state[2].reshape(count, 9), state[3]), axis=1)
        middle = plant.slopes(advanced(state, slopes, 0.5 * dt), acting, wind, stir, time[k] + 0.5 * dt)
        state = advanced(state, middle, dt)
    return [logged(c, time, {key: values[:, f] for key, values in log.items()}) for f, c in enumerate(cases)]


def advanced(state, slopes, dt):
    """Position, velocity, body rate and motors along their slopes; the attitude by Rodrigues' formula."""
    position, velocity, R, omega, motors = state
    turn = dt * slopes[2]
    angle = np.sqrt((turn**2).sum(axis=1))[:, None, None] + 1e-12
    K = cross_matrix(turn) / angle
    step = np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
    return [
        position + dt * slopes[0],
        velocity + dt * slopes[1],
        R @ step,
        omega + dt * slopes[3],
        motors + dt * slopes[4],
    ]


def cross(a, b):
    """np.cross of (F, 3) and (F, 3), of which most would be spent on its generality."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]


def cross_matrix(v):
    """(F, 3, 3), so that cross_matrix(v) @ u is v x u."""
    x, y, z = v.T
    zero = np.zeros_like(x)
    return np.stack((zero, -z, y, z, zero, -x, -y, x, zero), axis=1).reshape(-1, 3, 3)


class Plant:
    """The laws of some cases, as arrays over them."""

    def __init__(self, cases):
        def over(key):
            return np.array([getattr(c, key) for c in cases])

        self.blades, self.torque = over("blades"), over("torque")[:, None]
        self.linear, self.torque_linear = over("thrust_linear")[:, None], over("torque_linear")[:, None]
        self.lag, self.squared = over("lag"), over("squared")[:, None]
        self.com, self.mass, self.gusts, self.heading = over("com"), MASS * over("mass"), over("gusts"), over("heading")
        self.drag = over("drag")[:, None]
        self.laws = [(f, c.law) for f, c in enumerate(cases) if c.law is not None]

    def slopes(self, state, sent, wind, stir, time):
        """Of position and velocity [E], attitude, body rate, motors."""
        position, velocity, R, omega, w = state
        share = w / HOVER
        thrust = MASS * GRAVITY / 4 * self.blades * (self.linear * share + (1.0 - self.linear) * share**2)
        drag = KAPPA * MASS * GRAVITY / 4 * self.torque * self.blades
        drag = drag * (self.torque_linear * share + (1.0 - self.torque_linear) * share**2)
        total = thrust.sum(axis=1)
        x, y = thrust @ PLACES[:, 1] - self.com[:, 1] * total, -thrust @ PLACES[:, 0] + self.com[:, 0] * total
        yaw = np.arctan2(R[:, 1, 0], R[:, 0, 0])
        torque = np.stack((x, y, -drag @ SPIN + self.heading * np.sin(2.0 * yaw)), axis=1) + INERTIA * stir
        added = np.zeros((2, *torque.shape))
        for f, law in self.laws:
            added[:, f] = law(time, position[f], velocity[f], R[f], omega[f], thrust[f])
        torque = torque + added[1]
        alpha = (torque - cross(omega, INERTIA * omega)) / INERTIA
        force = R[:, :, 2] * total[:, None] + self.drag * (wind - velocity) + np.einsum("fij,fj->fi", R, added[0])
        acceleration = force / self.mass[:, None]
        acceleration[:, 2] -= GRAVITY
        lag = np.where(sent > w, self.lag[:, :1], self.lag[:, 1:])
        spin = np.where(self.squared, (sent**2 - w**2) / (2.0 * HOVER), sent - w) / lag
        return velocity, acceleration, omega, alpha, spin

    def felt(self, state, slopes):
        """Body rate and specific force at O (F, 6)."""
        _, _, R, omega, _ = state
        force = np.einsum("fij,fi->fj", R, slopes[1] + [0.0, 0.0, GRAVITY])
        force -= cross(slopes[3], self.com) + cross(omega, cross(omega, self.com))
        return np.hstack((omega, force))


class Loop:
    """Position, velocity, attitude, rate; it believes the model, and sees what the gyroscope says."""

    def __init__(self, count):
        self.windup, self.turned, self.yaw = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count)

    def command(self, state, seen, velocity_wanted, yaw_rate, added):
        """Rotor speeds (F, 4)."""
        position, velocity, R, _, _ = state
        hover = ~velocity_wanted.any(axis=1, keepdims=True)
        error = velocity_wanted - velocity - hover * np.clip(0.8 * position, -2.0, 2.0)
        self.windup = np.clip(self.windup + 0.6 / RATE * error, -3.0, 3.0)
        push = 2.2 * error + self.windup + [0.0, 0.0, GRAVITY]
        self.yaw = self.yaw + yaw_rate / RATE
        z = push / np.linalg.norm(push, axis=1, keepdims=True)
        y = cross(z, np.stack((np.cos(self.yaw), np.sin(self.yaw), 0.0 * self.yaw), axis=1))
        y /= np.linalg.norm(y, axis=1, keepdims=True)
        off = np.einsum("fji,fjk->fik", R, np.stack((cross(y, z), y, z), axis=2))
        tilt = 0.5 * np.stack(
            (off[:, 2, 1] - off[:, 1, 2], off[:, 0, 2] - off[:, 2, 0], off[:, 1, 0] - off[:, 0, 1]), 1
        )
        rate_error = tilt * [7.0, 7.0, 3.0] - seen
        self.turned = np.clip(self.turned + rate_error / RATE, -0.5, 0.5)
        torque = INERTIA * ([22.0, 22.0, 8.0] * rate_error + 20.0 * self.turned + added)
        thrust = MASS * np.einsum("fi,fi->f", push, R[:, :, 2])
        each = np.clip(np.column_stack((thrust, torque)) @ UNMIX.T, 0.02, C_F * SPEED_MAX**2)
        return np.sqrt(each / C_F)


def logged(case, time, log):
    """Snapshots from 3 s on: motors and IMU at their rates, the estimate of O's motion at 50 Hz."""

    def rows(hz):
        return slice(round(3.0 * RATE), round(case.seconds * RATE), round(RATE / hz))

    sent, read, known = rows(case.motor_hz), rows(case.imu_hz), rows(50.0)
    position, velocity, R, omega = np.split(log["pose"][known], [3, 6, 15], axis=1)
    R = R.reshape(-1, 3, 3)
    return Flight(
        case.name,
        Path(f"{case.name}.mcap"),
        case.name,
        0,
        actuators=ActuatorSeries("/motors", time[sent], np.empty((len(time[sent]), 0)), log["sent"][sent]),
        imu=ImuSeries("/imu", time[read] - case.imu_early, log["imu"][read, :3], log["imu"][read, 3:]),
        odometry=OdometrySeries(
            "/odometry",
            time[known],
            position - R @ case.com,
            Rotation.from_matrix(R).as_quat()[:, [3, 0, 1, 2]],
            velocity - np.einsum("nij,nj->ni", R, np.cross(omega, case.com)),
            omega,
        ),
    )
