"""What odometry and IMU say of the same intervals of time: mean rates, mean specific forces, mean velocities.

Means over intervals of about `INTERVAL` and not derivatives, so that an odometry of 10 Hz can be held against an IMU of
1 kHz: a displacement over an interval is exactly the mean velocity, a rotation nearly the mean rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight import row_kernels, so3
from wrenchgap.flight.flight import Array, Flight, Series
from wrenchgap.flight.gravity import GRAVITY
from wrenchgap.flight.row_kernels import lengths
from wrenchgap.flight.stamps import interpolated

INTERVAL = 0.1
"""[s]"""
SLOWEST = 0.2
"""Period of an odometry [s] beyond which its differences show nothing of the motion in between."""
FEWEST = 20
"""Intervals below which nothing is said."""
MOST = 8_000
"""Intervals that are compared of a flight of many; they overlap."""
FULL = 2.5
"""Angle [rad] turned in an interval beyond which two attitudes do not tell which way round: half a turn is none."""
BLOCKS = 8


@dataclass(frozen=True)
class Seen:
    """Means over K intervals. `rate` (K, 3) of the attitude in B, `gyro`, `accel` (K, 3) what the IMU reads, `own_rate`
    (K, 3) of the odometry's twist; `attitude` (K, 4) at the middle, `apart` rows from that at the end of the interval.
    `moved` (K, 3) is displacement over time and `velocity` (K, 3) the mean of the logged one, in E; `acceleration`
    (K, 3) of the logged velocity and `curve` (K, 3) of the positions, in E. None: not in the log.
    """  # noqa: D205

    rate: Array
    attitude: Array
    moved: Array
    curve: Array
    velocity: Array | None
    apart: int
    acceleration: Array | None
    own_rate: Array | None
    gyro: Array | None
    accel: Array | None

    @property
    def accelerating(self) -> Array:
        """Acceleration in E (K, 3), from the logged velocity where there is one."""
        return self.curve if self.acceleration is None else self.acceleration

    def force(self, attitude: Array | None = None, gravity: float = GRAVITY) -> Array:
        """R_EB^T (a + g e_z), (K, 3) in B: what an accelerometer should read."""
        quat = self.attitude if attitude is None else attitude
        return np.asarray(so3.rotate_inverse(quat, self.accelerating + np.array([0.0, 0.0, gravity])))


def seen(flight: Flight) -> Seen | None:
    """The intervals of a flight; None where there is no odometry, or one that is too slow or too short."""
    odometry = flight.odometry
    if odometry is None or odometry.period > SLOWEST:
        return None
    time, quat = odometry.time, so3.continuous(odometry.quat_EB)
    m = max(1, round(INTERVAL / odometry.period))
    first = np.arange(0, len(time) - 2 * m)
    thinned = max(1, len(first) // MOST)
    first = first[::thinned]
    middle, last = first + m, first + 2 * m
    usable = time[last] - time[first] < 1.8 * 2 * m * odometry.period
    if flight.imu is not None:
        usable &= _covered(flight.imu, time[first], time[last])
    first, middle, last = first[usable], middle[usable], last[usable]
    slow = _halves(quat, first, middle, last) < FULL
    first, middle, last = first[slow], middle[slow], last[slow]
    if len(first) < FEWEST:
        return None
    span = (time[last] - time[first])[:, None]
    before, after = (time[middle] - time[first])[:, None], (time[last] - time[middle])[:, None]
    p, v = odometry.position_E, odometry.velocity_E
    slopes = (p[middle] - p[first]) / before, (p[last] - p[middle]) / after
    imu = flight.imu
    return Seen(
        rate=so3.turned(quat[first], quat[last]) / span,
        attitude=quat[middle],
        moved=(p[last] - p[first]) / span,
        curve=(slopes[1] - slopes[0]) / (0.5 * span),
        velocity=None if v is None else _mean(odometry, v, time[first], time[last]),
        apart=max(1, round(m / thinned)),
        acceleration=None if v is None else (v[last] - v[first]) / span,
        own_rate=None if odometry.omega_B is None else _mean(odometry, odometry.omega_B, time[first], time[last]),
        gyro=None if imu is None else _mean(imu, imu.omega_B, time[first], time[last]),
        accel=None if imu is None else _mean(imu, imu.specific_force_B, time[first], time[last]),
    )


def _halves(quat: Array, first: NDArray[np.intp], middle: NDArray[np.intp], last: NDArray[np.intp]) -> Array:
    """Angles [rad] turned in both halves of the intervals, added (K,)."""
    halves = so3.turned(quat[first], quat[middle]), so3.turned(quat[middle], quat[last])
    return np.asarray(sum(lengths(half) for half in halves))


def _mean(series: Series, values: Array, start: Array, stop: Array) -> Array:
    """Means (K, C) of a signal, straight between its samples, over intervals."""
    integral = row_kernels.integral(series.time, np.ascontiguousarray(values))
    until, since = (interpolated(at, series.time, integral) for at in (stop, start))
    return np.asarray((until - since) / (stop - start)[:, None])


def _covered(series: Series, start: Array, stop: Array) -> NDArray[np.bool_]:
    """Intervals in which a series has samples."""
    covered: NDArray[np.bool_] = (start >= series.time[0]) & (stop <= series.time[-1])
    for gap in series.gaps:
        covered &= (stop <= gap.start) | (start >= gap.stop)
    return covered


def cosine(truth: Array, reading: Array) -> float:
    """Cosine between two signals (K, C), all columns together."""
    size = float(np.linalg.norm(truth) * np.linalg.norm(reading))
    return float(np.sum(truth * reading)) / size if size > 0.0 else 0.0


def without_mean(values: Array) -> Array:
    """Values (K, C) less their means: without a bias."""
    return np.asarray(values - values.mean(axis=0))


def rms(values: Array) -> float:
    """Root mean square length of vectors (K, C)."""
    return float(np.sqrt(np.mean(np.sum(values**2, axis=1))))
