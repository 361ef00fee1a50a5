"""A quadrotor flown by drone-models' equations under an autopilot's loop at 400 Hz, and what its autopilot logs.

Its plant may have other laws than the catalogue of effects (`Laws`): thrust and torque with a part that is linear in
rotor speed, motors that accelerate with the difference of squared speeds, a yaw torque that goes with the heading.

Dynamics are those of the package drone-models (`first_principles.dynamics`, batched over flights), integrated by the
midpoint rule at 800 Hz. The loop is a cascade as autopilots have it: position, velocity, attitude, rate, with a
gyroscope whose vibration goes into the motors. What is logged is a snapshot: of the motors' commands at `motor_hz`, of
an IMU behind a filter of 30 Hz at `imu_hz`, of the estimator at 50 Hz, with stamps of 1 ms. No wrench is logged.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.field.vehicles import GRAVITY, vehicle
from wrenchgap.flight.flight import ActuatorSeries, Array, Flight, ImuSeries, OdometrySeries

RATE = 400.0
"""Hz, of the loop."""
QUAD = vehicle("quad")
RPM = np.pi / 30.0
GYRO_NOISE, ACCELEROMETER_NOISE = 0.015, 0.4
"""Vibration and noise per sample at 400 Hz [rad/s, m/s^2]."""
GYRO_FILTER, IMU_FILTER = 60.0, 30.0
"""Corners [Hz] of what the rate loop sees, and of what is logged."""
MOTOR_LAG = 0.02
"""s, of all motors."""
GUST_SECONDS = 1.5
DRAG, STIR = 0.25, 0.02
"""Of the air [N s/m], and the torque of gusts [Nm s/m]."""


@dataclass(frozen=True)
class Laws:
    """How a plant's laws differ from T = k w^2, Q = k_m w^2 and motors that follow at first order.

    `thrust_linear` and `torque_linear` are the shares of T and Q that are linear in speed at the hover speed, where T
    is as believed; `torque` the factor of all of Q. `squared` (2,) [s] are the lags at the hover speed of motors that
    speed up and slow down with dw/dt = c (cmd^2 - w^2). `heading` [Nm] is the size of a yaw torque that goes with the
    sine of twice the heading. The IMU is stamped `imu_early` [s] before it measured.
    """

    thrust_linear: float = 0.0
    torque_linear: float = 0.0
    torque: float = 1.0
    squared: tuple[float, float] | None = None
    heading: float = 0.0
    imu_early: float = 0.0


@dataclass(frozen=True)
class Case:
    """One flight. `weak` is the share of thrust that each rotor (4,) gives; `com` (3,) [m]; `gusts` [m/s] rms."""

    name: str
    flying: str = "hover"
    motor_hz: float = 10.0
    imu_hz: float = 25.0
    gusts: float = 0.5
    weak: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mass: float = 1.0
    lag: float = MOTOR_LAG
    seconds: float = 60.0
    seed: int = 0
    hidden: tuple[str, ...] = field(default=())
    laws: Laws = Laws()


def curve(at_hover: float, linear: Sequence[float]) -> Array:
    """Coefficients (3, F, 1) of powers of the speed [rpm]: of what is `at_hover` [N or Nm] at the hover speed these
    shares (F,) are linear.
    """  # noqa: D205
    hover = QUAD.hover_speed / RPM
    share = np.array(linear)[:, None]
    return at_hover * np.stack((0.0 * share, share / hover, (1.0 - share) / hover**2))


def motors_follow(case: Case) -> list[float]:
    """drone-models' coefficients (4,) of motors that speed up and of motors that slow down, each of the difference of
    speeds [1/s] and of that of squared speeds [1/(rpm s)].
    """  # noqa: D205
    if case.laws.squared is None:
        return [1.0 / case.lag, 0.0, 1.0 / case.lag, 0.0]
    up, down = (0.5 * RPM / (QUAD.hover_speed * lag) for lag in case.laws.squared)
    return [0.0, up, 0.0, down]


def parameters(cases: list[Case]) -> dict[str, Array | float]:
    """drone-models' arguments for these flights."""
    hover, laws = QUAD.hover_speed**2, [c.laws for c in cases]
    torques = np.array([x.torque for x in laws])[:, None] * curve(QUAD.k_m * hover, [x.torque_linear for x in laws])
    J = np.diag(QUAD.inertia)
    rows = [np.sign(QUAD.places_B[:, 1]), -np.sign(QUAD.places_B[:, 0]), QUAD.directions]
    return {
        "mass": np.array([[QUAD.mass * c.mass] for c in cases]),
        "L": float(abs(QUAD.places_B[0, 0])),
        "prop_inertia": 0.0,
        "gravity_vec": np.array([0.0, 0.0, -GRAVITY]),
        "J": J,
        "J_inv": np.linalg.inv(J),
        "rpm2thrust": curve(QUAD.k_eta * hover, [x.thrust_linear for x in laws]),
        "rpm2torque": torques,
        "mixing_matrix": np.array(rows),
        "drag_matrix": -DRAG * np.eye(3),
        "rotor_dyn_coef": np.array([motors_follow(c) for c in cases]).T[:, :, None],
    }


