"""The first-order lag and the delay that the command effects share.

A sequence of samples stands for a signal that is linear between them. For dy/dt = (u - y)/tau the samples then obey
exactly

    y[k] = a y[k-1] + b_0 u[k-1] + b_1 u[k],    a = exp(-dt/tau),  q = (1 - a) tau/dt,  b_0 = q - a,  b_1 = 1 - q

(first-order hold; Astrom and Wittenmark, "Computer-Controlled Systems", 3rd ed., 8.3). The memory (u, y) makes N calls
with one sample the same as one call with N.
"""

import numpy as np

from wrenchgap.flight.filters import filtered
from wrenchgap.flight.flight import Array

LagMemory = tuple[Array, Array]


def first_order(signal: Array, tau: float | Array, dt: float, memory: LagMemory | None) -> tuple[Array, LagMemory]:
    """Lagged samples (N, D) of `signal` (N, D), starting in equilibrium where there is no memory.

    `tau` [s] is that of all columns, or of each (D,); none lags where it is zero.
    """
    before, state = (signal[0], signal[0]) if memory is None else memory
    late = np.maximum(np.squeeze(tau), 0.0)
    a = np.exp(-dt / np.maximum(late, 1e-300))
    q = (1.0 - a) * late / dt
    b0, b1 = q - a, 1.0 - q
    start = (a * state + b0 * before)[None]
    if len(signal) == 1:
        out = start + b1 * signal
    elif a.ndim == 0:
        out = filtered(np.array([b1, b0]), np.array([1.0, -a]), signal, start)
    else:
        each = [(np.array([b1[k], b0[k]]), np.array([1.0, -a[k]]), slice(k, k + 1)) for k in range(len(a))]
        out = np.hstack([filtered(b, ones, signal[:, k], start[:, k]) for b, ones, k in each])
    return out, (signal[-1], out[-1])


def delay(signal: Array, seconds: float, dt: float, memory: Array | None) -> tuple[Array, Array]:
    """Samples (N, D) of `signal` as they were `seconds` ago, linear in between; the first sample came before."""
    if seconds <= 0.0:
        return signal, signal[-1:]
    steps = int(np.ceil(seconds / dt)) + 1
    past = np.repeat(signal[:1], steps, axis=0) if memory is None else memory
    if len(past) < steps:
        past = np.vstack((np.repeat(past[:1], steps - len(past), axis=0), past))
    joined = np.vstack((past, signal))
    whole = int(np.floor(seconds / dt))
    part = seconds / dt - whole
    first = len(past) - whole
    late = joined[first : first + len(signal)]
    later = joined[first - 1 : first - 1 + len(signal)]
    return (1.0 - part) * late + part * later, joined[-steps:]
