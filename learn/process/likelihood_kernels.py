"""Covariances of a squared-exponential kernel and the sums of a likelihood's gradient, one triangle of them, compiled.

A search asks for a thousand likelihoods of some hundred samples. Numpy makes a dozen arrays of N x N for each, in which
every pair of samples is twice; here each pair is once, and pairs lie row by row: (1, 0), (2, 0), (2, 1), (3, 0), ...
`learn.process.likelihood.LogLikelihood` has the equations (docs/decisions/0026-compiled-kernels.md).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from wrenchgap.flight.flight import Array

FAST = {"reassoc", "contract"}


@njit(cache=True, nogil=True, fastmath=FAST)
def exponents(q: Array, pairs: Array) -> None:
    """-1/2 |q_i - q_j|^2 into `pairs` (N (N - 1) / 2,), of samples over lengthscales q (D, N)."""
    dims, count = q.shape
    first = 0
    for i in range(1, count):
        row = pairs[first : first + i]
        row[:] = 0.0
        for d in range(dims):
            here, others = q[d, i], q[d]
            for j in range(len(row)):
                apart = here - others[j]
                row[j] += apart * apart
        for j in range(len(row)):
            row[j] *= -0.5
        first += i


@njit(cache=True, nogil=True)
def lower(pairs: Array, variance: float, noise: float, C: Array) -> None:
    """The lower triangle of C (N, N), the covariance: `variance` times `pairs`, and on the diagonal both variances."""
    first = 0
    for i in range(len(C)):
        into, row = C[i], pairs[first : first + i]
        for j in range(len(row)):
            into[j] = variance * row[j]
        into[i] = variance + noise
        first += i


@njit(cache=True, nogil=True, fastmath=FAST)
def slopes(q: Array, pairs: Array, inverse: Array, a: Array) -> Array:
    """Sums (D + 2,) over W_ij = 1/2 (a_i a_j - C^-1_ij) k_ij, k = `pairs` off the diagonal and one on it.

    First of W itself, then of W (q_id - q_jd)^2, last the trace of 1/2 (a a^T - C^-1); of the `inverse` (N, N) the
    lower triangle counts. `pairs` are overwritten.
    """
    dims, count = q.shape
    sums = np.zeros(dims + 2)
    first = 0
    for i in range(count):
        row, known, own = pairs[first : first + i], inverse[i], a[i]
        total = 0.0
        for j in range(len(row)):
            row[j] *= own * a[j] - known[j]
            total += row[j]
        half = 0.5 * (own * own - known[i])
        sums[0] += total + half
        sums[dims + 1] += half
        for d in range(dims):
            here, others = q[d, i], q[d]
            part = 0.0
            for j in range(len(row)):
                apart = here - others[j]
                part += row[j] * (apart * apart)
            sums[d + 1] += part
        first += i
    return sums
