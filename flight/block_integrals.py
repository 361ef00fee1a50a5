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


_FACTORIALS = np.cumprod(np.concatenate(([1.0], np.arange(1.0, 26.0))))
_SINE = np.array([(-1) ** k * np.pi ** (2 * k + 1) / _FACTORIALS[2 * k + 1] for k in range(12)])
_COSINE = np.array([(-1) ** k * np.pi ** (2 * k) / _FACTORIALS[2 * k] for k in range(12)])
"""Of sin(pi y) / y and cos(pi y) in powers of y^2: exact to rounding for |y| <= 1/2, and without a branch."""


@njit(cache=True, nogil=True, fastmath={"contract"})
def _waves(x: Array, hann: Array, turn_re: Array, turn_im: Array) -> None:
    """Hann's window sin^2(pi x) and exp(-2 pi i x) at places `x` (n,) in [0, 1]."""
    for i in range(len(x)):
        y = x[i] - 0.5
        square = y * y
        sine, cosine = _SINE[11], _COSINE[11]
        for k in range(10, -1, -1):
            sine = sine * square + _SINE[k]
            cosine = cosine * square + _COSINE[k]
        sine *= y
        hann[i] = cosine * cosine
        turn_re[i] = 2.0 * sine * sine - 1.0
        turn_im[i] = 2.0 * sine * cosine


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _tapered(x: Array, values: Array, hann: Array, tapered: Array) -> None:
    """Values `tapered` (C, n) at places `x` (n,) in the block, their line taken out."""
    n, columns = values.shape
    weight, total, middle, spread = hann.copy(), 0.0, 0.0, 0.0
    weight[0] *= x[1] - x[0]
    weight[n - 1] *= x[n - 1] - x[n - 2]
    for i in range(1, n - 1):
        weight[i] *= 0.5 * (x[i + 1] - x[i - 1])
    for i in range(n):
        total += weight[i]
        middle += weight[i] * x[i]
    middle /= total
    for i in range(n):
        spread += weight[i] * (x[i] - middle) ** 2
    for c in range(columns):
        row, mean, slope = tapered[c], 0.0, 0.0
        for i in range(n):
            row[i] = values[i, c]
        for i in range(n):
            mean += weight[i] * row[i]
            slope += weight[i] * row[i] * (x[i] - middle)
        mean /= total
        slope /= spread
        for i in range(n):
            row[i] = (row[i] - mean - slope * (x[i] - middle)) * weight[i]


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _turned(wave_re: Array, wave_im: Array, turn_re: Array, turn_im: Array) -> None:
    """The wave of the next harmonic, in the place of the last one."""
    for i in range(len(wave_re)):
        re = wave_re[i] * turn_re[i] - wave_im[i] * turn_im[i]
        wave_im[i] = wave_re[i] * turn_im[i] + wave_im[i] * turn_re[i]
        wave_re[i] = re


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _sums(turn_re: Array, turn_im: Array, tapered: Array, lowest: int, out: Complex) -> None:
    """Sums over the samples, harmonic by harmonic (C, F); vectors go together, so that a wave is fetched once for three
    columns.
    """  # noqa: D205
    n, columns = len(turn_re), len(tapered)
    threes = columns - columns % 3
    wave_re, wave_im = turn_re.copy(), turn_im.copy()
    for _ in range(1, lowest):
        _turned(wave_re, wave_im, turn_re, turn_im)
    for k in range(out.shape[1]):
        for c in range(0, threes, 3):
            x, y, z = tapered[c], tapered[c + 1], tapered[c + 2]
            x_re, x_im, y_re, y_im, z_re, z_im = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(n):
                re, im = wave_re[i], wave_im[i]
                x_re += re * x[i]
                y_re += re * y[i]
                z_re += re * z[i]
                x_im += im * x[i]
                y_im += im * y[i]
                z_im += im * z[i]
            out[c, k], out[c + 1, k], out[c + 2, k] = complex(x_re, x_im), complex(y_re, y_im), complex(z_re, z_im)
        for c in range(threes, columns):
            x, x_re, x_im = tapered[c], 0.0, 0.0
            for i in range(n):
                x_re += wave_re[i] * x[i]
                x_im += wave_im[i] * x[i]
            out[c, k] = complex(x_re, x_im)
        _turned(wave_re, wave_im, turn_re, turn_im)


@njit(cache=True, nogil=True)
def _integrals(
    time: Array,
    values: Array,
    starts: Array,
    first: Indices,
    last: Indices,
    length: float,
    lowest: int,
    out: Complex,
) -> None:
    columns = values.shape[1]
    for b in range(len(starts)):
        i, j = first[b], last[b]
        if j - i >= FEWEST:
            n = j - i
            x, hann, turn_re, turn_im = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
            tapered = np.empty((columns, n))
            for k in range(n):
                x[k] = (time[i + k] - starts[b]) / length
            _waves(x, hann, turn_re, turn_im)
            _tapered(x, values[i:j], hann, tapered)
            _sums(turn_re, turn_im, tapered, lowest, out[b])


def integrals(time: Array, values: Array, starts: Array, length: float, lowest: int, count: int) -> Complex:
    """Fourier integrals (B, C, F) of the blocks of `length` [s] that begin at `starts` (B,), over the samples in each.

    `values` (N, C) at `time` (N,); F = `count` harmonics of the block from `lowest` on. A block is tapered by Hann's
    window after its weighted straight line was taken out, and summed by the trapezoid rule over its own stamps. With
    the taper as weight, samples at the ends, of which the one topic has more than the other, do not tilt the line.
    """
    out = np.zeros((len(starts), values.shape[1], count), dtype=complex)
    first, last = np.searchsorted(time, starts), np.searchsorted(time, starts + length)
    t, v, s = (np.ascontiguousarray(a, dtype=float) for a in (time, values, starts))
    _integrals(t, v, s, first, last, float(length), int(lowest), out)
    return out
