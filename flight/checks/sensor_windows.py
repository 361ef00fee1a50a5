"""A sensor of the IMU and the odometry through the same windows of time: what its integral should be, and what it is.

Over windows of time the odometry says by how much the integral of a sensor grows, the reference T, and the sensor
measures R = k T, k its scale. For the gyroscope T is the angle by which the attitude turns about an axis of the body;
for the accelerometer it is the sum of R_EB^T (dv + g e_z dt), v the odometry's velocity:

    omega_B = log(q_k^-1 q_k+1) / dt,    f_B = R_EB^T (dv/dt + g e_z)       in every axis, at all times.

Windows lie in blocks, in each of which a bias and its drift are removed, behind the delay between the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Self

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.checks.motion import INTERVALS
from wrenchgap.flight.checks.scale_thresholds import SCALE
from wrenchgap.flight.flight import GRAVITY, Array, Flight, ImuSeries, Indices, OdometrySeries, Series
from wrenchgap.flight.row_kernels import integral
from wrenchgap.flight.stamps import interpolated, spread

Sensor = Literal["gyroscope", "accelerometer"]
Span = tuple[float, float]


class Windows(NamedTuple):
    """Integrals over windows (K, 3): the `reference` T, the `measured` R, and the derivative of R by a delay.

    `segment` (K,) is the number of the segment of time that a window is in; segments begin at `starts` (P,) [s].
    """

    reference: Array
    measured: Array
    by_delay: Array
    segment: Indices
    starts: Array


def windows_of(blocks: Sequence[Block], window: float, shift: float) -> Windows:
    """Windows of this length [s] in all blocks, the odometry being late by `shift` [s]."""
    seen = [block.windows(window, shift) for block in blocks]
    first = np.cumsum([0, *(len(one.starts) for one in seen)])
    numbered = [one._replace(segment=one.segment + at) for one, at in zip(seen, first[:-1], strict=True)]
    return Windows(*(np.concatenate(rows) for rows in zip(*numbered, strict=True)))


def comparable_blocks(flight: Flight, sensor: Sensor) -> list[Block]:
    """Blocks that can be compared; none where odometry or IMU are missing, too slow, or too short."""
    odometry, imu = flight.odometry, flight.imu
    if odometry is None or imu is None or odometry.period > INTERVALS.slowest or imu.period > SCALE.slowest_imu:
        return []
    every = (Block.of(odometry, imu, span, sensor) for span in steady_blocks(odometry, imu))
    found = [block for block in every if block is not None]
    return found if sum(block.segments for block in found) >= SCALE.fewest_segments else []


def steady_blocks(*series: Series) -> list[Span]:
    """Start and stop [s] of blocks in which all series go on, evenly spread."""
    start, stop = max(s.time[0] for s in series), min(s.time[-1] for s in series)
    gaps = sorted((gap.start, gap.stop) for s in series for gap in s.gaps)
    found, since = [], start
    for until, then in [*gaps, (stop, stop)]:
        length = min(until, stop) - since  # a gap may lie behind the end of another series
        count = max(1, int(np.ceil(length / SCALE.block)))
        size = length / count
        found += [(since + k * size, since + (k + 1) * size) for k in range(count) if size > 2.0 * SCALE.segment]
        since = max(since, then)
    return [found[k] for rows in spread(len(found), SCALE.most_blocks, 1) for k in range(rows.start, rows.stop)]


@dataclass(frozen=True)
class Block:
    """The reference (N, 3), a sensor's integral until `time` (N,) by the odometry; the sensor's own samples (M, 3)."""

    time: Array
    reference: Array
    sensor_time: Array
    samples: Array
    integrals: Array

    @classmethod
    def of(cls, odometry: OdometrySeries, imu: ImuSeries, span: Span, sensor: Sensor) -> Self | None:
        """From start to stop [s]; None where that has too few samples."""
        rows = slice(*np.searchsorted(odometry.time, (span[0] + SCALE.margin, span[1] - SCALE.margin)))
        every = max(1, round(SCALE.spacing / odometry.period))
        own = slice(*np.searchsorted(imu.time, span))
        sensor_time = imu.time[own]
        if len(odometry.time[rows][::every]) < 2 * SCALE.segment / max(SCALE.spacing, odometry.period):
            return None
        time, steps = (_rotations if sensor == "gyroscope" else _specific_impulses)(odometry, rows, every)
        if len(sensor_time) < len(time):
            return None
        samples = np.ascontiguousarray((imu.omega_B if sensor == "gyroscope" else imu.specific_force_B)[own])
        reference = np.vstack((np.zeros(3), np.cumsum(steps, axis=0)))
        return cls(time, reference, sensor_time, samples, integral(sensor_time, samples))

    @property
    def segments(self) -> int:
        """How many segments of about `SCALE.segment` it has."""
        return max(1, round(float(self.time[-1] - self.time[0]) / SCALE.segment))

    def windows(self, window: float, shift: float) -> Windows:
        """Windows of this length [s], the odometry being late by `shift` [s]."""
        period = (self.time[-1] - self.time[0]) / (len(self.time) - 1)
        width = max(1, round(window / period))
        start = np.arange(0, len(self.time) - width, max(1, width // 2))
        ends = np.stack((start, start + width))
        at = self.time[ends] - shift
        reference = np.diff(self.reference[ends], axis=0)[0]
        measured, by_delay = (
            np.diff([interpolated(t, self.sensor_time, v) for t in at], axis=0)[0]
            for v in (self.integrals, self.samples)
        )
        when = self.time[start]
        segment = np.minimum(((when - when[0]) / SCALE.segment).astype(int), self.segments - 1)
        columns = detrended(when, np.concatenate((reference, measured, by_delay), axis=1))
        starts = self.time[0] + SCALE.segment * np.arange(self.segments)
        return Windows(columns[:, :3], columns[:, 3:6], columns[:, 6:], segment, starts)


def _rotations(odometry: OdometrySeries, rows: slice, every: int) -> tuple[Array, Array]:
    """Times (N,) and the angles (N-1, 3) by which the attitude turns in between, about the axes of B."""
    quat = so3.continuous(odometry.quat_EB[rows][::every])
    return odometry.time[rows][::every], so3.rotation_between(quat[:-1], quat[1:])


def _specific_impulses(odometry: OdometrySeries, rows: slice, every: int) -> tuple[Array, Array]:
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


def detrended(time: Array, values: Array) -> Array:
    """Values (K, C) without their mean and slope over time: a bias, and its drift."""
    lever = time - np.mean(time)
    slope = lever @ values / np.maximum(lever @ lever, 1e-30)
    return np.asarray(values - np.mean(values, axis=0) - np.outer(lever, slope))


def odometry_delay(blocks: Sequence[Block]) -> float | None:
    """By how much the odometry is late behind a sensor [s]; None where they have no motion in common.

    The minimum next to zero, unless a search in steps finds one whose misfit is clearly smaller: a motion that swings
    is alike one of its periods later.
    """
    near = nearest_delay(blocks, 0.0) if blocks else None
    if near is None:
        return None
    steps = np.linspace(-SCALE.longest_delay, SCALE.longest_delay, SCALE.delay_starts)
    far = nearest_delay(blocks, min(steps, key=lambda shift: _misfit(blocks, shift)[0]))
    clearly = far is not None and _misfit(blocks, far)[0] < SCALE.far_misfit * _misfit(blocks, near)[0]
    return far if clearly else near


def nearest_delay(blocks: Sequence[Block], shift: float) -> float | None:
    """The delay [s] of least misfit, by Gauss-Newton steps from `shift`; None where these lead too far."""
    for _ in range(5):
        step = _misfit(blocks, shift)[1]
        shift += step
        if abs(shift) > SCALE.longest_delay:
            return None
        if abs(step) < SCALE.delay_tolerance:
            break
    return shift


def _misfit(blocks: Sequence[Block], shift: float) -> tuple[float, float]:
    """Sum of squares of R - k T, the odometry being late by `shift` [s], and the Gauss-Newton step of the shift [s].

    Each axis of each block has a scale k of its own: one that reads the opposite does not decide.
    """
    seen = [block.windows(SCALE.windows[0], shift) for block in blocks]
    residual = np.concatenate([w.measured - w.reference * _slope(w.reference, w.measured) for w in seen])
    by_delay = np.concatenate([w.by_delay for w in seen])
    return float(np.sum(residual**2)), float(_slope(by_delay.ravel(), residual.ravel()))


def _slope(x: Array, y: Array) -> Array:
    """Slope of the least-squares line through the origin, of each column."""
    return np.asarray(np.sum(x * y, axis=0) / np.maximum(np.sum(x**2, axis=0), 1e-30))
