"""Derivatives of sampled, noisy signals: local cubic fits without phase (Savitzky and Golay, 1964)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from wrenchgap.flight import row_kernels, so3
from wrenchgap.flight.flight import Array


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
