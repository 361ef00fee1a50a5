"""The scale of the gyroscope, axis by axis: angles that the attitude turns by against the integral of the rates.

Over windows of time, the attitude turns by T about an axis of the body and the gyroscope's integral says R = k T, k its
scale. Both are seen through the same windows, in two bands (`SCALE.windows`), after the delay between them and, in
every block, a bias and its drift. Noise on both is why k is given as two bounds and not as a slope: seen from the
attitude,

    sum T R / sum T^2  <=  k  <=  sum R^2 / sum T R,

the first too small by the attitude's noise, the second too large by the gyroscope's (Frisch 1934; errors in variables).
Noise, lag and delay move the bounds apart and never both past one. A scale is the same in both bands; a filter acts on
the faster one, and an estimator that corrects what it integrates of this very gyroscope on the slower one: where the
bands differ, there is no such number and nothing is said.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.motion import INTERVALS
from wrenchgap.flight.checks.remedies import factor, option, turns
from wrenchgap.flight.flight import AXES, Array, Flight, Series
from wrenchgap.flight.row_kernels import integral
from wrenchgap.flight.stamps import interpolated, spread
from wrenchgap.flight.unmeasured import unmeasured_axes


@dataclass(frozen=True)
class ScaleThresholds:
    """How the scale of a gyroscope is estimated, and when it is wrong."""

    windows: tuple[float, float] = (0.15, 0.6)
    """Windows [s] over which angles are compared: up to 3 Hz and up to 0.8 Hz."""
    block: float = 8.0
    """Time [s] from which a bias and its slope are removed."""
    part: float = 2.0
    """Parts of a block [s], whose scatter says how sure the scale is."""
    margin: float = 0.1
    """Margin at a block's ends [s], for stamps that move."""
    spacing: float = 0.03
    """Time between attitudes of which angles are taken [s]: short enough for turns about changing axes to add up."""
    most_blocks: int = 60
    """Blocks, evenly spread over the flight, beyond which no more are taken."""
    fewest_parts: int = 6
    """Parts below which nothing is said."""
    loudest: float = 75.0
    """Percentile of the motion in the parts to which louder ones are turned down: a crash does not decide."""
    slowest_imu: float = 0.05
    """Period of an IMU [s] beyond which its integral misses the motion."""
    said: float = 0.02
    """How far from one a scale is said: mass and thrust that explain it come out wrong by about as much."""
    stops: float = 0.05
    """How far from one a scale stops the log."""
    sure: float = 4.0
    """Standard deviations that both bounds lie on one side of one: a chance of 1 % with so few parts (Student, 5)."""
    steady: float = 0.01
    """By which bounds and bands may differ."""
    steady_share: float = 0.25
    """Or by this share of how far the scale is from one."""
    longest_delay: float = 0.1
    """Delay [s] between the two beyond which they show no common motion."""


SCALE = ScaleThresholds()


Span = tuple[float, float]


@dataclass(frozen=True)
class Bounds:
    """Of a scale k: `low` and `high`, and the standard deviation of both."""

    low: float
    high: float
    std: float

    @property
    def middle(self) -> float:
        """The scale itself."""
        return float(np.sqrt(self.low * self.high)) if self.low > 0.0 < self.high else np.nan

    @property
    def off(self) -> bool:
        """Whether one is surely not between the bounds."""
        return self.low - SCALE.sure * self.std > 1.0 or 0.0 < self.high + SCALE.sure * self.std < 1.0


@dataclass(frozen=True)
class Scale:
    """Of one axis or several: bounds by band."""

    bounds: tuple[Bounds, ...]

    @property
    def value(self) -> float:
        """The scale, of the band that knows it best."""
        return min(self.bounds, key=lambda b: b.high - b.low + b.std).middle

    def allows(self, value: float) -> bool:
        """Whether the scale may be this one."""
        slack = [SCALE.sure * b.std + SCALE.steady for b in self.bounds]
        return all(b.low - s < value < b.high + s for b, s in zip(self.bounds, slack, strict=True))

    @property
    def off(self) -> bool:
        """Whether all bands say that it is off, by at least `SCALE.said` and by the same."""
        middles, beyond = [b.middle for b in self.bounds], abs(self.value - 1.0)
        said = min(abs(m - 1.0) for m in middles) >= SCALE.said - SCALE.steady and beyond >= SCALE.said
        apart = max(SCALE.steady, SCALE.steady_share * beyond)
        steady = max(b.high - b.low for b in self.bounds) < apart and float(np.ptp(middles)) < apart
        return all(b.off for b in self.bounds) and said and steady


