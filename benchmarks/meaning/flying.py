"""Vehicles with fixed rotors, flown by MuJoCo: it integrates the hull and reads the sensors; this file steers.

Nothing here comes from `plant`. Thrusts act at sites with `gear`, motors lag, the air drags; accelerometer and
gyroscope are MuJoCo's sensors. The controller is the usual geometric one, a force from the position's error, a torque
from the attitude's (Lee, Leok and McClamroch, CDC 2010), with a multisine on every axis.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from wrenchgap.flight.flight import ActuatorSeries, Array, Flight, ImuSeries, OdometrySeries, WrenchSeries

GRAVITY = 9.80665
RATE, ODOMETRY_EVERY, STEPS = 250.0, 2, 4
START_NS = 1_700_000_000_000_000_000
DRAG = 0.12  # 1/s, per mass


@dataclass(frozen=True)
class Craft:
    """A vehicle: `azimuth` (R,) [rad] and `spin` (R,) of its rotors on arms of `length` [m]; `model` is its file."""

    name: str
    mass: float
    inertia: tuple[float, float, float]
    length: float
    azimuth: Array
    spin: Array
    c_f: float
    kappa: float
    radius: float
    speed_max: float

    @property
    def allocation(self) -> Array:
        """Thrust and torques (4, R) of unit rotor thrusts."""
        x, y = self.length * np.cos(self.azimuth), self.length * np.sin(self.azimuth)
        return np.stack((np.ones_like(x), y, -x, -self.spin * self.kappa))

    def model(self) -> str:
        """The model file."""
        arms = "".join(
            f"[[vehicle.arms]]\nazimuth_deg = {np.degrees(a):.6g}\nrotors = [{{ spin = {int(s)} }}]\n"
            for a, s in zip(self.azimuth, self.spin, strict=True)
        )
        return (
            f'schema = 1\n[vehicle]\nname = "{self.name}"\nmass = {self.mass}\ninertia = {list(self.inertia)}\n'
            f"[vehicle.arm]\nlength = {self.length}\ntilts = false\n[vehicle.rotor]\nc_f = {self.c_f}\n"
            f"kappa = {self.kappa}\nradius = {self.radius}\nspeed_max = {self.speed_max}\n{arms}"
        )


QUARTERS = np.radians([45.0, 315.0, 225.0, 135.0])
QUAD = Craft(
    "quad", 1.5, (0.0165, 0.017, 0.03), 0.225, QUARTERS, np.array([-1, 1, -1, 1]), 1.2e-5, 0.0158, 0.127, 950.0
)
NANO = Craft(
    "nano", 0.032, (1.66e-5, 1.67e-5, 2.93e-5), 0.046, QUARTERS, np.array([1, -1, 1, -1]), 2.3e-8, 0.006, 0.0231, 2900.0
)
SIXTHS = np.radians([0.0, 60.0, 120.0, 180.0, 240.0, 300.0])
HEX = Craft(
    "hex", 3.4, (0.058, 0.061, 0.105), 0.34, SIXTHS, np.array([1, -1, 1, -1, 1, -1]), 1.5e-5, 0.0165, 0.14, 900.0
)


@dataclass(frozen=True)
class Manner:
    """How it is flown: `excitation` 1 is usual, `flips` turns over every 4 s, `noise` multiplies the sensors'."""

    excitation: float = 1.0
    flips: bool = False
    noise: float = 1.0
    reach: float = 1.0


def _multisine(rng: np.random.Generator, low: float, high: float, count: int = 7) -> Callable[[float], float]:
    f, phase = np.geomspace(low, high, count), rng.uniform(0.0, 2.0 * np.pi, count)
    weights = f**-0.5 / np.sqrt(0.5 * np.sum(1.0 / f))
    return lambda t: float(np.sum(weights * np.sin(2.0 * np.pi * f * t + phase)))


def _world(craft: Craft) -> tuple[Any, Any]:
    sites = "".join(
        f'<site name="r{i}" pos="{craft.length * np.cos(a):.9f} {craft.length * np.sin(a):.9f} 0"/>'
        for i, a in enumerate(craft.azimuth)
    )
    motors = "".join(
        f'<general site="r{i}" gear="0 0 1 0 0 {-s * craft.kappa:.9f}"/>' for i, s in enumerate(craft.spin)
    )
    inertia = " ".join(map(str, craft.inertia))
    text = (
        f'<mujoco><option timestep="{1.0 / (RATE * STEPS)}" integrator="RK4" gravity="0 0 {-GRAVITY}"/><worldbody>'
        f'<body pos="0 0 2"><freejoint/><inertial pos="0 0 0" mass="{craft.mass}" diaginertia="{inertia}"/>'
        f'<site name="imu"/>{sites}</body></worldbody><actuator>{motors}</actuator>'
        f'<sensor><accelerometer site="imu"/><gyro site="imu"/></sensor></mujoco>'
    )
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def fly(craft: Craft, seconds: float = 16.0, seed: int = 0, manner: Manner | None = None) -> Flight:
    """One flight, as a reader of its log would return it."""
    manner = manner or Manner()
    rng = np.random.default_rng([seed, 7])
    model, data = _world(craft)
    pilot = _Pilot(craft, rng, manner)
    count = round(seconds * RATE)
    rows: dict[str, list[Array]] = {name: [] for name in ("wrench", "speed", "imu", "pose")}
    thrust = np.full(len(craft.spin), craft.mass * GRAVITY / len(craft.spin))
    for k in range(count):
        t = k / RATE
        pose = np.concatenate((data.qpos, data.qvel))
        wanted, wrench = pilot.step(t, pose)
        speed = np.sqrt(wanted / craft.c_f)
        felt = np.zeros(6)
        for _ in range(STEPS):
            thrust += (wanted - thrust) * (1.0 - np.exp(-1.0 / (RATE * STEPS * 0.03)))
            data.ctrl[:] = thrust
            data.xfrc_applied[1, :3] = -DRAG * craft.mass * data.qvel[:3]
            mujoco.mj_step(model, data)
        felt[:] = data.sensordata
        for name, row in zip(rows, (wrench, speed, np.concatenate((felt[3:], felt[:3])), pose), strict=True):
            rows[name].append(row.copy())
    return _recorded(craft, {name: np.array(r) for name, r in rows.items()}, rng, manner)


