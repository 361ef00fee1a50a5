"""A sensor of the IMU and the odometry through the same windows of time: what its integral should be, and what it is.

Over windows of time the odometry says by how much the integral of a sensor grows, T, and the sensor says R = k T, k its
scale. For the gyroscope T is the angle by which the attitude turns about an axis of the body; for the accelerometer it
is the sum of R_EB^T (dv + g e_z dt), v the odometry's velocity:

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
    """Integrals of odometry and sensor over windows (K, 3), and the latter's change with a delay.

    `part` (K,) is the number of the part of time that a window is in; parts begin at `when` (P,) [s].
    """

    shown: Array
    read: Array
    change: Array
    part: Indices
    when: Array


def windows_of(blocks: Sequence[Block], window: float, shift: float) -> Windows:
    """Windows of this length [s] in all blocks, the odometry being late by `shift` [s]."""
    seen = [block.windows(window, shift) for block in blocks]
    first = np.cumsum([0, *(len(one.when) for one in seen)])
    parts = [one._replace(part=one.part + at) for one, at in zip(seen, first[:-1], strict=True)]
    return Windows(*(np.concatenate(rows) for rows in zip(*parts, strict=True)))


def blocks_of(flight: Flight, sensor: Sensor) -> list[Block]:
    """Blocks that can be compared; none where odometry or IMU are missing, too slow, or too short."""
    odometry, imu = flight.odometry, flight.imu
    if odometry is None or imu is None or odometry.period > INTERVALS.slowest or imu.period > SCALE.slowest_imu:
        return []
    every = (Block.of(odometry, imu, span, sensor) for span in steady_blocks(odometry, imu))
    found = [block for block in every if block is not None]
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
class Block:
    """What the odometry says of a sensor's integral until `time` (N,), `shown` (N, 3); its own samples about them."""

    time: Array
    shown: Array
    own_time: Array
    read: Array
    summed: Array

    @classmethod
    def of(cls, odometry: OdometrySeries, imu: ImuSeries, span: Span, sensor: Sensor) -> Self | None:
        """From start to stop [s]; None where that has too few samples."""
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
        begins = self.time[0] + SCALE.part * np.arange(self.parts)
        return Windows(straight[:, :3], straight[:, 3:6], straight[:, 6:], part, begins)


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


def delay_of(blocks: Sequence[Block]) -> float | None:
    """By how much the odometry is late behind a sensor [s]; None where they have no motion in common.

    The minimum next to zero, unless clearly less is left in one that a search in steps finds: a motion that swings is
    alike one of its periods later.
    """
    near = minimum_of(blocks, 0.0) if blocks else None
    if near is None:
        return None
    steps = np.linspace(-SCALE.longest_delay, SCALE.longest_delay, SCALE.steps)
    far = minimum_of(blocks, min(steps, key=lambda shift: _left(blocks, shift)[0]))
    clearly = far is not None and _left(blocks, far)[0] < SCALE.clearly * _left(blocks, near)[0]
    return far if clearly else near


def minimum_of(blocks: Sequence[Block], shift: float) -> float | None:
    """The delay [s] that leaves least, downhill (Gauss-Newton) from `shift`; None where that leads too far."""
    for _ in range(5):
        step = _left(blocks, shift)[1]
        shift += step
        if abs(shift) > SCALE.longest_delay:
            return None
        if abs(step) < SCALE.settled:
            break
    return shift


def _left(blocks: Sequence[Block], shift: float) -> tuple[float, float]:
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
