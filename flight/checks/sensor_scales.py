"""A sensor of the IMU against the odometry, axis by axis: what its integral should be, and what it is.

Over windows of time the odometry says by how much the integral of a sensor grows, T, and the sensor says R = k T, k its
scale. For the gyroscope T is the angle by which the attitude turns about an axis of the body; for the accelerometer it
is the sum of R_EB^T (dv + g e_z dt), v the odometry's velocity:

    omega_B = log(q_k^-1 q_k+1) / dt,    f_B = R_EB^T (dv/dt + g e_z)       in every axis, at all times.

Both are seen through the same windows, in two bands (`SCALE.windows`), after the delay between them and, in every
block, a bias and its drift. Noise on both is why k is given as two bounds and not as a slope: seen from the odometry,

    sum T R / sum T^2  <=  k  <=  sum R^2 / sum T R,

the first too small by the odometry's noise, the second too large by the sensor's (Frisch 1934; errors in variables).
Noise, lag and delay move the bounds apart and never both past one. A scale is the same in both bands; a filter acts on
the faster one, and an estimator that corrects what it integrates of this very sensor on the slower one: where the
bands differ, there is no such number and nothing is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, Self

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.checks.misread_axes import misread_of
from wrenchgap.flight.checks.motion import INTERVALS
from wrenchgap.flight.checks.scale_bounds import Scale, bounds_of, halves_of, lost_of, parts_of, sizes_of
from wrenchgap.flight.checks.scale_thresholds import SCALE
from wrenchgap.flight.flight import AXES, GRAVITY, Array, Flight, Indices, OdometrySeries, Series
from wrenchgap.flight.row_kernels import integral
from wrenchgap.flight.stamps import interpolated, spread
from wrenchgap.flight.unmeasured import unmeasured_axes

Sensor = Literal["gyroscope", "accelerometer"]
Span = tuple[float, float]
Pair = tuple[Array, Array]


class Windows(NamedTuple):
    """Integrals of odometry and sensor over windows (K, 3), the latter's change with a delay, and their parts (K,)."""

    shown: Array
    read: Array
    change: Array
    part: Indices


def sensor_scales(flight: Flight, sensor: Sensor) -> dict[str, Scale] | None:
    """The scale by measured axis ("x"); None where odometry or IMU are missing, too slow, or too short."""
    blocks = _blocks(flight, sensor)
    shift = _delay(blocks)
    if shift is None:
        return None
    seen = [[block.windows(window, shift) for block in blocks] for window in SCALE.windows]
    when = np.concatenate([block.time[0] + SCALE.part * np.arange(block.parts) for block in blocks])
    axes, found = AXES[3:] if sensor == "gyroscope" else AXES[:3], {}
    for k in [k for k, axis in enumerate(axes) if axis not in unmeasured_axes(flight)]:
        every = [np.stack([_sums(_pairs(band, j, k), band, blocks) for j in range(3)]) for band in seen]
        alone = [_pairs(band, k, k) if sensor == "gyroscope" else _alone(band, k) for band in seen]
        own = [_sums(pairs, band, blocks) for pairs, band in zip(alone, seen, strict=True)]
        halves, lost = halves_of(own), None
        if sensor == "gyroscope":  # a vehicle that bounces is no lost axis, and what pushes it is seldom plain
            halves, lost = halves or parts_of(own), lost_of(own[0], when)
        scale = Scale(tuple(map(bounds_of, own)), halves, lost, misread_of(every, k, when))
        if scale.halves is None:
            turned, known = (np.concatenate([pair[side] for pair in alone[0]]) for side in (0, 1))
            scale = replace(scale, halves=sizes_of(turned, known, scale))
        found["xyz"[k]] = scale
    return found


def sensor_delay(flight: Flight, sensor: Sensor) -> tuple[float, float] | None:
    """By how much the odometry is late behind a sensor [s], and the standard deviation; None as for `sensor_scales`.

    The deviation is that of the delays without one of `SCALE.delays` groups of blocks after the other (jackknife; Tukey
    1958).
    """
    blocks = _blocks(flight, sensor)
    count = min(len(blocks), SCALE.delays)
    if count < SCALE.fewest_parts // 2:
        return None
    delay = _delay(blocks)
    if delay is None:
        return None
    others = [_minimum([b for k, b in enumerate(blocks) if k % count != g], delay) for g in range(count)]
    known = [other for other in others if other is not None]
    return (delay, float(np.sqrt((count - 1) * np.var(known)))) if len(known) == count else None


