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

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.motion import INTERVALS
from wrenchgap.flight.checks.remedies import factor, option, turns
from wrenchgap.flight.checks.scale_bounds import SCALE, Scale, bounds_of, halves_of, lost_of, sizes_of
from wrenchgap.flight.flight import AXES, Array, Flight, Series
from wrenchgap.flight.row_kernels import integral
from wrenchgap.flight.stamps import interpolated, spread
from wrenchgap.flight.unmeasured import unmeasured_axes

Span = tuple[float, float]
Angles = tuple[Array, Array, Array, Array]


def gyroscope_scale(flight: Flight, known: Sequence[Check]) -> Iterator[Check]:
    """Scale of the gyroscope against the attitude; nothing where `known` says that it is another quantity."""
    bad = {c.name for c in known if c.level == "bad"}
    if flight.imu is None or not bad.isdisjoint(BEFORE):
        return
    scales = gyroscope_scales(flight)
    if scales is not None and any(scale.lost or scale.halves for scale in scales.values()):
        yield _unsteady(scales)
    elif "gyroscope" in bad:
        return
    elif scales is None:
        why = "no attitude is logged" if flight.odometry is None else "attitude or IMU come too slowly or too briefly"
        yield Check("gyroscope-scale", "ok", f"Not tested: {why}.")
    elif off := {axis: scale for axis, scale in scales.items() if scale.off}:
        yield _wrong(flight, scales, off, _is_clipped(known))
    else:
        yield Check("gyroscope-scale", "ok", _bounds_words(scales))


def without_factor(found: Sequence[Check]) -> list[Check]:
    """The checks; of a gyroscope that is clipped, or has no one scale, none offers a factor."""
    unsteady = any(c.name == "gyroscope-scale" and c.level != "ok" and c.mend is None for c in found)
    if not unsteady and not _is_clipped(found):
        return [*found]
    return [replace(c, mend=None) if c.name == "gyroscope" and "unit or scale" in c.words else c for c in found]


def _is_clipped(found: Sequence[Check]) -> bool:
    return any(c.name == "clipped" and c.words.startswith("gyroscope") for c in found)


def _bounds_words(scales: dict[str, Scale]) -> str:
    """The bounds of every axis, and of which axes they say nothing."""
    best = {axis: scale.best for axis, scale in scales.items()}
    told = {
        axis: f"{axis} {b.low:.3f} to {b.high:.3f}" if 0.0 < b.low < b.high < 2.0 else axis for axis, b in best.items()
    }
    known = [told[axis] for axis, b in best.items() if b.width < SCALE.known]
    unknown = [told[axis] for axis, b in best.items() if not b.width < SCALE.known]
    words = [f"No axis is off by {100 * SCALE.said:g} % beyond doubt ({', '.join(known)})."] if known else []
    words += [f"Not known, for too little motion next to noise: {', '.join(unknown)}."] if unknown else []
    return " ".join(words)


def _unsteady(scales: dict[str, Scale]) -> Check:
    """Of axes that have no one scale."""
    lost = [f"{axis} shows nothing of the attitude's turns {s.lost.words}" for axis, s in scales.items() if s.lost]
    halves = {axis: s.halves for axis, s in scales.items() if s.halves and not s.lost}
    said = [*lost, *(f"{axis} has the scale {h.words}" for axis, h in halves.items())]
    off = {axis: s.value for axis, s in scales.items() if s.off and not (s.lost or s.halves)}
    said += [f"{axis} has the scale {k:.3f}" for axis, k in off.items()]
    words = f"The gyroscope is not the attitude's rate: {'; '.join(said)}. No factor mends that: "
    words += "one of the two failed or was set anew, or the sensor reaches the end of its range"
    worst = max(
        [0.0] + [1.0 - min(h.scales) / max(h.scales) for h in halves.values()] + [abs(k - 1.0) for k in off.values()]
    )
    return Check("gyroscope-scale", "bad" if lost or worst > SCALE.stops else "warn", words)


def _wrong(flight: Flight, scales: dict[str, Scale], off: dict[str, Scale], clipped: bool) -> Check:
    """Of axes `off` that have a wrong scale; what mends it is no factor where the sensor is `clipped`."""
    furthest = max(abs(scale.value - 1.0) for scale in off.values())
    said = ", ".join(f"{axis} {scale.value:.3f}" for axis, scale in off.items())
    words = f"The gyroscope is not the attitude's rate: scale {said}, steady over time, size and frequency; its "
    words += "datasheet's sensitivity, or the full-scale range that the driver assumes, may be another"
    common, mend = float(np.mean([scale.value for scale in off.values()])), None
    if clipped:
        words += ", or what it missed beyond its range (see `clipped`)"
    elif all(scale.allows(common) for scale in scales.values()):
        mend = option(flight, f"gyro*{factor(1.0 / common)}", "imu")
    elif not turns(flight, "imu", "gyroscope"):  # else the sensor's axes are not the body's
        mend = option(flight, ",".join(f"gyro.{axis}*{factor(1.0 / s.value)}" for axis, s in off.items()), "imu")
    return Check("gyroscope-scale", "bad" if furthest > SCALE.stops else "warn", words, mend)


BEFORE = ("body-frame", "inertial-frame", "clock-unit")
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
    when = np.concatenate([block.time[0] + SCALE.part * np.arange(block.parts) for block in blocks])
    found = {}
    for k in [k for k, axis in enumerate(AXES[3:]) if axis not in unmeasured_axes(flight)]:
        bands = [_sums(band, k, blocks) for band in seen]
        scale = Scale(tuple(bounds_of(sums) for sums in bands), halves_of(bands), lost_of(bands[0], when))
        if scale.halves is None:
            turned, known = (np.concatenate([angles[side][:, k] for angles in seen[0]]) for side in (0, 1))
            scale = replace(scale, halves=sizes_of(turned, known, scale))
        found["xyz"[k]] = scale
    return found


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
    """Attitudes at `time` (N,) with the angles (N, 3) turned until then; the gyroscope's own samples about them."""

    time: Array
    turned: Array
    gyro_time: Array
    gyro: Array
    summed: Array

    @classmethod
    def of(cls, flight: Flight, span: Span) -> Self | None:
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

    def angles(self, window: float, shift: float) -> Angles:
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


def _sums(band: Sequence[Angles], axis: int, blocks: Sequence[_Block]) -> Array:
    """Sums (3, P) of T^2, T R and R^2 of one axis in one band, by part in the order of time; loud parts turned down."""
    parts = []
    for (turned, known, _, part), block in zip(band, blocks, strict=True):
        t, r = turned[:, axis], known[:, axis]
        parts.append([np.bincount(part, weights=w, minlength=block.parts) for w in (t * t, t * r, r * r)])
    sums = np.concatenate(parts, axis=1)
    return np.asarray(sums * np.minimum(1.0, np.percentile(sums[0], SCALE.loudest) / np.maximum(sums[0], 1e-30)))