def gyroscope_scale(flight: Flight, known: Sequence[Check]) -> Iterator[Check]:
    """Scale of the gyroscope against the attitude; nothing where `known` says that it is another quantity."""
    if flight.imu is None or any(c.level == "bad" and c.name in BEFORE for c in known):
        return
    scales = gyroscope_scales(flight)
    if scales is None:
        why = "no attitude is logged" if flight.odometry is None else "attitude or IMU come too slowly or too briefly"
        yield Check("gyroscope-scale", "ok", f"Not tested: {why}.")
        return
    off = {axis: scale for axis, scale in scales.items() if scale.off}
    if not off:
        fast = {axis: scale.bounds[0] for axis, scale in scales.items()}
        known_axes = {axis: np.isfinite(b.low) and b.low > 0.0 and b.high < 2.0 for axis, b in fast.items()}
        told = (f"{b.low:.3f} to {b.high:.3f}" if known_axes[axis] else "unknown" for axis, b in fast.items())
        listed = ", ".join(f"{axis} {words}" for axis, words in zip(fast, told, strict=True))
        yield Check("gyroscope-scale", "ok", f"No axis is off by {100 * SCALE.said:g} % beyond doubt ({listed}).")
        return
    furthest = max(abs(scale.value - 1.0) for scale in off.values())
    said = ", ".join(f"{axis} {scale.value:.3f}" for axis, scale in off.items())
    words = f"The gyroscope is not the attitude's rate: scale {said}, steady over time and frequency; its datasheet's "
    words += "sensitivity, or the full-scale range that the driver assumes, may be another"
    common, mend = float(np.mean([scale.value for scale in off.values()])), None
    if all(scale.allows(common) for scale in scales.values()):
        mend = option(flight, f"gyro*{factor(1.0 / common)}", "imu")
    elif not turns(flight, "imu", "gyroscope"):  # else the sensor's axes are not the body's
        mend = option(flight, ",".join(f"gyro.{axis}*{factor(1.0 / s.value)}" for axis, s in off.items()), "imu")
    yield Check("gyroscope-scale", "bad" if furthest > SCALE.stops else "warn", words, mend)


BEFORE = ("gyroscope", "body-frame", "inertial-frame", "clock-unit")
"""Checks that leave no scale to speak of where they are bad."""


def gyroscope_scales(flight: Flight) -> dict[str, Scale] | None:
    """The scale by measured axis ("x"); None where attitude or IMU are missing, too slow, or too short."""
    odometry, imu = flight.odometry, flight.imu
    if odometry is None or imu is None or odometry.period > INTERVALS.slowest or imu.period > SCALE.slowest_imu:
        return None
    blocks = [block for span in steady_blocks(odometry, imu) if (block := _Block.of(flight, span)) is not None]
    if sum(block.parts for block in blocks) < SCALE.fewest_parts:
        return None
    shift = _delay(blocks)
    if shift is None:
        return None
    seen = [[block.angles(window, shift) for block in blocks] for window in SCALE.windows]
    measured = [k for k, axis in enumerate(AXES[3:]) if axis not in unmeasured_axes(flight)]
    return {"xyz"[k]: Scale(tuple(_bounds(band, k) for band in seen)) for k in measured}


def steady_blocks(*series: Series) -> list[Span]:
    """Start and stop [s] of blocks in which all series go on, evenly spread."""
    start, stop = max(s.time[0] for s in series), min(s.time[-1] for s in series)
    gaps = sorted((gap.start, gap.stop) for s in series for gap in s.gaps)
    found, since = [], start
    for until, then in [*gaps, (stop, stop)]:
        length = until - since
        count = max(1, int(np.ceil(length / SCALE.block)))
        size = length / count
        found += [(since + k * size, since + (k + 1) * size) for k in range(count) if size > 2.0 * SCALE.part]
        since = max(since, then)
    return [found[k] for rows in spread(len(found), SCALE.most_blocks, 1) for k in range(rows.start, rows.stop)]


