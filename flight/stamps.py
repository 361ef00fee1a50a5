"""Order, gaps and pairs of time stamps."""

from __future__ import annotations

from bisect import bisect_left

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array, Gap

Stamps = NDArray[np.int64]

GAP_FACTOR = 2.5
"""An interval longer than this many usual periods is a gap."""


def nominal_period(time: Array) -> float:
    """Usual interval between samples [s]: the median, or the mean where samples arrive in bursts.

    The longest hundredth of the intervals does not count, so that gaps do not.
    """
    steps = np.diff(time)
    usual = steps[steps <= np.quantile(steps, 0.99)]
    return float(max(np.median(steps), np.mean(usual)))


def gaps_of(time: Array) -> tuple[Gap, ...]:
    """Intervals longer than `GAP_FACTOR` usual periods.

    Where more than a tenth of the intervals are long, as in bursts, long is usual.
    """
    if len(time) < 3:
        return ()
    steps = np.diff(time)
    usual = max(nominal_period(time), float(np.quantile(steps, 0.9)))
    return tuple(Gap(float(time[i]), float(time[i + 1])) for i in np.flatnonzero(steps > GAP_FACTOR * usual))


def jitter(time: Array) -> float:
    """Robust spread of the intervals between samples [s]: half of the central 68 %."""
    low, high = np.percentile(np.diff(time), [16, 84])
    return float(0.5 * (high - low))


def increasing(stamps: Stamps) -> tuple[NDArray[np.intp], dict[str, int]]:
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


def nearest(wanted: Stamps, stamps: Stamps) -> NDArray[np.intp]:
    """Index of the nearest of `stamps` to each of `wanted`."""
    right = np.clip(np.searchsorted(stamps, wanted), 1, len(stamps) - 1)
    return right - (wanted - stamps[right - 1] < stamps[right] - wanted)


def interpolated(time: Array, knots: Array, values: Array) -> Array:
    """Columns (K, C) at `knots` (K,), linear in between, at `time` (N,); held beyond the ends."""
    columns = [np.interp(time, knots, column) for column in values.T]
    return np.stack(columns, axis=1) if columns else np.zeros((len(time), 0))


def away_from_gaps(time: Array, margin: float = 0.3) -> NDArray[np.bool_]:
    """Samples at which a smoothed derivative means something."""
    inside = (time > time[0] + margin) & (time < time[-1] - margin)
    for gap in gaps_of(time):
        inside &= (time < gap.start - margin) | (time > gap.stop + margin)
    return inside if inside.sum() > 10 else np.ones(len(time), dtype=bool)
