"""Values of one topic at the stamps of another, for formats that spread one quantity over several topics.

Nothing is bridged: beyond the ends of the source, and inside its gaps, the value is NaN. A source that is faster than
what asks is averaged over the interval between the stamps, so that nothing above half the new rate is folded down.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array

Stamps = NDArray[np.int64]

GAP = 4.0  # usual periods of the source, longer than for a series of its own: autopilots thin their topics unevenly
FASTER = 1.5  # times the rate of what asks, from which on the source is averaged


def increasing_rows(stamps: Stamps, values: Array) -> tuple[Stamps, Array]:
    """The rows that are finite and later than all before."""
    keep = np.isfinite(values).all(axis=1)
    stamps, values = stamps[keep], values[keep]
    if not len(stamps):
        return stamps, values
    later = np.concatenate(([True], stamps[1:] > np.maximum.accumulate(stamps)[:-1]))
    return stamps[later], values[later]


def at(wanted: Stamps, stamps: Stamps, values: Array) -> Array:
    """`values` (K, C) at `stamps` (K,) [ns], at the `wanted` (N,) ones: (N, C), NaN where the source has none."""
    stamps, values = increasing_rows(stamps, values)
    if len(stamps) < 2:
        return np.full((len(wanted), values.shape[1]), np.nan)
    origin = int(stamps[0])
    time, asked = _seconds(stamps, origin), _seconds(wanted, origin)
    usual = _usual(time)
    period = _usual(np.sort(asked)) if len(asked) > 1 else 0.0
    interpolate = _averaged if period > FASTER * usual else _linear
    out = interpolate(asked, time, values, period)
    out[outside(asked, time, usual)] = np.nan
    return out


def outside(asked: Array, time: Array, usual: float) -> NDArray[np.bool_]:
    """Where `asked` lies beyond the ends of `time`, or inside a gap of it."""
    right = np.clip(np.searchsorted(time, asked), 1, len(time) - 1)
    step = time[right] - time[right - 1]
    inside = (asked > time[right - 1]) & (asked < time[right])
    beyond = (asked < time[0] - 1e-6) | (asked > time[-1] + 1e-6)
    return np.asarray(beyond | (inside & (step > GAP * usual)))


def cubic(wanted: Stamps, stamps: Stamps, values: Array, rates: Array) -> Array:
    """As `at`, of values whose `rates` (K, C) [1/s] are known too: cubics that have both at every sample.

    Where value and rate contradict each other by more than the motion within an interval, the line between them.
    """
    stamps, both = increasing_rows(stamps, np.hstack((values, rates)))
    count = values.shape[1]
    if len(stamps) < 2:
        return np.full((len(wanted), count), np.nan)
    x, v = both[:, :count], both[:, count:]
    time, asked = _seconds(stamps, int(stamps[0])), _seconds(wanted, int(stamps[0]))
    right = np.clip(np.searchsorted(time, asked), 1, len(time) - 1)
    left = right - 1
    h = (time[right] - time[left])[:, None]
    s = np.clip((asked - time[left])[:, None] / h, 0.0, 1.0)
    chord = x[right] - x[left]
    tangents = h * v[left], h * v[right]
    fair = np.abs(chord - 0.5 * (tangents[0] + tangents[1])) <= 0.05 + 0.5 * np.abs(chord)
    bend = (1 - s) * s * ((1 - s) * (tangents[0] - chord) - s * (tangents[1] - chord))
    out = np.asarray(x[left] + s * chord + np.where(fair, bend, 0.0))
    out[outside(asked, time, _usual(time))] = np.nan
    return out


def _seconds(stamps: Stamps, origin: int) -> Array:
    return np.asarray((stamps - origin) * 1e-9, dtype=float)


def _usual(time: Array) -> float:
    return max(float(np.median(np.diff(time))), 1e-9)


def _linear(asked: Array, time: Array, values: Array, period: float) -> Array:
    return np.stack([np.interp(asked, time, column) for column in values.T], axis=1)


def _averaged(asked: Array, time: Array, values: Array, period: float) -> Array:
    """Means over `period` around each stamp, of what is linear between the samples: differences of its integral."""
    low, high = (np.clip(asked + side * period / 2, time[0], time[-1]) for side in (-1, 1))
    width = np.maximum(high - low, 1e-9)
    return np.stack([(_integral(high, time, v) - _integral(low, time, v)) / width for v in values.T], axis=1)


def _integral(asked: Array, time: Array, values: Array) -> Array:
    """Integral from the first sample to `asked`."""
    steps = np.diff(time)
    whole = np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * steps)))
    left = np.clip(np.searchsorted(time, asked, side="right") - 1, 0, len(steps) - 1)
    into = asked - time[left]
    slope = (values[left + 1] - values[left]) / steps[left]
    return np.asarray(whole[left] + into * (values[left] + 0.5 * slope * into))