def delay_step(flight: Flight) -> tuple[float, float] | None:
    """From when on [s], and by how much [s], the odometry is later behind the gyroscope than before; None if it is not.

    Two means of delays by block, by Student's t, which for so few is sqrt(n log(1 + t^2 / n)) standard deviations of a
    Gaussian with n degrees of freedom (Wallace 1959).
    """
    every = [(float(block.time[0]), _delay([block])) for block in _blocks(flight, "gyroscope")]
    known = np.array([(time, delay) for time, delay in every if delay is not None]).reshape(-1, 2)
    most, found, degrees = SCALE.certain, None, len(known) - 2
    for k in range(2, degrees + 1):
        before, after = known[:k, 1], known[k:, 1]
        step = float(np.mean(after) - np.mean(before))
        variance = (np.var(before) * len(before) + np.var(after) * len(after)) / degrees + SCALE.settled**2
        t2 = step**2 / (variance * (1.0 / len(before) + 1.0 / len(after)))
        certain = float(np.sqrt(degrees * np.log1p(t2 / degrees)))
        if abs(step) > SCALE.stepped and certain > most:
            most, found = certain, (float(known[k, 0]), step)
    return found


def _blocks(flight: Flight, sensor: Sensor) -> list[_Block]:
    """Those that can be compared; none where odometry or IMU are missing, too slow, or too short."""
    odometry, imu = flight.odometry, flight.imu
    if odometry is None or imu is None or odometry.period > INTERVALS.slowest or imu.period > SCALE.slowest_imu:
        return []
    found = [b for span in steady_blocks(odometry, imu) if (b := _Block.of(flight, span, sensor)) is not None]
    return found if sum(block.parts for block in found) >= SCALE.fewest_parts else []


def steady_blocks(*series: Series) -> list[Span]:
    """Start and stop [s] of blocks in which all series go on, evenly spread."""
    start, stop = max(s.time[0] for s in series), min(s.time[-1] for s in series)
    gaps = sorted((gap.start, gap.stop) for s in series for gap in s.gaps)
    found, since = [], start
    for until, then in [*gaps, (stop, stop)]:
        length = min(until, stop) - since  # a gap may lie behind the end of another series
        count = max(1, int(np.ceil(length / SCALE.block)))
        size = length / count
        found += [(since + k * size, since + (k + 1) * size) for k in range(count) if size > 2.0 * SCALE.part]
        since = max(since, then)
    return [found[k] for rows in spread(len(found), SCALE.most_blocks, 1) for k in range(rows.start, rows.stop)]


