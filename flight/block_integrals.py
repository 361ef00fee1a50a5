"""Fourier integrals of tapered blocks of samples that lie where they are, compiled.

Two thirds of `inspect` were spent here, in some ten numpy calls for every frequency of every block
(docs/decisions/0030-messages-where-they-lie.md).
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array, Indices

Complex = NDArray[np.complex128]

FEWEST = 8
"""Samples of a block below which its integrals are zero."""


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _tapered(x: Array, weight: Array, values: Array) -> Array:
    """Values (C, n) at places `x` (n,) in the block, their line taken out, by their weights in the sums; those are the
    window's, and become the rule's.
    """  # noqa: D205
    n, columns = values.shape
    weight[0] *= x[1] - x[0]
    weight[n - 1] *= x[n - 1] - x[n - 2]
    for i in range(1, n - 1):
        weight[i] *= 0.5 * (x[i + 1] - x[i - 1])
    total = np.sum(weight)
    middle, spread = np.dot(weight, x) / total, 0.0
    for i in range(n):
        spread += weight[i] * (x[i] - middle) ** 2
    tapered = np.empty((columns, n))
    for c in range(columns):
        mean, slope = 0.0, 0.0
        for i in range(n):
            mean += weight[i] * values[i, c] / total
            slope += weight[i] * values[i, c] * (x[i] - middle) / spread
        for i in range(n):
            tapered[c, i] = weight[i] * (values[i, c] - mean - slope * (x[i] - middle))
    return tapered


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _sums(cosine: Array, sine: Array, tapered: Array, lowest: int, out: Complex) -> None:
    """Sums (C, F) over the samples of what a wave is at each, harmonic by harmonic from `lowest` on."""
    re, im = np.ones(len(cosine)), np.zeros(len(cosine))
    for k in range(-lowest, out.shape[1]):
        if k >= 0:
            for c in range(len(tapered)):
                column, sum_re, sum_im = tapered[c], 0.0, 0.0
                for i in range(len(re)):
                    sum_re += re[i] * column[i]
                    sum_im += im[i] * column[i]
                out[c, k] = complex(sum_re, sum_im)
        for i in range(len(re)):
            re[i], im[i] = re[i] * cosine[i] - im[i] * sine[i], re[i] * sine[i] + im[i] * cosine[i]


@njit(cache=True, nogil=True)
def _integrals(
    time: Array,
    values: Array,
    starts: Array,
    bounds: tuple[Indices, Indices],
    length: float,
    lowest: int,
    out: Complex,
) -> None:
    for b in range(len(starts)):
        i, j = bounds[0][b], bounds[1][b]
        if j - i >= FEWEST:
            n = j - i
            x, hann, cosine, sine = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
            for k in range(n):
                x[k] = (time[i + k] - starts[b]) / length
                cosine[k], sine[k] = np.cos(2.0 * np.pi * x[k]), -np.sin(2.0 * np.pi * x[k])
                hann[k] = 0.5 - 0.5 * cosine[k]
            tapered = _tapered(x, hann, values[i:j])
            _sums(cosine, sine, tapered, lowest, out[b])


def integrals(time: Array, values: Array, starts: Array, length: float, lowest: int, count: int) -> Complex:
    """Fourier integrals (B, C, F) of the blocks of `length` [s] that begin at `starts` (B,), over the samples in each.

    `values` (N, C) at `time` (N,); F = `count` harmonics of the block from `lowest` on. A block is tapered by Hann's
    window after its weighted straight line was taken out, and summed by the trapezoid rule over its own stamps. With
    the taper as weight, samples at the ends, of which the one topic has more than the other, do not tilt the line.
    """
    out = np.zeros((len(starts), values.shape[1], count), dtype=complex)
    bounds = np.searchsorted(time, starts), np.searchsorted(time, starts + length)
    t, v, s = (np.ascontiguousarray(a, dtype=float) for a in (time, values, starts))
    _integrals(t, v, s, bounds, float(length), int(lowest), out)
    return out
