"""Fourier integrals of tapered blocks of samples that lie where they are, compiled; the plain form stands beside it.

Two thirds of `inspect` were spent here, in some ten numpy calls for every frequency of every block
(docs/decisions/0030-messages-where-they-lie.md). Tests compare the two forms (tests/flight/test_timing.py).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array

Complex = NDArray[np.complex128]

FEWEST = 8
"""Samples of a block below which its integrals are zero."""


def plain_integrals(time: Array, values: Array, starts: Array, length: float, lowest: int, count: int) -> Complex:
    """Fourier integrals (B, C, F) of the blocks of `length` [s] that begin at `starts` (B,), over the samples in each.

    `values` (N, C) at `time` (N,); F = `count` harmonics of the block from `lowest` on. A block is tapered by Hann's
    window after its weighted straight line was taken out, and summed by the trapezoid rule over its own stamps.
    """
    out = np.zeros((len(starts), values.shape[1], count), dtype=complex)
    first, last = np.searchsorted(time, starts), np.searchsorted(time, starts + length)
    for b, (start, i, j) in enumerate(zip(starts, first, last, strict=True)):
        if j - i < FEWEST:
            continue
        x = (time[i:j] - start) / length
        weight = np.sin(np.pi * x) ** 2 * np.gradient(x)
        tapered = without_trend(x, values[i:j], weight) * weight[:, None]
        turn = np.exp(-2j * np.pi * x)
        wave = turn**lowest
        for k in range(count):
            out[b, :, k] = wave @ tapered
            wave = wave * turn
    return out


def without_trend(x: Array, values: Array, weight: Array) -> Array:
    """Values (n, C) less their weighted straight line over x.

    With the taper as weight: samples at the ends, of which the one topic has more than the other, then do not tilt it.
    """
    share = weight / weight.sum()
    lever = x - share @ x
    mean = share @ values
    slope = (share * lever) @ values / float((share * lever) @ lever)
    return np.asarray(values - mean - np.outer(lever, slope))


@njit(cache=True)
def _tapered(time: Array, values: Array, start: float, length: float, x: Array, tapered: Array) -> None:
    """Times `x` (n,) in the block and values `tapered` (C, n), their line taken out."""
    n, columns = values.shape
    weight, total, middle = np.empty(n), 0.0, 0.0
    for i in range(n):
        x[i] = (time[i] - start) / length
    for i in range(n):
        low, high = max(i - 1, 0), min(i + 1, n - 1)
        weight[i] = np.sin(np.pi * x[i]) ** 2 * (x[high] - x[low]) / (high - low)
        total += weight[i]
        middle += weight[i] * x[i]
    middle /= total
    spread = 0.0
    for i in range(n):
        spread += weight[i] / total * (x[i] - middle) ** 2
    for c in range(columns):
        mean, slope = 0.0, 0.0
        for i in range(n):
            share = weight[i] / total * values[i, c]
            mean += share
            slope += share * (x[i] - middle)
        slope /= spread
        for i in range(n):
            tapered[c, i] = (values[i, c] - mean - slope * (x[i] - middle)) * weight[i]


@njit(cache=True, fastmath={"reassoc", "contract"})
def _sums(x: Array, tapered: Array, lowest: int, out: Complex) -> None:
    """Sums over the samples, harmonic by harmonic (C, F); the wave of one is the last one's turned on."""
    n = len(x)
    turn_re, turn_im, wave_re, wave_im = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        angle = -2.0 * np.pi * x[i]
        turn_re[i], turn_im[i] = np.cos(angle), np.sin(angle)
        wave_re[i], wave_im[i] = np.cos(lowest * angle), np.sin(lowest * angle)
    for k in range(out.shape[1]):
        for c in range(len(tapered)):
            re, im = 0.0, 0.0
            row = tapered[c]
            for i in range(n):
                re += wave_re[i] * row[i]
                im += wave_im[i] * row[i]
            out[c, k] = complex(re, im)
        for i in range(n):
            re = wave_re[i] * turn_re[i] - wave_im[i] * turn_im[i]
            wave_im[i] = wave_re[i] * turn_im[i] + wave_im[i] * turn_re[i]
            wave_re[i] = re


@njit(cache=True)
def _integrals(
    time: Array,
    values: Array,
    starts: Array,
    first: NDArray[np.intp],
    last: NDArray[np.intp],
    length: float,
    lowest: int,
    out: Complex,
) -> None:
    columns = values.shape[1]
    for b in range(len(starts)):
        i, j = first[b], last[b]
        if j - i >= FEWEST:
            x, tapered = np.empty(j - i), np.empty((columns, j - i))
            _tapered(time[i:j], values[i:j], starts[b], length, x, tapered)
            _sums(x, tapered, lowest, out[b])


def integrals(time: Array, values: Array, starts: Array, length: float, lowest: int, count: int) -> Complex:
    """As `plain_integrals`; up to rounding, since sums are taken in another order."""
    out = np.zeros((len(starts), values.shape[1], count), dtype=complex)
    first, last = np.searchsorted(time, starts), np.searchsorted(time, starts + length)
    t, v, s = (np.ascontiguousarray(a, dtype=float) for a in (time, values, starts))
    _integrals(t, v, s, first, last, float(length), int(lowest), out)
    return out