@dataclass(frozen=True)
class _Block:
    """Attitudes at `time` (N,) with the angles (N, 3) turned until then; the gyroscope's own samples about them."""

    time: Array
    turned: Array
    gyro_time: Array
    gyro: Array
    summed: Array

    @classmethod
    def of(cls, flight: Flight, span: Span) -> _Block | None:
        odometry, imu = flight.odometry, flight.imu
        assert odometry is not None
        assert imu is not None
        rows = slice(*np.searchsorted(odometry.time, (span[0] + SCALE.margin, span[1] - SCALE.margin)))
        every = max(1, round(SCALE.spacing / odometry.period))
        time, quat = odometry.time[rows][::every], so3.continuous(odometry.quat_EB[rows][::every])
        own = slice(*np.searchsorted(imu.time, span))
        gyro_time, gyro = imu.time[own], np.ascontiguousarray(imu.omega_B[own])
        if len(time) < 2 * SCALE.part / max(SCALE.spacing, odometry.period) or len(gyro_time) < len(time):
            return None
        turned = np.vstack((np.zeros(3), np.cumsum(so3.rotation_between(quat[:-1], quat[1:]), axis=0)))
        return cls(time, turned, gyro_time, gyro, integral(gyro_time, gyro))

    @property
    def parts(self) -> int:
        """Whole parts of `SCALE.part`."""
        return max(1, round(float(self.time[-1] - self.time[0]) / SCALE.part))

    def angles(self, window: float, shift: float) -> tuple[Array, Array, Array, Array]:
        """Angles of attitude and gyroscope over windows (K, 3), the latter's change with `shift`, parts (K,)."""
        period = (self.time[-1] - self.time[0]) / (len(self.time) - 1)
        width = max(1, round(window / period))
        start = np.arange(0, len(self.time) - width, max(1, width // 2))
        ends = np.stack((start, start + width))
        at = self.time[ends] - shift
        known, rates = (
            np.diff([interpolated(t, self.gyro_time, v) for t in at], axis=0)[0] for v in (self.summed, self.gyro)
        )
        turned = np.diff(self.turned[ends], axis=0)[0]
        when = self.time[start]
        part = np.minimum(((when - when[0]) / SCALE.part).astype(int), self.parts - 1)
        return _straightened(when, turned), _straightened(when, known), _straightened(when, rates), part


def _straightened(time: Array, values: Array) -> Array:
    """Values (K, 3) without their mean and slope over time: a bias, and its drift."""
    lever = np.stack((np.ones_like(time), time - time.mean()), axis=1)
    return np.asarray(values - lever @ np.linalg.lstsq(lever, values, rcond=None)[0])


def _delay(blocks: Sequence[_Block]) -> float | None:
    """By how much the attitude is late behind the gyroscope [s]; None where they have no motion in common."""
    shift = 0.0
    for _ in range(5):
        turned, known, rates = (
            np.concatenate(v) for v in zip(*(b.angles(SCALE.windows[0], shift)[:3] for b in blocks), strict=True)
        )
        scale = float(np.sum(turned * known)) / max(float(np.sum(turned**2)), 1e-30)
        change = float(np.sum(rates * (known - scale * turned))) / max(float(np.sum(rates**2)), 1e-30)
        shift += change
        if abs(shift) > SCALE.longest_delay:
            return None
        if abs(change) < 1e-4:
            break
    return shift


def _bounds(band: Sequence[tuple[Array, Array, Array, Array]], axis: int) -> Bounds:
    """Bounds on the scale of one axis in one band; standard deviation from the parts of all blocks."""
    sums = []
    for turned, known, _, part in band:
        t, r = turned[:, axis], known[:, axis]
        sums += [np.bincount(part, weights=w) for w in (t * t, t * r, r * r)]
    tt, tr, rr = (np.concatenate(sums[k::3]) for k in range(3))
    weight = np.minimum(1.0, np.percentile(tt, SCALE.loudest) / np.maximum(tt, 1e-30))
    tt, tr, rr = weight * tt, weight * tr, weight * rr
    total = [float(np.sum(v)) for v in (tt, tr, rr)]
    if total[0] <= 0.0 or total[1] <= 0.0:
        return Bounds(-np.inf, np.inf, np.inf)
    low, high = total[1] / total[0], total[2] / total[1]
    count = len(tt)
    scatter = [np.sqrt(np.sum(e**2) * count / (count - 1)) for e in (tr - low * tt, rr - high * tr)]
    return Bounds(low, high, float(max(scatter[0] / total[0], scatter[1] / total[1])))