def references(cases: list[Case], time: Array) -> tuple[Array, Array, Array]:
    """Velocity wanted in E (N, F, 3), heading rate (N, F), torque added (N, F, 3) [Nm]."""
    velocity, heading, added = np.zeros((len(time), len(cases), 3)), np.zeros((len(time), len(cases))), 0.0
    added = np.zeros((len(time), len(cases), 3))
    for f, case in enumerate(cases):
        rng = np.random.default_rng([case.seed, 3])
        if case.flying == "hover":
            continue
        for axis, size in enumerate((2.0, 2.0, 0.7)):
            for hz in rng.uniform(0.03, 0.25, 4):
                velocity[:, f, axis] += size / 2.0 * np.sin(2 * np.pi * (hz * time + rng.random()))
        for hz in rng.uniform(0.03, 0.2, 3):
            heading[:, f] += 0.25 * np.sin(2 * np.pi * (hz * time + rng.random()))
        if case.flying == "excited":
            for axis, size in enumerate((0.12, 0.12, 0.05)):
                for hz in rng.uniform(0.5, 4.0, 6):
                    added[:, f, axis] += size / 2.5 * np.sin(2 * np.pi * (hz * time + rng.random()))
    return velocity, heading, added


def fly(cases: list[Case]) -> list[Flight]:
    """All of these flights, as readers of their logs would return them."""
    from drone_models.first_principles import dynamics  # here: curves are tested without it; programs load it first

    # Long because a tick reads as one paragraph: what is seen, what is asked for, what happens, what is logged.
    F, dt = len(cases), 1.0 / RATE
    time = np.arange(round(max(c.seconds for c in cases) * RATE)) * dt
    rng = [np.random.default_rng([c.seed, 5]) for c in cases]
    noise = np.stack([r.normal(size=(len(time), 6)) for r in rng], axis=1)
    kicks = np.stack([r.normal(size=(len(time), 6)) for r in rng], axis=1)
    gust_size = np.array([[c.gusts] for c in cases])
    params = parameters(cases)
    thrusts, with_heading = params["rpm2thrust"], np.array([c.laws.heading for c in cases])
    com = np.array([c.com for c in cases])
    loss = np.array([c.weak for c in cases]) - 1.0
    wanted, heading, added = references(cases, time)
    unmix = np.linalg.pinv(QUAD.allocation())
    J = np.array(QUAD.inertia)
    pos, vel, omega = np.zeros((F, 3)), np.zeros((F, 3)), np.zeros((F, 3))
    R = Rotation.from_quat(np.tile([0.0, 0.0, 0.0, 1.0], (F, 1)))
    motors = np.full((F, 4), QUAD.hover_speed / RPM)
    wind, stir = np.zeros((F, 3)), np.zeros((F, 3))
    seen_rate, seen_imu = np.zeros((F, 3)), np.zeros((F, 6))
    seen_imu[:, 5] = GRAVITY
    windup, turned, yaw = np.zeros((F, 3)), np.zeros((F, 3)), np.zeros(F)
    keep = np.exp(-dt / GUST_SECONDS)
    a_rate, a_imu = 1.0 - np.exp(-2 * np.pi * GYRO_FILTER * dt), 1.0 - np.exp(-2 * np.pi * IMU_FILTER * dt)
    log = {k: np.empty((len(time), F, n)) for k, n in (("cmd", 4), ("imu", 6), ("pose", 13))}
    before = np.zeros((F, 3))

    def slopes(R: Rotation, vel: Array, omega: Array, motors: Array, cmd: Array) -> tuple[Array, ...]:
        """Of position, velocity, body rate and motors; the package's slope of the quaternion is for w first."""
        thrust = thrusts[0] + thrusts[1] * motors + thrusts[2] * motors**2
        missing = loss * thrust
        total = (thrust + missing).sum(axis=1)
        zero = np.zeros(F)
        x, y, _ = QUAD.places_B.T
        torque = np.stack((missing @ y, -missing @ x, zero), axis=1)
        torque += np.stack((-com[:, 1] * total, com[:, 0] * total, zero), axis=1)  # -c x F
        torque[:, 2] += with_heading * np.sin(2.0 * R.as_euler("ZYX")[:, 0])
        push = DRAG * wind + R.apply(np.stack((zero, zero, missing.sum(axis=1)), axis=1))
        _, _, acc, alpha, spin = dynamics(
            vel, R.as_quat(), vel, omega, cmd, motors, dist_f=push, dist_t=R.apply(torque + STIR * stir), **params
        )
        return vel, acc, alpha, spin

    for k in range(len(time)):
        gyro = omega + GYRO_NOISE * noise[k, :, :3]
        seen_rate = seen_rate + a_rate * (gyro - seen_rate)
        error = np.clip(-0.8 * pos, -2.0, 2.0) * (np.abs(wanted[k]).sum(axis=1, keepdims=True) == 0) + wanted[k] - vel
        windup = np.clip(windup + dt * 0.6 * error, -3.0, 3.0)
        push = 2.2 * error + windup + np.array([0.0, 0.0, GRAVITY])
        yaw = yaw + dt * heading[k]
        z = push / np.linalg.norm(push, axis=1, keepdims=True)
        x = np.stack((np.cos(yaw), np.sin(yaw), np.zeros(F)), axis=1)
        y = np.cross(z, x)
        y /= np.linalg.norm(y, axis=1, keepdims=True)
        desired = Rotation.from_matrix(np.stack((np.cross(y, z), y, z), axis=2))
        tilt = (R.inv() * desired).as_rotvec()
        rate_error = np.array([7.0, 7.0, 3.0]) * tilt - seen_rate
        turned = np.clip(turned + dt * rate_error, -0.5, 0.5)
        slow = (before - seen_rate) / dt
        before = seen_rate
        torque = J * (np.array([22.0, 22.0, 8.0]) * rate_error + 20.0 * turned + 0.15 * np.clip(slow, -200, 200))
        torque += added[k]
        thrust = QUAD.mass * np.einsum("fi,fi->f", push, R.as_matrix()[:, :, 2])
        each = np.clip(np.column_stack((thrust, torque)) @ unmix.T, 0.02, QUAD.k_eta * QUAD.speed_max**2)
        cmd = np.sqrt(each / QUAD.k_eta) / RPM
        wind = keep * wind + gust_size * np.sqrt(1 - keep**2) * kicks[k, :, :3]
        stir = keep * stir + gust_size * np.sqrt(1 - keep**2) * kicks[k, :, 3:]
        first = slopes(R, vel, omega, motors, cmd)
        force = R.apply(first[1] + np.array([0.0, 0.0, GRAVITY]), inverse=True)
        force -= np.cross(first[2], com) + np.cross(omega, np.cross(omega, com))  # felt at O, the centre being at com
        read = np.hstack((gyro, force + ACCELEROMETER_NOISE * noise[k, :, 3:]))
        seen_imu = seen_imu + a_imu * (read - seen_imu)
        log["cmd"][k], log["imu"][k] = cmd * RPM, seen_imu
        log["pose"][k] = np.hstack((pos, R.as_quat()[:, [3, 0, 1, 2]], vel, omega))
        half = [s + 0.5 * dt * d for s, d in zip((vel, omega, motors), first[1:], strict=True)]
        middle = slopes(R * Rotation.from_rotvec(0.5 * dt * omega), *half, cmd)
        R = R * Rotation.from_rotvec(dt * half[1])
        pos, vel, omega, motors = (s + dt * d for s, d in zip((pos, vel, omega, motors), middle, strict=True))
    return [_flight(case, time, {k: v[:, f] for k, v in log.items()}) for f, case in enumerate(cases)]


