"""Order, gaps and pairs of time stamps, and what of a long series is worked on or shown."""

import weakref
from bisect import bisect_left
from collections import deque
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wrenchgap.flight.flight import Array, Gap, Indices, Mask, Stamps

MANY = 4096
"""Stamps from which on it is worth looking whether others like them were sorted before."""

SILENT = 60.0
"""An interval [s] from which on it is a gap and never usual, however few samples there are: a clock was set, or the
recorder slept. Nothing that plays a role is slower than once a minute."""


@dataclass(frozen=True)
class _Usual:
    """Intervals [s], but for the longest only those below `SILENT` if there are any: the median, the mean without the
    longest hundredth, half of the central 68 %, the ninth tenth, the longest.
    """  # noqa: D205

    median: float
    mean: float
    jitter: float
    long: float
    longest: float


def _usual(time: Array) -> _Usual:
    ordered = np.sort(np.diff(time))
    longest = float(ordered[-1])
    ordered = ordered[: np.searchsorted(ordered, SILENT) or None]

    def quantile(share: float) -> float:
        """Straight between neighbours, as numpy's."""
        place = share * (len(ordered) - 1)
        low = int(place)
        high = min(low + 1, len(ordered) - 1)
        return float(ordered[low] + (place - low) * (ordered[high] - ordered[low]))

    mean = float(np.mean(ordered[: np.searchsorted(ordered, quantile(0.99), side="right")]))
    return _Usual(quantile(0.5), mean, 0.5 * (quantile(0.84) - quantile(0.16)), quantile(0.9), longest)


_known: deque[tuple[weakref.ref[Array], _Usual]] = deque(maxlen=8)
"""Stamps that were looked at last, while somebody holds them; nobody changes an array that he was given."""


def _same(one: Array, other: Array) -> bool:
    return len(one) == len(other) and one[-1] == other[-1] and one[0] == other[0] and np.array_equal(one, other)


