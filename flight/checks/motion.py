"""What odometry and IMU say of the same intervals of time: mean rates, mean specific forces, mean velocities.

Means over intervals of about `INTERVALS.length` and not derivatives, so that an odometry of 10 Hz can be held against
an IMU of 1 kHz: a displacement over an interval is exactly the mean velocity, a rotation nearly the mean rate.

`best_axes` searches which of 48 ways to name and sign three axes, or which rotation, makes truths t (K, 3) and readings
r (K, 3) of the same vector agree. With A = sum t r^T the rotation that brings the readings closest to the truths is
U V^T of A = U S V^T (Schoenemann 1966; Wahba 1965), and what a signed permutation P achieves is trace(P^T A). Blocks of
time tell how well the rotation is known.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight import row_kernels, so3
from wrenchgap.flight.flight import GRAVITY, Array, Flight, Series
from wrenchgap.flight.mapping_units import axes_word
from wrenchgap.flight.row_kernels import lengths
from wrenchgap.flight.stamps import interpolated


@dataclass(frozen=True)
class IntervalLimits:
    """Over which intervals odometry and IMU are compared."""

    length: float = 0.1
    """Length of an interval [s]: an odometry of 10 Hz can be held against an IMU of 1 kHz."""
    slowest: float = 0.2
    """Period of an odometry [s] beyond which its differences show nothing of the motion in between."""
    fewest: int = 20
    """Intervals below which nothing is said."""
    most: int = 8_000
    """Intervals that are compared of a flight of many; they overlap."""
    half_turn: float = 2.5
    """Angle [rad] turned in an interval beyond which two attitudes do not tell which way round: half a turn is none."""


INTERVALS = IntervalLimits()


@dataclass(frozen=True)
class AxesThresholds:
    """From when on a search for axes has found others than the mapping says."""

    blocks: int = 8
    """Blocks of time, over which the scatter of a rotation is taken."""
    turned_deg: float = 20.0
    """Rotation [deg] below which a sensor has a mounting error, which is an effect and no mistake in a mapping."""
    known_deg: float = 10.0
    """Scatter of the rotation over blocks [deg] up to which it is believed."""
    explains: float = 0.8
    """Cosine between truths and turned readings from which on they are the same vector."""
    better: float = 0.06
    """By how much the cosine must rise for another reading to be taken."""


AXES_SEARCH = AxesThresholds()


@dataclass(frozen=True)
class MotionMeans:
    """Means over K intervals; None where the log has none.

    In B: `rate` (K, 3) of the attitude, `own_rate` (K, 3) of the odometry's twist, `gyro` and `accel` (K, 3) of the
    IMU. In E: `moved` (K, 3), displacement over time, `velocity` (K, 3), the mean of the logged one; accelerations of
    the logged velocity, `acceleration` (K, 3), and of the positions, `curve` (K, 3). `attitude` (K, 4) is at the
    middle, `apart` rows from that at the end of the interval.
    """

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


def motion_means(flight: Flight) -> MotionMeans | None:
    """The intervals of a flight; None where there is no odometry, or one that is too slow or too short."""
    odometry = flight.odometry
    if odometry is None or odometry.period > INTERVALS.slowest:
        return None
    time, quat = odometry.time, so3.continuous(odometry.quat_EB)
    m = max(1, round(INTERVALS.length / odometry.period))
    first = np.arange(0, len(time) - 2 * m)
    thinned = max(1, len(first) // INTERVALS.most)
    first = first[::thinned]
    middle, last = first + m, first + 2 * m
    usable = time[last] - time[first] < 1.8 * 2 * m * odometry.period
    imu = flight.imu
    if imu is not None:
        usable &= (time[first] >= imu.time[0]) & (time[last] <= imu.time[-1])
        for gap in imu.gaps:
            usable &= (time[last] <= gap.start) | (time[first] >= gap.stop)
    first, middle, last = first[usable], middle[usable], last[usable]
    halves = (so3.rotation_between(quat[a], quat[b]) for a, b in ((first, middle), (middle, last)))
    slow = sum(lengths(half) for half in halves) < INTERVALS.half_turn
    first, middle, last = first[slow], middle[slow], last[slow]
    if len(first) < INTERVALS.fewest:
        return None
    span = (time[last] - time[first])[:, None]
    before, after = (time[middle] - time[first])[:, None], (time[last] - time[middle])[:, None]
    p, v = odometry.position_E, odometry.velocity_E
    slopes = (p[middle] - p[first]) / before, (p[last] - p[middle]) / after
    return MotionMeans(
        rate=so3.rotation_between(quat[first], quat[last]) / span,
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


def _mean(series: Series, values: Array, start: Array, stop: Array) -> Array:
    """Means (K, C) of a signal, straight between its samples, over intervals."""
    integral = row_kernels.integral(series.time, values)
    until, since = (interpolated(at, series.time, integral) for at in (stop, start))
    return np.asarray((until - since) / (stop - start)[:, None])


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


PERMUTATIONS: tuple[Array, ...] = tuple(
    np.diag(signs) @ np.eye(3)[list(order)]
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1.0, -1.0), repeat=3)
)
"""All 48; the first is the identity."""

Pair = tuple[Array, Array]


@dataclass(frozen=True)
class Axes:
    """`matrix` (3, 3) with truth = matrix @ reading, the cosine `fits` with it and `as_is`, and its `words`."""

    matrix: Array
    fits: float
    as_is: float
    words: str


def cross(pair: Pair) -> Array:
    """Sum of truth reading^T (3, 3), of signals of length one."""
    truth, reading = pair
    return np.asarray(truth.T @ reading / max(float(np.linalg.norm(truth) * np.linalg.norm(reading)), 1e-30))


def best_axes(pairs: Sequence[Pair]) -> Axes | None:
    """How the readings of all pairs must be turned alike, None where they need not be or nothing can be said.

    The first pair must improve; pairs are weighted alike.
    """
    total = np.sum([cross(pair) for pair in pairs], axis=0)
    leading = cross(pairs[0])
    chosen = max(PERMUTATIONS, key=lambda p: float(np.sum(p * total)))
    turn = best_rotation(total)
    parts = [[np.array_split(signal, AXES_SEARCH.blocks) for signal in pair] for pair in pairs]
    blocks = [np.sum([cross((t[b], r[b])) for t, r in parts], axis=0) for b in range(AXES_SEARCH.blocks)]
    scatter = float(np.median([angle(best_rotation(block) @ turn.T) for block in blocks]))
    better = sum(float(np.sum((chosen - np.eye(3)) * block)) > 0.0 for block in blocks)
    as_is = float(np.trace(leading))
    least = max(AXES_SEARCH.explains, as_is + AXES_SEARCH.better)
    swapped, turned = float(np.sum(chosen * leading)), float(np.sum(turn * leading))
    is_turned = angle(turn) > AXES_SEARCH.turned_deg and scatter < AXES_SEARCH.known_deg
    oblique = angle(turn @ nearest(turn).T) > 0.75 * AXES_SEARCH.turned_deg
    if is_turned and oblique and turned > least and turned > swapped + 0.02:
        return Axes(turn, turned, as_is, rotation_words(turn))
    is_swapped = not np.array_equal(chosen, np.eye(3)) and better >= AXES_SEARCH.blocks - 1  # in nearly every block
    return Axes(chosen, swapped, as_is, axes_word(chosen)) if is_swapped and swapped >= least else None


def nearest(turn: Array) -> Array:
    """The signed permutation that is closest to a matrix."""
    return max(PERMUTATIONS, key=lambda p: float(np.sum(p * turn)))


def angle(turn: Array) -> float:
    """Of a rotation [deg]."""
    return float(np.degrees(np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0))))


def rotation_words(turn: Array) -> str:
    """Roll, pitch and yaw in degrees, those that matter: the words of a mapping, applied in this order.

    Rounded to what somebody would mount: a multiple of 15 deg where one is near, nothing below 6 deg.
    """
    found = {
        "roll": np.arctan2(turn[2, 1], turn[2, 2]),
        "pitch": -np.arcsin(np.clip(turn[2, 0], -1.0, 1.0)),
        "yaw": np.arctan2(turn[1, 0], turn[0, 0]),
    }
    words = []
    for name, angle in found.items():
        degrees = float(np.degrees(angle))
        grid = 15.0 * round(degrees / 15.0)
        rounded = grid if abs(degrees - grid) < 6.0 else float(round(degrees))
        words += [f"{name}={rounded:g}"] if rounded else []
    return ",".join(words)


def best_rotation(matrix: Array) -> Array:
    """The rotation (3, 3) that brings readings closest to truths, of `matrix` = sum t r^T (Wahba 1965)."""
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)