class _Pilot:
    """Position, attitude, excitation, flips."""

    def __init__(self, craft: Craft, rng: np.random.Generator, manner: Manner) -> None:
        self.craft, self.manner = craft, manner
        size = manner.reach * (1.0 if craft.mass > 0.5 else 0.5)
        self.path = [_multisine(rng, 0.1, 0.4) for _ in range(3)]
        self.size = size * np.array([0.7, 0.7, 0.4])
        self.yaw = _multisine(rng, 0.1, 0.3)
        self.shake = [_multisine(rng, 0.6, 4.0) for _ in range(4)]
        self.inverse = np.linalg.pinv(craft.allocation)
        arm = craft.mass * GRAVITY * craft.length
        self.share = manner.excitation * np.array(
            [0.05 * craft.mass * GRAVITY, 0.03 * arm, 0.03 * arm, 0.08 * craft.kappa * craft.mass * GRAVITY]
        )

    def step(self, t: float, pose: Array) -> tuple[Array, Array]:
        """Rotor thrusts (R,) and the commanded wrench (6,)."""
        craft, fade = self.craft, min(1.0, t / 2.0)
        turn = Rotation.from_quat(pose[3:7], scalar_first=True)
        goal = fade * self.size * [sine(t) for sine in self.path] + [0.0, 0.0, 2.0]
        force_E = craft.mass * (4.0 * (goal - pose[:3]) - 3.0 * pose[7:10] + [0.0, 0.0, GRAVITY])
        up = force_E / np.linalg.norm(force_E)
        heading = 0.4 * fade * self.yaw(t)
        side = np.cross(up, [np.cos(heading), np.sin(heading), 0.0])
        side /= np.linalg.norm(side)
        wanted = Rotation.from_matrix(np.stack((np.cross(side, up), side, up), axis=1))
        thrust = max(float(force_E @ turn.as_matrix()[:, 2]), 0.2 * craft.mass * GRAVITY)
        phase = (t % 4.0) / 0.9
        if self.manner.flips and t > 3.0 and phase < 1.0:
            angle = 2.0 * np.pi * phase**3 * (10.0 - 15.0 * phase + 6.0 * phase**2)
            wanted, thrust = wanted * Rotation.from_euler("y", angle), 0.7 * craft.mass * GRAVITY
        error = (wanted.inv() * turn).as_rotvec()
        gains = (18.0**2, 1.6 * 18.0) if craft.mass < 0.5 or self.manner.flips else (11.0**2, 1.6 * 11.0)
        torque = np.array(craft.inertia) * (
            -gains[0] * error * [1.0, 1.0, 0.2] - gains[1] * pose[10:] * [1.0, 1.0, 0.5]
        )
        sent = np.array([thrust, *torque]) + fade * self.share * [sine(t) for sine in self.shake]
        thrusts = np.clip(self.inverse @ sent, 0.0, craft.c_f * craft.speed_max**2)
        made = craft.allocation @ thrusts
        return thrusts, np.array([0.0, 0.0, *made])


def _recorded(craft: Craft, rows: dict[str, Array], rng: np.random.Generator, manner: Manner) -> Flight:
    """With the noise of sensors; the IMU is stamped at the end of the interval that it feels."""
    time = np.arange(len(rows["imu"])) / RATE
    gyro, accel = rows["imu"][:, :3], rows["imu"][:, 3:]
    noise = manner.noise * np.array([4e-3, 0.05])
    gyro = gyro + noise[0] * rng.standard_normal(gyro.shape) + 0.003 * rng.standard_normal(3)
    accel = accel + noise[1] * rng.standard_normal(accel.shape) + 0.03 * rng.standard_normal(3)
    pose = rows["pose"][::ODOMETRY_EVERY]
    quat = Rotation.from_quat(pose[:, 3:7], scalar_first=True)
    quat = quat * Rotation.from_rotvec(8e-4 * rng.standard_normal((len(pose), 3)))
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(r).tobytes() for r in rows.values())).hexdigest()
    no_tilt = np.zeros((len(time), 0))
    return Flight(
        name=craft.name,
        path=Path(f"{craft.name}.mcap"),
        content_hash=digest,
        start_ns=START_NS,
        commanded=WrenchSeries("/command/wrench", time, wrench_B=rows["wrench"]),
        actuators=ActuatorSeries("/command/actuators", time, tilt=no_tilt, rotor_speed=rows["speed"]),
        imu=ImuSeries("/imu", time + 1.0 / RATE, omega_B=gyro, specific_force_B=accel),
        odometry=OdometrySeries(
            "/odometry",
            time[::ODOMETRY_EVERY],
            position_E=pose[:, :3] + 3e-4 * rng.standard_normal((len(pose), 3)),
            quat_EB=quat.as_quat(scalar_first=True),
            velocity_E=pose[:, 7:10] + 5e-3 * rng.standard_normal((len(pose), 3)),
            omega_B=pose[:, 10:] + 5e-3 * rng.standard_normal((len(pose), 3)),
        ),
    )