@dataclass(frozen=True)
class Steps:
    """What the intervals between samples at `time` (N,) [s] are like; sorted once for all that is asked."""

    time: Array
    gap_factor: float = 2.5

    @cached_property
    def _usual(self) -> _Usual:
        """Sorted once for all series at the same stamps: many topics of a log are, and each is asked several times."""
        if len(self.time) < MANY:
            return _usual(self.time)
        for reference, found in tuple(_known):
            known = reference()
            if known is not None and (known is self.time or _same(known, self.time)):
                return found
        found = _usual(self.time)
        _known.appendleft((weakref.ref(self.time), found))
        return found

    @property
    def nominal_period(self) -> float:
        """Usual interval [s]: the median, or the mean where samples arrive in bursts.

        The longest hundredth of the intervals does not count, so that gaps do not.
        """
        return max(self._usual.median, self._usual.mean)

    @property
    def jitter(self) -> float:
        """Robust spread of the intervals [s]: half of the central 68 %."""
        return self._usual.jitter

    @property
    def burst(self) -> float:
        """Interval [s] between bursts of samples, where these arrive so; else zero.

        A tenth of the intervals is then longer than what would be a gap of samples that come one by one.
        """
        long = self._usual.long
        return long if long > self.gap_factor * self.nominal_period else 0.0

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Intervals longer than `gap_factor` usual periods, or than `SILENT`.

        Where more than a tenth of the intervals are long, as in bursts, long is usual.
        """
        if len(self.time) < 2:
            return ()
        longest = min(self.gap_factor * max(self.nominal_period, self._usual.long), SILENT)
        if not self._usual.longest > longest:
            return ()
        found = np.flatnonzero(np.diff(self.time) > longest)
        return tuple(Gap(float(self.time[i]), float(self.time[i + 1])) for i in found)


def nominal_period(time: Array) -> float:
    """Usual interval between samples [s]: `Steps.nominal_period`."""
    return Steps(time).nominal_period


def gaps_of(time: Array) -> tuple[Gap, ...]:
    """Intervals that are too long to be bridged: `Steps.gaps`."""
    return Steps(time).gaps


def increasing(stamps: Stamps) -> tuple[Indices, dict[str, int]]:
    """Indices of the longest strictly increasing choice of stamps, and how many others there are and why.

    One wrong stamp in the future costs one sample, not all that follow.
    """
    if np.all(np.diff(stamps) > 0):
        return np.arange(len(stamps)), {}
    tails: list[int] = []
    last: list[int] = []
    before = np.full(len(stamps), -1)
    for i, stamp in enumerate(stamps.tolist()):
        place = bisect_left(tails, stamp)
        before[i] = last[place - 1] if place else -1
        if place == len(tails):
            tails.append(stamp)
            last.append(i)
        else:
            tails[place], last[place] = stamp, i
    chain = []
    at = last[-1]
    while at >= 0:
        chain.append(at)
        at = int(before[at])
    keep = np.array(chain[::-1], dtype=np.intp)
    others = np.delete(stamps, keep)
    duplicates = int(np.isin(others, stamps[keep]).sum())
    return keep, {"duplicate stamp": duplicates, "stamp not increasing": len(others) - duplicates}


def nearest(wanted: Stamps, stamps: Stamps) -> Indices:
    """Index of the nearest of `stamps` to each of `wanted`."""
    right = np.clip(np.searchsorted(stamps, wanted), 1, len(stamps) - 1)
    return right - (wanted - stamps[right - 1] < stamps[right] - wanted)


def interpolated(time: Array, knots: Array, values: Array) -> Array:
    """Columns (K, C) at `knots` (K,), linear in between, at `time` (N,); held beyond the ends."""
    if not len(knots):
        raise ValueError("nothing to interpolate")
    out = np.empty((len(time), values.shape[1]))
    for k, column in enumerate(values.T):
        out[:, k] = np.interp(time, knots, column)
    return out


PIECE = 1 << 17
"""Rows of hours of log that are worked on at a time where row by row will do: what lies in between stays small."""


def pieces(count: int) -> list[slice]:
    """`PIECE` rows each, the last one less; one piece of no row where there is none."""
    return [slice(start, min(start + PIECE, count)) for start in range(0, max(count, 1), PIECE)]


def spread(count: int, most: int, run: int) -> list[slice]:
    """Runs of `run` rows, evenly spread over `count`, in which some `most` rows lie; all of them where that is enough.

    What is asked of a flight as a whole is answered by a part of hours of it.
    """
    runs = max(most // run, 1)
    if count <= most or count <= runs * run:
        return [slice(0, count)]
    return [slice(start, start + run) for start in np.linspace(0, count - run, runs).astype(int).tolist()]


def thinned(count: int, most: int) -> slice | Indices:
    """At most `most` of `count` rows, evenly spread."""
    return slice(None) if count <= most else np.linspace(0, count - 1, most).astype(np.intp)


def away_from_gaps(time: Array, margin: float = 0.3) -> Mask:
    """Samples at which a smoothed derivative means something."""
    inside = (time > time[0] + margin) & (time < time[-1] - margin)
    for gap in gaps_of(time):
        inside &= (time < gap.start - margin) | (time > gap.stop + margin)
    return inside if inside.sum() > 10 else np.ones(len(time), dtype=bool)


def envelope(time: Array, values: Array, start: float, stop: float, bins: int = 450) -> tuple[Array, Array]:
    """Lines (C, N) over `time` (N,) between `start` and `stop`, as at most 2 bins + 2 points: (M,), (C, M).

    So that a long series fits a narrow plot and no peak is lost; `bins` is about the pixels of its width.

    Where there are more samples than that, every bin of equal length gives each line's smallest and largest value, in
    the order in which they came; the times of the two are those of a third and two thirds of the bin. A bin without
    samples gives nothing. One sample on either side of the range is kept, so that lines reach the edges.
    """
    first = max(int(np.searchsorted(time, start)) - 1, 0)
    last = min(int(np.searchsorted(time, stop, side="right")) + 1, len(time))
    time, values = time[first:last], values[:, first:last]
    if len(time) <= 2 * bins:
        return time, values
    edges = np.linspace(time[0], time[-1], bins + 1)
    begins = np.searchsorted(time, edges[:-1])
    ends = np.append(begins[1:], len(time))
    filled = ends > begins
    begins, ends, left = begins[filled], ends[filled], edges[:-1][filled]
    low = np.fmin.reduceat(values, begins, axis=1)
    high = np.fmax.reduceat(values, begins, axis=1)
    rising = values[:, begins] <= values[:, ends - 1]
    width = float(edges[1] - edges[0])
    x = np.stack((left + width / 3.0, left + 2.0 * width / 3.0), axis=1).ravel()
    y = np.stack((np.where(rising, low, high), np.where(rising, high, low)), axis=2).reshape(len(values), -1)
    return x, y
