"""A linear filter over many signals at once, compiled: what scipy's `lfilter` computes, without importing scipy.signal.

The import takes half a second, a tenth of what `wrenchgap learn` takes on two minutes of log. Direct form II,
transposed (Oppenheim and Schafer, Discrete-Time Signal Processing, 3rd ed., 6.3.4): with a_0 = 1 and K states s,

    y = b_0 x + s_1,        s_k <- b_k x - a_k y + s_{k+1},        s_{K+1} = 0

`scipy.signal.lfilter` is the specification, with which a test compares (docs/decisions/0026-compiled-kernels.md).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from wrenchgap.flight.flight import Array


def filtered(b: Array, a: Array, signal: Array, start: Array | None = None) -> Array:
    """`signal` (N, D) through sum b_k z^-k / sum a_k z^-k; `start` (K, D) are the states before, else zero."""
    order = max(len(b), len(a)) - 1
    coefficients = np.zeros((2, order + 1))
    coefficients[0, : len(b)], coefficients[1, : len(a)] = b, a
    numerator, denominator = coefficients / a[0]
    state = np.zeros((order, signal.shape[1])) if start is None else np.array(start, dtype=float)
    return np.asarray(_filtered(numerator, denominator, np.ascontiguousarray(signal, dtype=float), state))


@njit(cache=True, nogil=True)
def _filtered(b: Array, a: Array, signal: Array, state: Array) -> Array:
    """As `filtered`, both sets of coefficients (K + 1,) as long, a_0 = 1; `state` (K, D) is written to."""
    out, order = np.empty(signal.shape), len(state)
    for n in range(len(signal)):
        for d in range(signal.shape[1]):
            x = signal[n, d]
            y = b[0] * x + state[0, d]
            for k in range(order - 1):
                state[k, d] = b[k + 1] * x - a[k + 1] * y + state[k + 1, d]
            state[order - 1, d] = b[order] * x - a[order] * y
            out[n, d] = y
    return out
