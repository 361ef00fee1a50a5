"""Linear filters over many signals at once, in closed form and compiled.

Low-passes in one direction or in both; derivatives of sampled, noisy signals by local cubic fits without phase
(Savitzky and Golay, 1964). Each computes what a function of scipy.signal does, which a test compares
(docs/decisions/0026-compiled-kernels.md). Importing scipy.signal takes half a second: a tenth of what `wrenchgap learn`
takes on two minutes of log, a third of the time in which `wrenchgap inspect` or the page is there. Forward and
backward, all signals of a sample lie side by side in memory, so that the processor takes them together: a search
filters the same wrenches thousands of times.
"""

from functools import lru_cache

import numpy as np
from numba import njit

from wrenchgap.flight import row_kernels, so3
from wrenchgap.flight.block_integrals import Complex
from wrenchgap.flight.flight import Array


def filtered(b: Array, a: Array, signal: Array, start: Array | None = None) -> Array:
    """`signal` (N, D) through sum b_k z^-k / sum a_k z^-k; `start` (K, D) are the states before, else zero.

    Direct form II, transposed (Oppenheim and Schafer, Discrete-Time Signal Processing, 3rd ed., 6.3.4): with a_0 = 1,

        y = b_0 x + s_1,        s_k <- b_k x - a_k y + s_{k+1},        s_{K+1} = 0
    """
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


def butterworth(cutoff_hz: float, rate: float) -> Array:
    """Numerator and denominator (6,) of a second-order low-pass at `rate` [Hz], -3 dB at the cut-off.

    Poles at 45 deg of the half circle, of a cut-off that the bilinear transform bends back to where it is wanted.
    """
    bent = 4.0 * np.tan(np.pi * (2.0 * cutoff_hz / rate) / 2.0)
    poles = bent * -np.exp(1j * np.pi * np.array([-1.0, 1.0]) / 4.0)
    gain = bent**2 * np.real(1.0 / np.prod(4.0 - poles))
    first, second = (4.0 + poles) / (4.0 - poles)
    return np.concatenate((gain * np.array([1.0, 2.0, 1.0]), [1.0, -(first + second).real, (first * second).real]))


def steady_state(section: Array) -> Array:
    """State (2,) that a constant input of one leaves in the transposed direct form II of a section (6,)."""
    b, a = section[:3], section[3:]
    moves = np.array([[1.0 + a[1], -1.0], [a[2], 1.0]])
    return np.asarray(np.linalg.solve(moves, b[1:] - a[1:] * b[0]))


@lru_cache(maxsize=16)
def low_pass_section(dt: float, cutoff_hz: float) -> tuple[Array, Array]:
    """The section (6,) of a low-pass for samples every `dt` [s], and its `steady_state` (2,)."""
    section = butterworth(cutoff_hz, 1.0 / dt)
    return section, steady_state(section)


def response(section: Array, frequency: Array, rate: float) -> Complex:
    """Of a section (6,) at `frequency` (F,) [Hz]."""
    back = np.exp(-1j * (2.0 * np.pi * frequency / rate))
    top, bottom = ((c + back * (b + back * a)) for c, b, a in (section[:3], section[3:]))
    return np.asarray(top / bottom)


def hann(count: int) -> Array:
    """The periodic window of Hann (count,): one period of a raised cosine."""
    return np.asarray(0.5 + 0.5 * np.cos(np.linspace(-np.pi, np.pi, count + 1)[:-1]))


@njit(cache=True, nogil=True)
def forward_backward(section: Array, start: Array, signal: Array, padding: int) -> Array:
    """`signal` (N, D) filtered by `section` (b0, b1, b2, 1, a1, a2) in both directions.

    Either end is continued by `padding` samples turned about it, and a pass begins in equilibrium: `start` (2,) is the
    state that a constant one leaves (scipy's `sosfilt_zi`). Source: Gustafsson, IEEE Trans. Signal Process. 44, 1996.
    """
    n, columns = signal.shape
    b0, b1, b2, a1, a2 = section[0], section[1], section[2], section[4], section[5]
    total = n + 2 * padding
    x = np.empty((total, columns))
    for k in range(n):
        for d in range(columns):
            x[padding + k, d] = signal[k, d]
    for k in range(padding):
        for d in range(columns):
            x[k, d] = 2.0 * signal[0, d] - signal[padding - k, d]
            x[padding + n + k, d] = 2.0 * signal[n - 1, d] - signal[n - 2 - k, d]
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


def smooth(time: Array, values: Array, window: float = 0.15, derivative: int = 0) -> Array:
    """Value or first derivative of `values` (N, ...) at `time` (N,) [s] from local cubics over `window` [s].

    Stamps may jitter: the derivative is taken with respect to the index and divided by that of the time.
    """
    odd = 2 * round(window / float(np.median(np.diff(time))) / 2) + 1
    points = min(odd, len(time) - 1 + len(time) % 2)
    if points < 5:
        return np.gradient(values, time, axis=0) if derivative else values
    smoothed = local_cubics(values, points, derivative)
    if not derivative:
        return smoothed
    step = local_cubics(time, points, 1)
    return np.asarray(smoothed / step.reshape(-1, *[1] * (values.ndim - 1)))


def local_cubics(values: Array, points: int, derivative: int) -> Array:
    """Values (N, ...) or their derivative by the index from a cubic through the `points` around each, N >= points.

    At the ends it is the cubic through the first and last `points`: scipy.signal.savgol_filter, but for rounding.
    """
    weights = _weights(points, derivative)
    rows = np.ascontiguousarray(values, dtype=float).reshape(len(values), -1)
    half = points // 2
    out = np.empty_like(rows)
    out[half : len(rows) - half] = row_kernels.correlated(rows, weights[half])
    out[:half] = weights[:half] @ rows[:points]
    out[len(rows) - half :] = weights[half + 1 :] @ rows[-points:]
    return out.reshape(np.shape(values))


@lru_cache(maxsize=64)
def _weights(points: int, derivative: int) -> Array:
    """What the cubic through equally spaced points is (derivative 0), or how steep it is (1), at each: (n, n)."""
    x = np.linspace(-1.0, 1.0, points)
    basis, slopes = np.polynomial.legendre.legvander(x, 3), np.empty((points, 4))
    for k in range(4):
        slopes[:, k] = np.polynomial.legendre.legval(x, np.polynomial.legendre.legder(np.eye(4)[k])) * 2 / (points - 1)
    return np.asarray((slopes if derivative else basis) @ np.linalg.pinv(basis))


def angular_velocity(time: Array, quat_EB: Array, window: float = 0.15) -> Array:
    """Body rates omega_B (N, 3) [rad/s] of attitudes quat_EB (N, 4).

    hat(omega_B) = R^T dR/dt; the steps log(q_i^-1 q_i+1) are rotation vectors in B, summed and differentiated.
    """
    q = so3.continuous(quat_EB)
    path = np.zeros((len(q), 3))
    path[1:] = so3.rotation_between(q[:-1], q[1:])
    np.cumsum(path[1:], axis=0, out=path[1:])
    return smooth(time, path, window, derivative=1)
