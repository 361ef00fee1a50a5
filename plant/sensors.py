"""Sensor models: the readings of an IMU and a pose sensor for a known motion.

IMU, at position r from O:     gyro  = omega + bias + noise
                               accel = f_O + omega_dot x r + omega x (omega x r) + bias + noise

White noise of density n [unit/sqrt(Hz), one-sided, as datasheets give it], sampled at f_s over its full bandwidth
f_s / 2, has the standard deviation n sqrt(f_s / 2) per sample. Pose, velocity and rate of the pose sensor carry white
noise of a given standard deviation; the attitude error is a small rotation about random body axes.

Defaults: densities of the ADIS16448 (its datasheet: 0.0135 deg/s/sqrt(Hz), 0.23 mg/sqrt(Hz)) and the noise of a motion
capture system.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.state import Motion, State
from wrenchgap.plant.wrench_model import cross


@dataclass(frozen=True)
class SensorNoise:
    """Sizes of the sensors' errors and their rates.

    gyro_density, accel_density   [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)]
    gyro_bias, accel_bias         (3,) constant [rad/s], [m/s^2]
    position_std, attitude_std    pose sensor [m], [rad] per axis
    velocity_std, rate_std        its velocity [m/s] and body rate [rad/s] per axis
    imu_rate_hz, pose_rate_hz     [Hz]
    """

    gyro_density: float = 2.4e-4
    accel_density: float = 2.3e-3
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accel_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    position_std: float = 2e-4
    attitude_std: float = 3e-4
    velocity_std: float = 5e-3
    rate_std: float = 4e-3
    imu_rate_hz: float = 200.0
    pose_rate_hz: float = 100.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = np.asarray(getattr(self, item.name), dtype=float)
            if not np.all(np.isfinite(value)):
                raise ModelError(f"sensors.{item.name}: got {value.tolist()}, expected finite numbers")
            if item.name.endswith("_bias"):
                if value.shape != (3,):
                    raise ModelError(f"sensors.{item.name}: got {value.tolist()}, expected three numbers")
            elif value.shape != () or value < 0 or (item.name.endswith("_hz") and value == 0):
                raise ModelError(f"sensors.{item.name}: got {value.tolist()}, expected a positive number")

    @property
    def silent(self) -> SensorNoise:
        """Sensors with the same rates and without errors."""
        none = (0.0, 0.0, 0.0)
        return SensorNoise(0.0, 0.0, none, none, 0.0, 0.0, 0.0, 0.0, self.imu_rate_hz, self.pose_rate_hz)


def imu_errors(noise: SensorNoise, count: int, rng: np.random.Generator) -> Array:
    """Bias and white noise of `count` consecutive readings (N, 6): gyroscope, then accelerometer."""
    density = np.repeat([noise.gyro_density, noise.accel_density], 3)
    white = density * np.sqrt(0.5 * noise.imu_rate_hz) * rng.standard_normal((count, 6))
    return np.asarray(white + np.array([*noise.gyro_bias, *noise.accel_bias]))


def read_imu(motion: Motion, position_B: Array, errors: Array) -> tuple[Array, Array]:
    """Gyroscope (N, 3) [rad/s] and accelerometer (N, 3) [m/s^2] at `position_B` (3,) from O, for a motion of O.

    `errors` (N, 6) are those of `imu_errors`.
    """
    omega, omega_dot = motion.omega_B, motion.omega_dot_B
    specific = motion.specific_force_B + cross(omega_dot, position_B) + cross(omega, cross(omega, position_B))
    return omega + errors[:, :3], specific + errors[:, 3:]


def pose_errors(noise: SensorNoise, count: int, rng: np.random.Generator) -> Array:
    """White noise of `count` readings of a pose sensor (N, 12): small rotation in B, position, velocity, rate."""
    stds = np.repeat([noise.attitude_std, noise.position_std, noise.velocity_std, noise.rate_std], 3)
    return np.asarray(stds * rng.standard_normal((count, 12)))


def read_pose(state: State, errors: Array) -> State:
    """The states (N) as a pose sensor with velocity output reports them, with `errors` (N, 12) of `pose_errors`."""
    return State(
        state.time,
        state.position_E + errors[:, 3:6],
        so3.multiply(state.quat_EB, so3.exp(errors[:, :3])),
        state.velocity_E + errors[:, 6:9],
        state.omega_B + errors[:, 9:],
        state.voltage,
    )