def _flight(case: Case, time: Array, log: dict[str, Array]) -> Flight:
    """What was logged of one flight, 3 s after its start."""
    end = time < case.seconds

    def snapshots(hz: float) -> Array:
        at = np.round(np.arange(3.0, case.seconds, 1.0 / hz) * RATE).astype(int)
        return at[at < np.count_nonzero(end)]

    sent, read, known = snapshots(case.motor_hz), snapshots(case.imu_hz), snapshots(50.0)
    pose = log["pose"][known]
    turn = Rotation.from_quat(pose[:, [4, 5, 6, 3]])
    digest = hashlib.sha256(repr(case).encode() + np.ascontiguousarray(log["imu"]).tobytes()).hexdigest()
    origin = pose[:, :3] - turn.apply(np.tile(case.com, (len(pose), 1)))
    return Flight(
        name=case.name,
        path=Path(f"{case.name}.mcap"),
        content_hash=digest,
        start_ns=1_700_000_000_000_000_000,
        commanded=None,
        desired=None,
        actuators=ActuatorSeries("/motors", time[sent], tilt=np.empty((len(sent), 0)), rotor_speed=log["cmd"][sent]),
        imu=ImuSeries(
            "/imu",
            time[read] - case.laws.imu_early,
            omega_B=log["imu"][read, :3],
            specific_force_B=log["imu"][read, 3:],
        ),
        odometry=OdometrySeries(
            "/odometry",
            time[known],
            position_E=origin,
            quat_EB=pose[:, 3:7],
            velocity_E=pose[:, 7:10] - turn.apply(np.cross(pose[:, 10:], np.array(case.com))),
            omega_B=pose[:, 10:],
        ),
        reference=None,
        battery=None,
        notes=("drone-models, benchmarks/autopilot_logs",),
    )
