"""Long series for narrow plots: two points per pixel column, so that no peak is lost."""

from __future__ import annotations

import numpy as np

from wrenchgap.flight.flight import Array

BINS = 450
"""Columns of a plot that are told apart, about the pixels of its width."""


def envelope(time: Array, values: Array, start: float, stop: float, bins: int = BINS) -> tuple[Array, Array]:
    """Lines (C, N) over `time` (N,) between `start` and `stop`, as at most 2 bins + 2 points: (M,), (C, M).

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
