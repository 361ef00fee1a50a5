"""In which frame a velocity, rate or acceleration of a log is told: asked of the pose, whose derivative it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from wrenchgap.flight.derivative import smooth
from wrenchgap.flight.flight import Array
from wrenchgap.flight.stamps import away_from_gaps, spread

COMPARED, RUN = 12_000, 4_000
"""Rows of a flight on which frames are told apart, and of each run of them."""

Rows = Callable[[slice], Array]
"""Some rows of a quantity."""
Slope = Callable[[Array, slice], Array]
"""A derivative at the times of some rows."""


def turned(values: Array, matrix: Array) -> Array:
    """Vectors (N, 3) in other axes; as they are where these are their own."""
    return values if np.array_equal(matrix, np.eye(3)) else np.asarray(values @ matrix.T)


def slope_of(values: Array) -> Slope:
    """The derivative of values (N, C) at the times of some of their rows."""
    return lambda time, rows: smooth(time, values[rows], derivative=1)


def fitting(readings: Mapping[str, Rows], truth: Slope, time: Array, default: str) -> tuple[str, dict[str, float]]:
    """The frame whose reading fits a derivative: `default` unless another is clearly better; and the rms misfits.

    Of a long flight, runs of rows that are spread over it are compared. `time` (N,) [s] is that of all rows.
    """
    squares: dict[str, list[float]] = {frame: [] for frame in readings}
    sizes: list[float] = []
    for rows in spread(len(time), COMPARED, RUN):
        part = time[rows]
        inside = away_from_gaps(part)
        expected = truth(part, rows)[inside]
        sizes.append(float(np.mean(expected**2)))
        for frame, values in readings.items():
            squares[frame].append(float(np.mean((smooth(part, values(rows))[inside] - expected) ** 2)))
    misfit = {frame: float(np.sqrt(np.mean(found))) for frame, found in squares.items()}
    best = min(misfit, key=lambda frame: misfit[frame])
    scale = float(np.sqrt(np.mean(sizes)))
    better = misfit[best] < 0.5 * misfit[default] and misfit[default] > 0.03 * scale
    return best if better else default, misfit
