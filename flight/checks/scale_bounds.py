"""The scale of one signal against another by two bounds, and whether it is one number over time and size.

From sums (3, P) of T^2, T R and R^2 in parts of time (`gyroscope_scale` says of what). Scales of two halves differ
where their bounds leave a gap beyond doubt: noise moves bounds apart and never both past the scale. A signal that is
cut off at some size is so in all parts of a lively flight; there the sizes of T and of R, each sorted by itself, are in
another proportion among the small than among the large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import Array


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
    known: float = 0.1
    """Between bounds further apart a scale is not known: twice what stops a log."""
    shown: float = 0.8
    """Mean correlation over parts, by their motion, from which on an axis shows the attitude's turns."""
    unseen: float = 0.3
    """Mean correlation up to which it does not: twice that of unrelated turns in three parts of 13 windows."""
    similar: float = 0.5
    """Share of the other side's motion that the attitude has where an axis is lost; its noise alone has 1 - shown^2."""
    longest_delay: float = 0.1
    """Delay [s] between the two beyond which they show no common motion."""


SCALE = ScaleThresholds()


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
            SCALE.said, SCALE.sure * float(np.hypot(self.std, other.std))
        )

    @property
    def off(self) -> bool:
        """Whether one is surely not between the bounds."""
        return self.low - SCALE.sure * self.std > 1.0 or 0.0 < self.high + SCALE.sure * self.std < 1.0


IN_TIME = ("in the first half of the flight", "in the second")
IN_MOTION = ("in the calmer half of the flight", "in the livelier")
IN_SIZE = ("in the smaller half of the turns", "in the larger")


@dataclass(frozen=True)
class Halves:
    """Of a flight, by `names`, and the scale in each."""

    names: tuple[str, str]
    scales: tuple[float, float]

    @property
    def words(self) -> str:
        """Both numbers."""
        return ", ".join(f"{k:.2f} {name}" for name, k in zip(self.names, self.scales, strict=True))


@dataclass(frozen=True)
class Lost:
    """When [s] an axis and the attitude part, or come together: correlation of their turns `before` and `after`."""

    time: float
    before: float
    after: float

    @property
    def words(self) -> str:
        """Time and both numbers."""
        side = "from {:.0f} s on" if self.before > self.after else "until {:.0f} s"
        return f"{side.format(self.time)} (correlation {self.before:.2f} before, {self.after:.2f} after)"


@dataclass(frozen=True)
class Scale:
    """Of one axis: bounds by band; the halves in which they differ, and when the axis showed no turns any more."""

    bounds: tuple[Bounds, ...]
    halves: Halves | None = None
    lost: Lost | None = None

    @property
    def value(self) -> float:
        """The scale, of the band that knows it best."""
        return self.best.middle

    @property
    def best(self) -> Bounds:
        """Of the band that knows it best."""
        return min(self.bounds, key=lambda b: b.width + b.std)

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
        steady = max(b.width for b in self.bounds) < apart and float(np.ptp(middles)) < apart
        return all(b.off for b in self.bounds) and said and steady


def bounds_of(sums: Array) -> Bounds:
    """Bounds on a scale from sums (3, P) by part; standard deviation from the parts."""
    tt, tr, rr = sums
    total = [float(np.sum(v)) for v in sums]
    if total[0] <= 0.0 or total[1] <= 0.0:
        return Bounds(-np.inf, np.inf, np.inf)
    low, high = total[1] / total[0], total[2] / total[1]
    count = len(tt)
    scatter = [np.sqrt(np.sum(e**2) * count / (count - 1)) for e in (tr - low * tt, rr - high * tr)]
    return Bounds(low, high, float(max(scatter[0] / total[0], scatter[1] / total[1])))


def halves_of(bands: Sequence[Array]) -> Halves | None:
    """Halves of the parts in which all bands say another scale: the first and second, or the calmer and livelier."""
    calmer = [np.argsort(sums[0], kind="stable") for sums in bands]
    for names, orders in ((IN_TIME, [np.arange(bands[0].shape[1])] * len(bands)), (IN_MOTION, calmer)):
        pairs = [
            tuple(bounds_of(sums[:, rows]) for rows in np.array_split(order, 2))
            for sums, order in zip(bands, orders, strict=True)
        ]
        if all(a.apart(b) for a, b in pairs):
            a, b = min(pairs, key=lambda pair: pair[0].width + pair[1].width)
            return Halves(names, (a.middle, b.middle))
    return None


def sizes_of(turned: Array, known: Array, scale: Scale) -> Halves | None:
    """Scales of the smaller and the larger turns (K,), where they differ as no one scale, and no noise, does.

    The noise of either is at most the share of its power by which the bounds of `scale` are apart.
    """
    parts = [[float(np.sum(half)) for half in np.array_split(np.sort(v**2), 2)] for v in (turned, known)]
    if min(part for halves in parts for part in halves) <= 0.0 or not scale.bounds[0].low > 0.0:
        return None
    small, large = (float(np.sqrt(r / t)) for t, r in zip(*parts, strict=True))
    noise = np.log1p(0.5 * (scale.bounds[0].high / scale.bounds[0].low - 1.0) * max(sum(p) / p[0] for p in parts)) / 2.0
    least = max(SCALE.steady, SCALE.steady_share * abs(np.log(scale.value))) if scale.off else SCALE.known
    return Halves(IN_SIZE, (small, large)) if abs(np.log(small / large)) > least + noise else None


def lost_of(sums: Array, when: Array) -> Lost | None:
    """The time from which on, or until which, an axis shows nothing of the attitude's turns; parts begin at `when`."""
    tt, tr, rr = sums
    alike, found = tr / np.sqrt(np.maximum(tt * rr, 1e-30)), []
    for k in range(SCALE.fewest_parts // 2, len(when) - SCALE.fewest_parts // 2 + 1):
        sides = [(alike[rows], tt[rows]) for rows in (slice(k), slice(k, None))]
        means = [(float(np.sum(c * w) / max(np.sum(w), 1e-30)), float(np.mean(w))) for c, w in sides]
        (seen, usual), (unseen, motion) = max(means), min(means)
        if motion > SCALE.similar * usual and seen > SCALE.shown and abs(unseen) < SCALE.unseen:
            found.append(Lost(float(when[k]), means[0][0], means[1][0]))
    return max(found, key=lambda lost: abs(lost.before - lost.after), default=None)
