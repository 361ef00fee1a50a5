"""The scale of a sensor of the IMU against the odometry, axis by axis, and whether it is one number.

Odometry and sensor are seen through the same windows (`sensor_windows`), in two bands (`SCALE.windows`). Noise on both
is why the scale k is given as two bounds and not as a slope: seen from the odometry,

    sum T R / sum T^2  <=  k  <=  sum R^2 / sum T R,

the first too small by the odometry's noise, the second too large by the sensor's (Frisch 1934; errors in variables).
Noise, lag and delay move the bounds apart and never both past one. A scale is the same in both bands; a filter acts on
the faster one, and an estimator that corrects what it integrates of this very sensor on the slower one: where the
bands differ, there is no such number and nothing is said.

Scales of two halves of a flight differ where their bounds leave a gap beyond doubt. A signal that is cut off at some
size is so in all parts of a lively flight; there the sizes of T and of R, each sorted by itself, are in another
proportion among the small than among the large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.checks.misread_axes import Misreading, misreading
from wrenchgap.flight.checks.sensor_windows import SCALE, Sensor, Windows, comparable_blocks, odometry_delay, windows_of
from wrenchgap.flight.flight import AXES, Array, Flight
from wrenchgap.flight.unmeasured import unmeasured_axes


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
    def width(self) -> float:
        """Between the bounds."""
        return self.high - self.low

    def apart(self, other: Bounds) -> bool:
        """Whether two scales differ beyond doubt, and by more than is said."""
        gap = max(self.low - other.high, other.low - self.high)
        return min(self.low, other.low) > 0.0 and gap > max(
            SCALE.reported, SCALE.sigmas * float(np.hypot(self.std, other.std))
        )

    @property
    def off(self) -> bool:
        """Whether one is surely not between the bounds."""
        return self.low - SCALE.sigmas * self.std > 1.0 or 0.0 < self.high + SCALE.sigmas * self.std < 1.0


IN_TIME = ("in the first half of the flight", "in the second")
IN_MOTION = ("in the calmer half of the flight", "in the livelier")
IN_PARTS = ("in most parts of the flight", "in others")
IN_SIZE = ("in the smaller half of the turns", "in the larger")


@dataclass(frozen=True)
class TwoScales:
    """Of a flight, by `names`, and the scale in each."""

    names: tuple[str, str]
    scales: tuple[float, float]

    @property
    def words(self) -> str:
        """Both numbers."""
        return ", ".join(f"{k:.2f} {name}" for name, k in zip(self.names, self.scales, strict=True))


@dataclass(frozen=True)
class SignalLoss:
    """When [s] an axis and the attitude begin or cease to turn alike: their correlation `before` and `after`."""

    time: float
    before: float
    after: float

    @property
    def words(self) -> str:
        """Time and both numbers."""
        side = "from {:.0f} s on" if self.before > self.after else "until {:.0f} s"
        return f"{side.format(self.time)} (correlation {self.before:.2f} before, {self.after:.2f} after)"


@dataclass(frozen=True)
class Fault:
    """What is wrong with an axis, in words that follow its name, and by which share its scale is off."""

    words: str
    size: float


@dataclass(frozen=True)
class Scale:
    """Of one axis: bounds by band; the halves in which they differ, when it showed no turns, what it read instead."""

    bounds: tuple[Bounds, ...]
    halves: TwoScales | None = None
    lost: SignalLoss | None = None
    misread: Misreading | None = None

    @property
    def unsteady(self) -> bool:
        """Whether there is no one scale."""
        return any(one is not None for one in (self.misread, self.lost, self.halves))

    def fault(self) -> Fault | None:
        """What is wrong, if anything."""
        if self.misread is not None:
            return Fault(f"reads {self.misread.words}", np.inf)
        if self.lost is not None:
            return Fault(f"shows nothing of the attitude's turns {self.lost.words}", np.inf)
        if self.halves is not None:
            return Fault(f"has the scale {self.halves.words}", 1.0 - min(self.halves.scales) / max(self.halves.scales))
        return Fault(f"has the scale {self.value:.3f}", abs(self.value - 1.0)) if self.off else None

    @property
    def value(self) -> float:
        """The scale, of the band that knows it best."""
        return self.best.middle

    @property
    def best(self) -> Bounds:
        """Of the band that knows it best."""
        return min(self.bounds, key=lambda b: b.width + b.std)

    @property
    def least_excess(self) -> float:
        """By which share the sensor reads too much at least, by the band that knows it best; zero where another one
        contradicts.

        Noise of the odometry makes the lower bound smaller, never larger. Nothing like it holds for a sensor that reads
        too little: R^2 / T R is small where that noise happens to go with what little the sensor shows.
        """  # noqa: D205
        best, slack = self.best, [SCALE.sigmas * b.std for b in self.bounds]
        meet = all(b.low - s < best.high and best.low < b.high + s for b, s in zip(self.bounds, slack, strict=True))
        return max(best.low - SCALE.sigmas * best.std - 1.0, 0.0) if meet else 0.0

    def allows(self, value: float) -> bool:
        """Whether the scale may be this one."""
        slack = [SCALE.sigmas * b.std + SCALE.tolerance for b in self.bounds]
        return all(b.low - s < value < b.high + s for b, s in zip(self.bounds, slack, strict=True))

    @property
    def off(self) -> bool:
        """Whether all bands say that it is off, by at least `SCALE.reported` and by the same."""
        middles, beyond = [b.middle for b in self.bounds], abs(self.value - 1.0)
        said = min(abs(m - 1.0) for m in middles) >= SCALE.reported - SCALE.tolerance and beyond >= SCALE.reported
        apart = max(SCALE.tolerance, SCALE.tolerance_share * beyond)
        steady = max(b.width for b in self.bounds) < apart and float(np.ptp(middles)) < apart
        return all(b.off for b in self.bounds) and said and steady


def sensor_scales(flight: Flight, sensor: Sensor) -> dict[str, Scale] | None:
    """The scale by measured axis ("x"); None where odometry or IMU are missing, too slow, or too short."""
    blocks = comparable_blocks(flight, sensor)
    shift = odometry_delay(blocks)
    if shift is None:
        return None
    bands = [windows_of(blocks, window, shift) for window in SCALE.windows]
    axes, absent = AXES[3:] if sensor == "gyroscope" else AXES[:3], unmeasured_axes(flight)
    of = _gyroscope_scale if sensor == "gyroscope" else _accelerometer_scale
    return {"xyz"[k]: of(bands, k) for k, axis in enumerate(axes) if axis not in absent}


def _gyroscope_scale(bands: Sequence[Windows], axis: int) -> Scale:
    every, starts = _cross_moments(bands, axis), bands[0].starts
    own = [sums[axis] for sums in every]
    turns = bands[0].reference[:, axis]
    motion = np.bincount(bands[0].segment, weights=turns**2, minlength=len(starts)).astype(float)
    moves = moving(own)
    halves, lost = differing_halves(moves) or differing_segments(moves), signal_loss(own[0], motion, starts)
    scale = Scale(tuple(map(scale_bounds, own)), halves, lost, misreading(every, axis, starts))
    return _by_size(scale, bands[0].reference[:, axis], bands[0].measured[:, axis])


def _accelerometer_scale(bands: Sequence[Windows], axis: int) -> Scale:
    """A vehicle that bounces is no lost axis, and what pushes it is seldom plain: neither is asked."""
    alone = [_partial(band, axis) for band in bands]
    own = [_moments(*pair, band) for pair, band in zip(alone, bands, strict=True)]
    misread = misreading(_cross_moments(bands, axis), axis, bands[0].starts)
    return _by_size(Scale(tuple(map(scale_bounds, own)), differing_halves(moving(own)), misread=misread), *alone[0])


def _by_size(scale: Scale, reference: Array, measured: Array) -> Scale:
    """The scale, with those of small and large turns where these alone differ."""
    return scale if scale.halves else replace(scale, halves=differing_sizes(reference, measured, scale))


def _cross_moments(bands: Sequence[Windows], axis: int) -> list[Array]:
    """By band, moments (3, 3, P) of the reference on each axis and what the sensor measures on this one."""
    return [np.stack([_moments(T, band.measured[:, axis], band) for T in band.reference.T]) for band in bands]


def _partial(band: Windows, axis: int) -> tuple[Array, Array]:
    """T and R (K,) of one axis without their regression on the reference of the others (partial regression).

    An accelerometer askew reads of those too, and what pushes along z is ten times as large as what pushes along x.
    """
    others = np.delete(band.reference, axis, axis=1)
    both = np.stack((band.reference[:, axis], band.measured[:, axis]), axis=1)
    left = both - others @ np.linalg.lstsq(others, both, rcond=None)[0]
    return left[:, 0], left[:, 1]


def _moments(T: Array, R: Array, band: Windows) -> Array:
    """Sums (3, P) of T^2, T R and R^2 by segment in the order of time; loud segments turned down."""
    sums = np.stack([np.bincount(band.segment, weights=v, minlength=len(band.starts)) for v in (T * T, T * R, R * R)])
    loud = np.percentile(sums[0], SCALE.loudest_percentile)
    return np.asarray(sums * np.minimum(1.0, loud / np.maximum(sums[0], 1e-30)))


def scale_bounds(sums: Array) -> Bounds:
    """Bounds on a scale from sums (3, P) by segment; standard deviation from the segments."""
    tt, tr, rr = sums
    total = [float(np.sum(v)) for v in sums]
    if total[0] <= 0.0 or total[1] <= 0.0:
        return Bounds(-np.inf, np.inf, np.inf)
    low, high = total[1] / total[0], total[2] / total[1]
    count = len(tt)
    scatter = [np.sqrt(np.sum(e**2) * count / (count - 1)) for e in (tr - low * tt, rr - high * tr)]
    return Bounds(low, high, float(max(scatter[0] / total[0], scatter[1] / total[1])))


def moving(bands: Sequence[Array]) -> list[Array]:
    """Sums without segments in which a vehicle stands, and an estimator's corrections are all that turns; empty
    where too few are left.
    """  # noqa: D205
    moves = [sums[:, sums[0] > SCALE.standing**2 * np.percentile(sums[0], 75.0)] for sums in bands]
    return moves if min(sums.shape[1] for sums in moves) >= SCALE.fewest_segments else []


def differing_halves(bands: Sequence[Array]) -> TwoScales | None:
    """Halves of the segments with scales that differ in all bands: first and second, or the calmer and livelier."""
    if not bands:
        return None
    calmer = [np.argsort(sums[0], kind="stable") for sums in bands]
    for names, orders in ((IN_TIME, [np.arange(sums.shape[1]) for sums in bands]), (IN_MOTION, calmer)):
        pairs = [
            tuple(scale_bounds(sums[:, rows]) for rows in np.array_split(order, 2))
            for sums, order in zip(bands, orders, strict=True)
        ]
        if all(a.apart(b) for a, b in pairs):
            a, b = min(pairs, key=lambda pair: pair[0].width + pair[1].width)
            return TwoScales(names, (a.middle, b.middle))
    return None


def differing_segments(bands: Sequence[Array]) -> TwoScales | None:
    """The scale of most segments, and that of some which is a unit's factor away: a stretch in another unit.

    Segments count in which both are plainly one motion, so that the bounds of each are a tenth apart.
    """
    few = SCALE.fewest_segments // 2
    for tt, tr, rr in bands:
        plain = tr**2 > SCALE.clear_correlation**2 * tt * rr
        scales = np.sort(np.sqrt(rr[plain] / tt[plain]))
        if len(scales) > 2 * few:
            usual = float(np.median(scales))
            odd = max((float(scales[few - 1]), float(scales[-few])), key=lambda k: abs(np.log(k / usual)))
            if abs(np.log(odd / usual)) > np.log(SCALE.unit_factor):
                return TwoScales(IN_PARTS, (usual, odd))
    return None


def differing_sizes(turned: Array, known: Array, scale: Scale) -> TwoScales | None:
    """Scales of the smaller and the larger turns (K,), where they differ as no one scale, and no noise, does.

    The noise of either is at most the share of its power by which the bounds of `scale` are apart.
    """
    parts = [[float(np.sum(half)) for half in np.array_split(np.sort(v**2), 2)] for v in (turned, known)]
    if min(part for halves in parts for part in halves) <= 0.0 or not scale.bounds[0].low > 0.0:
        return None
    small, large = (float(np.sqrt(r / t)) for t, r in zip(*parts, strict=True))
    noise = np.log1p(0.5 * (scale.bounds[0].high / scale.bounds[0].low - 1.0) * max(sum(p) / p[0] for p in parts)) / 2.0
    least = max(SCALE.tolerance, SCALE.tolerance_share * abs(np.log(scale.value))) if scale.off else SCALE.widest
    return TwoScales(IN_SIZE, (small, large)) if abs(np.log(small / large)) > least + noise else None


def signal_loss(sums: Array, motion: Array, when: Array) -> SignalLoss | None:
    """From when on, or until when, an axis shows nothing of the attitude's turns, as much as it turns; of segments that
    begin at `when` (P,), `motion` (P,) is the sum of T^2 as it is.

    Where the attitude hardly turns it shows its noise alone, and so does a sound axis. What is lost is lost in most
    segments: an attitude that is set anew contradicts a sound gyroscope in one.
    """  # noqa: D205
    tt, tr, rr = sums
    alike, found = tr / np.sqrt(np.maximum(tt * rr, 1e-30)), []
    for k in range(SCALE.fewest_segments // 2, len(when) - SCALE.fewest_segments // 2 + 1):
        sides = [(alike[rows], tt[rows], motion[rows]) for rows in (slice(k), slice(k, None))]
        means = [
            (float(np.sum(c * w) / max(np.sum(w), 1e-30)), float(np.median(m)), float(np.median(c)))
            for c, w, m in sides
        ]
        (seen, usual, _), (unseen, there, mostly) = max(means), min(means)
        lost = max(abs(unseen), abs(mostly)) < SCALE.uncorrelated
        if lost and there > SCALE.least_motion * usual and seen > SCALE.correlated:
            found.append(SignalLoss(float(when[k]), means[0][0], means[1][0]))
    return max(found, key=lambda lost: abs(lost.before - lost.after), default=None)
