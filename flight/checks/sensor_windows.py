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
from wrenchgap.flight.flight import GRAVITY, Array, Flight, ImuSeries, Indices, OdometrySeries, Series
from wrenchgap.flight.row_kernels import integral, lengths
from wrenchgap.flight.stamps import interpolated, spread


@dataclass(frozen=True)
class ScaleThresholds:
    """How the scale of a sensor is estimated, and when it is wrong."""

    windows: tuple[float, float] = (0.15, 0.6)
    """Windows [s] over which angles are compared: up to 3 Hz and up to 0.8 Hz."""
    block: float = 8.0
    """Time [s] from which a bias and its slope are removed."""
    segment: float = 2.0
    """Segments of a block [s], whose scatter is the scale's standard deviation."""
    margin: float = 0.1
    """Margin at a block's ends [s], for stamps that move."""
    spacing: float = 0.03
    """Time between attitudes of which angles are taken [s]: short enough for turns about changing axes to add up."""
    most_blocks: int = 60
    """Blocks, evenly spread over the flight, beyond which no more are taken."""
    fewest_segments: int = 6
    """Segments below which nothing is said."""
    loudest_percentile: float = 75.0
    """Percentile of the motion in the segments to which louder ones are turned down: a crash does not decide."""
    slowest_imu: float = 0.05
    """Period of an IMU [s] beyond which its integral misses the motion."""
    reported: float = 0.02
    """How far from one a scale is reported: mass and thrust that explain it come out wrong by about as much."""
    refused: float = 0.05
    """How far from one a scale stops the log."""
    refused_axis: float = 0.15
    """How far from one the scale of an accelerometer's axis stops the log: one that is mounted askew by 15 deg, which
    is an effect, has been seen off by 0.07 in flight, and by 0.11 in one half of it against the other."""
    sigmas: float = 4.0
    """Standard deviations that both bounds are on one side of one: a chance of 1 % with few segments (Student, 5)."""
    tolerance: float = 0.01
    """By which bounds and bands may differ."""
    tolerance_share: float = 0.25
    """Or by this share of how far the scale is from one."""
    widest: float = 0.1
    """Between bounds further apart a scale is not known: twice what stops a log."""
    correlated: float = 0.8
    """Mean correlation over segments, by their motion, from which on an axis shows the attitude's turns."""
    uncorrelated: float = 0.3
    """Mean correlation up to which it does not: twice that of unrelated turns in three segments of 13 windows."""
    least_motion: float = 0.5
    """Share of the other side's motion that the odometry has where an axis is lost: noise alone has 1 - correlated^2.
    And share of what another axis shows that one must read to read that: one askew by 20 deg reads a third."""
    standing: float = 0.1
    """Share of what the livelier segments turn (rms) below which a segment shows an estimator's corrections: those of
    an EKF at rest are a fortieth of a hover's turns."""
    largest_correlation: float = 0.9999
    """Correlation beyond which there is none larger."""
    least_delay: float = 2e-3
    """By how much one sensor must be later than the other [s]: half a sample at 250 Hz."""
    delay_sigmas: float = 3.0
    """Standard deviations by which it is, as for other offsets (`learn.diagnose.timing`)."""
    jackknife_groups: int = 6
    """Groups of blocks without each of which a delay is taken again, for its deviation."""
    delay_starts: int = 11
    """Delays at which a search begins, 20 ms apart; with 6 or 21 the same late sensors are found, but for one in 22."""
    far_misfit: float = 0.7
    """Share of the misfit of the delay next to zero that another one has at most. Half of it finds 20 late sensors of
    36 in place of 22; where any share will do, noise alone moves the delay of hovers by 20 to 90 ms."""
    delay_tolerance: float = 1e-4
    """Step of the search [s] at which it ends."""
    least_step: float = 0.025
    """By how much a delay must step in flight [s] to be said: two recorded flights have 10 and 20 ms."""
    clear_correlation: float = 0.95
    """Correlation from which on a segment shows plainly one motion: its bounds are 1 / 0.95^2 = 1.11 apart."""
    unit_factor: float = 3.0
    """Factor between the scales of such segments from which on they have another unit; degrees make 57. Without the two
    furthest segments either way 84 recorded flights have 1.85 at most, after a crash, and 1.39 else."""
    least_corner: float = 0.02
    """Corner of a gyroscope's high-pass [Hz] from which on it stops a log: J c omega is 0.6 of a typical rotational
    drag there. Of 60 recorded flights none shows one on all axes."""
    turned: float = 5.0
    """Factor by which the angle turned must exceed what noise of a rate makes of it, for a high-pass to be seen: still
    hovers of a simulated quadrotor have 0.7 to 1.5, and behind a high-pass of 0.1 Hz flights with turns 9 to 150."""
    longest_delay: float = 0.1
    """Delay [s] between the two beyond which they show no common motion."""


SCALE = ScaleThresholds()


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
    """Blocks that can be compared, while motors run; none where odometry or IMU are missing, too slow, or too
    short.
    """  # noqa: D205
    odometry, imu = flight.odometry, flight.imu
    if odometry is None or imu is None or odometry.period > INTERVALS.slowest or imu.period > SCALE.slowest_imu:
        return []
    every = (Block.of(odometry, imu, span, sensor) for span in steady_blocks(odometry, imu, within=motors_run(flight)))
    found = [block for block in every if block is not None]
    return found if sum(block.segments for block in found) >= SCALE.fewest_segments else []


def motors_run(flight: Flight, turning: float = 0.05) -> Span:
    """Start and stop [s] of the commands above this share of their range: before, estimators settle and turn what
    stands still. All times where no commands were logged.
    """  # noqa: D205
    if flight.actuators is not None and flight.actuators.rotor_speed.size:
        time, level = flight.actuators.time, np.fmax.reduce(np.abs(flight.actuators.rotor_speed), axis=1)
    elif flight.commanded is not None:
        time, level = flight.commanded.time, lengths(flight.commanded.wrench_B[:, :3])
    else:
        return -np.inf, np.inf
    known = level[np.isfinite(level)]
    if not known.size:
        return -np.inf, np.inf
    least, most = known.min(), np.percentile(known, 99.0)
    runs = np.flatnonzero(level > least + turning * (most - least))
    return (float(time[runs[0]]), float(time[runs[-1]])) if runs.size else (-np.inf, np.inf)


def steady_blocks(*series: Series, within: Span = (-np.inf, np.inf)) -> list[Span]:
    """Start and stop [s] of blocks in which all series go on, evenly spread, within a span."""
    start, stop = max(within[0], *(s.time[0] for s in series)), min(within[1], *(s.time[-1] for s in series))
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
