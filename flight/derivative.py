"""Derivatives of sampled, noisy signals: local cubic fits without phase (Savitzky and Golay, 1964)."""

from __future__ import annotations

import numpy as np
from scipy.signal import savgol_filter

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array


def smooth(time: Array, values: Array, window: float = 0.15, derivative: int = 0) -> Array:
    """Value or first derivative of `values` (N, ...) at `time` (N,) [s] from local cubics over `window` [s].

    Stamps may jitter: the derivative is taken with respect to the index and divided by that of the time.
    """
    odd = 2 * round(window / float(np.median(np.diff(time))) / 2) + 1
    points = min(odd, len(time) - 1 + len(time) % 2)
    if points < 5:
        return np.gradient(values, time, axis=0) if derivative else values
    smoothed = savgol_filter(values, points, 3, deriv=derivative, axis=0)
    if not derivative:
        return np.asarray(smoothed)
    step = savgol_filter(time, points, 3, deriv=1)
    return np.asarray(smoothed / step.reshape(-1, *[1] * (values.ndim - 1)))


def angular_velocity(time: Array, quat_EB: Array, window: float = 0.15) -> Array:
    """Body rates omega_B (N, 3) [rad/s] of attitudes quat_EB (N, 4).

    hat(omega_B) = R^T dR/dt; the steps log(q_i^-1 q_i+1) are rotation vectors in B, summed and differentiated.
    """
    q = so3.continuous(quat_EB)
    path = np.zeros((len(q), 3))
    path[1:] = so3.log(so3.multiply(so3.conjugate(q[:-1]), q[1:]))
    np.cumsum(path[1:], axis=0, out=path[1:])
    return smooth(time, path, window, derivative=1)