@dataclass(frozen=True)
class _Block:
    """What the odometry says of a sensor's integral until `time` (N,), `shown` (N, 3); its own samples about them."""

    time: Array
    shown: Array
    own_time: Array
    read: Array
    summed: Array

    @classmethod
    def of(cls, flight: Flight, span: Span, sensor: Sensor) -> Self | None:
        odometry, imu = flight.odometry, flight.imu
        assert odometry is not None
        assert imu is not None
        rows = slice(*np.searchsorted(odometry.time, (span[0] + SCALE.margin, span[1] - SCALE.margin)))
        every = max(1, round(SCALE.spacing / odometry.period))
        own = slice(*np.searchsorted(imu.time, span))
        own_time = imu.time[own]
        if len(odometry.time[rows][::every]) < 2 * SCALE.part / max(SCALE.spacing, odometry.period):
            return None
        time, steps = (_turns if sensor == "gyroscope" else _pushes)(odometry, rows, every)
        if len(own_time) < len(time):
            return None
        read = np.ascontiguousarray((imu.omega_B if sensor == "gyroscope" else imu.specific_force_B)[own])
        shown = np.vstack((np.zeros(3), np.cumsum(steps, axis=0)))
        return cls(time, shown, own_time, read, integral(own_time, read))

    @property
    def parts(self) -> int:
        """Whole parts of `SCALE.part`."""
        return max(1, round(float(self.time[-1] - self.time[0]) / SCALE.part))

    def windows(self, window: float, shift: float) -> Windows:
        """Windows of this length [s], the odometry being late by `shift` [s]."""
        period = (self.time[-1] - self.time[0]) / (len(self.time) - 1)
        width = max(1, round(window / period))
        start = np.arange(0, len(self.time) - width, max(1, width // 2))
        ends = np.stack((start, start + width))
        at = self.time[ends] - shift
        read, change = (
            np.diff([interpolated(t, self.own_time, v) for t in at], axis=0)[0] for v in (self.summed, self.read)
        )
        shown = np.diff(self.shown[ends], axis=0)[0]
        when = self.time[start]
        part = np.minimum(((when - when[0]) / SCALE.part).astype(int), self.parts - 1)
        straight = _straightened(when, np.concatenate((shown, read, change), axis=1))
        return Windows(straight[:, :3], straight[:, 3:6], straight[:, 6:], part)


def _turns(odometry: OdometrySeries, rows: slice, every: int) -> tuple[Array, Array]:
    """Times (N,) and the angles (N-1, 3) by which the attitude turns in between, about the axes of B."""
    quat = so3.continuous(odometry.quat_EB[rows][::every])
    return odometry.time[rows][::every], so3.rotation_between(quat[:-1], quat[1:])


def _pushes(odometry: OdometrySeries, rows: slice, every: int) -> tuple[Array, Array]:
    """Times (N,) and R_EB^T (dv + g e_z dt) (N-1, 3) in between, v that of the positions where none is logged."""
    known, velocity = odometry.time[rows][::every], odometry.velocity_E
    if velocity is None:
        place, time = odometry.position_E[rows][::every], 0.5 * (known[1:] + known[:-1])
        speed = np.diff(place, axis=0) / np.diff(known)[:, None]
    else:
        time, speed = known, velocity[rows][::every]
    quat = so3.interpolate(0.5 * (time[1:] + time[:-1]), known, so3.continuous(odometry.quat_EB[rows][::every]))
    pushed = np.diff(speed, axis=0) + np.diff(time)[:, None] * np.array([0.0, 0.0, GRAVITY])
    return time, so3.rotate_inverse(quat, pushed)


def _straightened(time: Array, values: Array) -> Array:
    """Values (K, C) without their mean and slope over time: a bias, and its drift."""
    lever = time - np.mean(time)
    slope = lever @ values / np.maximum(lever @ lever, 1e-30)
    return np.asarray(values - np.mean(values, axis=0) - np.outer(lever, slope))


def _delay(blocks: Sequence[_Block]) -> float | None:
    """By how much the odometry is late behind a sensor [s]; None where they have no motion in common.

    The minimum next to zero, unless clearly less is left in one that a search in steps finds: a motion that swings is
    alike one of its periods later.
    """
    near = _minimum(blocks, 0.0) if blocks else None
    if near is None:
        return None
    steps = np.linspace(-SCALE.longest_delay, SCALE.longest_delay, SCALE.steps)
    far = _minimum(blocks, min(steps, key=lambda shift: _left(blocks, shift)[0]))
    clearly = far is not None and _left(blocks, far)[0] < SCALE.clearly * _left(blocks, near)[0]
    return far if clearly else near


def _minimum(blocks: Sequence[_Block], shift: float) -> float | None:
    """The delay [s] that leaves least, downhill (Gauss-Newton) from `shift`; None where that leads too far."""
    for _ in range(5):
        step = _left(blocks, shift)[1]
        shift += step
        if abs(shift) > SCALE.longest_delay:
            return None
        if abs(step) < SCALE.settled:
            break
    return shift


def _left(blocks: Sequence[_Block], shift: float) -> tuple[float, float]:
    """What a sensor reads (a sum of squares) that the odometry does not show, late by `shift` [s], and a better shift.

    Each axis of each block has a scale of its own: one that reads the opposite does not decide.
    """
    seen = [block.windows(SCALE.windows[0], shift) for block in blocks]
    left = np.concatenate([w.read - w.shown * _ratio(w.shown * w.read, w.shown**2) for w in seen])
    change = np.concatenate([w.change for w in seen])
    return float(np.sum(left**2)), float(_ratio((change * left).ravel(), change.ravel() ** 2))


def _ratio(above: Array, below: Array) -> Array:
    """Of sums over rows."""
    return np.asarray(np.sum(above, axis=0) / np.maximum(np.sum(below, axis=0), 1e-30))


def _pairs(band: Sequence[Windows], shown: int, read: int) -> list[Pair]:
    """T and R by block, of these axes."""
    return [(w.shown[:, shown], w.read[:, read]) for w in band]


def _alone(band: Sequence[Windows], axis: int) -> list[Pair]:
    """T and R of one axis, by block, less what the odometry shows on the others.

    An accelerometer askew reads of those too, and what pushes along z is ten times as large as what pushes along x.
    """
    shown = np.concatenate([w.shown for w in band])
    others = np.delete(shown, axis, axis=1)
    both = np.stack((shown[:, axis], np.concatenate([w.read[:, axis] for w in band])), axis=1)
    left = both - others @ np.linalg.lstsq(others, both, rcond=None)[0]
    return [(v[:, 0], v[:, 1]) for v in np.split(left, np.cumsum([len(w.shown) for w in band])[:-1])]


def _sums(pairs: Sequence[Pair], band: Sequence[Windows], blocks: Sequence[_Block]) -> Array:
    """Sums (3, P) of T^2, T R and R^2 of pairs by part in the order of time; loud parts turned down."""
    parts = [
        [np.bincount(w.part, weights=v, minlength=block.parts) for v in (t * t, t * r, r * r)]
        for (t, r), w, block in zip(pairs, band, blocks, strict=True)
    ]
    sums = np.concatenate(parts, axis=1)
    return np.asarray(sums * np.minimum(1.0, np.percentile(sums[0], SCALE.loudest) / np.maximum(sums[0], 1e-30)))
