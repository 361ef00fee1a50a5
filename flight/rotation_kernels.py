"""Rotations of hours of log, compiled: one pass over the rows where the plain form makes several arrays of each.

The plain forms are those of `flight.so3`, which hands over to these from `MANY` rows on. Every sum is taken in the
plain form's order, so that results are equal but for the last digit of an arctangent (tests/flight/test_so3.py).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

MANY = 4096
"""Rows below which a handful of numpy calls is soon done."""


@njit(cache=True, nogil=True)
def continuous(quat: Array) -> Array:
    """As `so3.continuous`: (N, 4) to (N, 4)."""
    out = np.empty_like(quat)
    sign = 1.0
    for i in range(len(quat)):
        if i > 0:
            along = quat[i, 0] * quat[i - 1, 0] + quat[i, 1] * quat[i - 1, 1]
            along = along + quat[i, 2] * quat[i - 1, 2] + quat[i, 3] * quat[i - 1, 3]
            if along < 0.0:
                sign = -sign
        for k in range(4):
            out[i, k] = quat[i, k] * sign
    return out


@njit(cache=True, nogil=True)
def rotate(quat: Array, vector: Array, inverse: float) -> Array:
    """As `so3.rotate` for `inverse` 1, `so3.rotate_inverse` for -1: (N, 4) and (N, 3) to (N, 3)."""
    out = np.empty((len(vector), 3))
    for i in range(len(vector)):
        w, a, b, c = quat[i, 0], inverse * quat[i, 1], inverse * quat[i, 2], inverse * quat[i, 3]
        x, y, z = vector[i, 0], vector[i, 1], vector[i, 2]
        s, t, u = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
        out[i, 0] = x + w * s + (b * u - c * t)
        out[i, 1] = y + w * t + (c * s - a * u)
        out[i, 2] = z + w * u + (a * t - b * s)
    return out


@njit(cache=True, nogil=True)
def _log(w: float, x: float, y: float, z: float, out: Array) -> None:
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    norm = np.sqrt(x * x + y * y + z * z)
    factor = 2.0 * np.arctan2(norm, w) / norm if norm > 1e-12 else 2.0
    out[0], out[1], out[2] = factor * x, factor * y, factor * z


@njit(cache=True, nogil=True)
def log(quat: Array) -> Array:
    """As `so3.log`: (N, 4) to (N, 3)."""
    out = np.empty((len(quat), 3))
    for i in range(len(quat)):
        _log(quat[i, 0], quat[i, 1], quat[i, 2], quat[i, 3], out[i])
    return out


@njit(cache=True, nogil=True)
def _relative(p: Array, q: Array, out: Array) -> None:
    """log(p^-1 q)."""
    a, b, c, d = p[0], -p[1], -p[2], -p[3]
    w, x, y, z = q[0], q[1], q[2], q[3]
    _log(
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
        out,
    )


@njit(cache=True, nogil=True)
def interpolate(time: Array, knots: Array, quat: Array) -> Array:
    """As `so3.interpolate`: (N,), (K,) increasing, (K, 4) to (N, 4)."""
    out, step, j, last = np.empty((len(time), 4)), np.empty(3), 0, len(knots) - 2
    for i in range(len(time)):
        t = time[i]
        if j > 0 and t < knots[j]:
            j = max(np.searchsorted(knots, t, side="right") - 1, 0)
        while j < last and knots[j + 1] <= t:
            j += 1
        share = min(max((t - knots[j]) / (knots[j + 1] - knots[j]), 0.0), 1.0)
        _relative(quat[j], quat[j + 1], step)
        a, b, c = share * step[0], share * step[1], share * step[2]
        half = 0.5 * np.sqrt(a * a + b * b + c * c)
        scale = 0.5 * np.sin(half) / half if half > 0.0 else 0.5
        w, x, y, z = np.cos(half), scale * a, scale * b, scale * c
        p, q, r, s = quat[j, 0], quat[j, 1], quat[j, 2], quat[j, 3]
        out[i, 0] = p * w - q * x - r * y - s * z
        out[i, 1] = p * x + q * w + r * z - s * y
        out[i, 2] = p * y - q * z + r * w + s * x
        out[i, 3] = p * z + q * y - r * x + s * w
    return out


@njit(cache=True, nogil=True)
def turned(before: Array, after: Array) -> Array:
    """As `so3.turned`, log(p^-1 q) of the rows p of `before` and q of `after`: (N, 4) and (N, 4) to (N, 3)."""
    out = np.empty((len(before), 3))
    for i in range(len(before)):
        _relative(before[i], after[i], out[i])
    return out
