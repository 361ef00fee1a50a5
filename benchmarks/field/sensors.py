"""What sensors make of a flight: white noise and constant biases of a good and of a cheap IMU, and a motion capture.

| | gyroscope | accelerometer | bias, rms |
|---|---|---|---|
| good | 0.014 deg/s/sqrt(Hz) | 0.175 mg/sqrt(Hz) | 0.02 deg/s, 0.5 mg |
| cheap | 0.011 deg/s/sqrt(Hz), vibration 5 mrad/s | 0.4 mg/sqrt(Hz), vibration 0.1 m/s^2 | 0.3 deg/s, 5 mg |

good: Bosch BMI088 (datasheet BST-BMI088-DS001; between its 160 ug/sqrt(Hz) of x and y and 190 of z), isolated and
calibrated; its biases are our estimate. cheap: InvenSense MPU-6050 (PS-MPU-6000A rev. 3.4, 6.1, 6.2: 400 ug/sqrt(Hz);
0.033 deg/s rms from 1 to 10 Hz; zero-g level +-35 mg over temperature), screwed to the frame: vibration per sample at
200 Hz and what is left of the biases after a calibration are our estimates.

The pose is a motion capture's on both: 0.3 mm, 0.5 mrad, 5 mm/s, 5 mrad/s per sample, as in `hidden_effects`.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.hidden_effects.engine import ATTITUDE_NOISE, POSITION_NOISE, RATE_NOISE, VELOCITY_NOISE
from wrenchgap.flight.flight import Array, Flight

DEGREE, MILLI_G = np.pi / 180.0, 9.80665e-3


@dataclass(frozen=True)
class Imu:
    """One-sided densities [rad/s/sqrt(Hz), m/s^2/sqrt(Hz)]; vibration per sample and rms of biases [rad/s, m/s^2]."""

    gyro_density: float
    accelerometer_density: float
    gyro_vibration: float
    accelerometer_vibration: float
    gyro_bias: float
    accelerometer_bias: float

    def per_sample(self, rate: float) -> tuple[float, float]:
        """Standard deviation of a sample at `rate` [Hz], gyroscope and accelerometer."""
        bandwidth = rate / 2.0
        gyro = np.hypot(self.gyro_density * np.sqrt(bandwidth), self.gyro_vibration)
        return float(gyro), float(
            np.hypot(self.accelerometer_density * np.sqrt(bandwidth), self.accelerometer_vibration)
        )


IMUS = {
    "good": Imu(0.014 * DEGREE, 0.175 * MILLI_G, 0.0, 0.0, 0.02 * DEGREE, 0.5 * MILLI_G),
    "cheap": Imu(0.011 * DEGREE, 0.4 * MILLI_G, 5e-3, 0.1, 0.3 * DEGREE, 5.0 * MILLI_G),
}


def measured(flight: Flight, grade: str, seed: int) -> Flight:
    """The flight (of true readings) as the sensors of `grade` record it; its hash is that of the new numbers."""
    rng = np.random.default_rng([seed, 29])
    imu, odometry, sensor = flight.imu, flight.odometry, IMUS[grade]
    assert imu is not None
    assert odometry is not None
    assert odometry.velocity_E is not None
    assert odometry.omega_B is not None
    gyro, accelerometer = sensor.per_sample(1.0 / float(np.median(np.diff(imu.time))))

    def noisy(values: Array, std: float, bias: float = 0.0) -> Array:
        return np.asarray(values + bias * rng.normal(size=3) + std * rng.normal(size=values.shape))

    shake = Rotation.from_rotvec(ATTITUDE_NOISE * rng.normal(size=(len(odometry.time), 3)))
    turned = Rotation.from_quat(odometry.quat_EB, scalar_first=True) * shake
    out = replace(
        flight,
        imu=replace(
            imu,
            omega_B=noisy(imu.omega_B, gyro, sensor.gyro_bias),
            specific_force_B=noisy(imu.specific_force_B, accelerometer, sensor.accelerometer_bias),
        ),
        odometry=replace(
            odometry,
            position_E=noisy(odometry.position_E, POSITION_NOISE),
            quat_EB=turned.as_quat(scalar_first=True, canonical=True),
            velocity_E=noisy(odometry.velocity_E, VELOCITY_NOISE),
            omega_B=noisy(odometry.omega_B, RATE_NOISE),
        ),
    )
    assert out.imu is not None
    digest = hashlib.sha256(flight.content_hash.encode())
    digest.update(np.ascontiguousarray(np.hstack((out.imu.omega_B, out.imu.specific_force_B))).tobytes())
    return replace(out, content_hash=digest.hexdigest())
