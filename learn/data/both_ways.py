"""A second-order section forward and backward over many signals at once, compiled.

What scipy's `sosfiltfilt` computes, with all signals of a sample side by side in memory, so that the processor takes
them together: a search filters the same wrenches thousands of times. docs/decisions/0026-compiled-kernels.md
"""

from __future__ import annotations

import numpy as np
from numba import njit

from wrenchgap.flight.flight import Array


@njit(cache=True, nogil=True)
def both_ways(section: Array, start: Array, signal: Array, padding: int) -> Array:
    """`signal` (N, D) filtered by `section` (b0, b1, b2, 1, a1, a2) in both directions.

    Either end is continued by `padding` samples turned about it, and a pass begins in equilibrium: `start` (2,) is the
    state that a constant one leaves (scipy's `sosfilt_zi`). Source: Gustafsson, IEEE Trans. Signal Process. 44, 1996.
    """
    n, columns = signal.shape
    b0, b1, b2, a1, a2 = section[0], section[1], section[2], section[4], section[5]
    total = n + 2 * padding
    x = np.empty((total, columns))
    for k in range(padding):
        for d in range(columns):
            x[k, d] = 2.0 * signal[0, d] - signal[padding - k, d]
            x[padding + n + k, d] = 2.0 * signal[n - 1, d] - signal[n - 2 - k, d]
    x[padding : padding + n] = signal
    first, second = np.empty(columns), np.empty(columns)
    for turn in range(2):
        at = 0 if turn == 0 else total - 1
        step = 1 if turn == 0 else -1
        for d in range(columns):
            first[d], second[d] = start[0] * x[at, d], start[1] * x[at, d]
        for _ in range(total):
            for d in range(columns):
                value = x[at, d]
                out = b0 * value + first[d]
                first[d] = b1 * value - a1 * out + second[d]
                second[d] = b2 * value - a2 * out
                x[at, d] = out
            at += step
    return x[padding : padding + n].copy()
