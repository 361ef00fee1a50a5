"""Alignment in time of two flights of the same manoeuvre, by attitude and height."""

from __future__ import annotations

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array
from wrenchgap.viewer.scene import Motion


def delay_between(late: Motion, fixed: Motion, least: float = 0.5, step: float = 0.02) -> float | None:
    """Shift [s] of `late` for which it moves as `fixed` does; None below a correlation of `least`.

    The delay at which the products of the two motions' features (body z axis in E, height, each without its mean)
    correlate best, among those at which the shorter one overlaps by half or more. They are compared every `step` [s].
    """
    a, b = _features(fixed, step), _features(late, step)
    if not (a.any() and b.any()):
        return None
    size = 1 << (len(a) + len(b) - 2).bit_length()
    spectrum = np.fft.rfft(a, size, axis=0) * np.conj(np.fft.rfft(b, size, axis=0))
    products = np.fft.irfft(spectrum.sum(axis=1), size)
    lags = np.arange(-(len(b) - 1), len(a))
    energy_a, energy_b = _energy(a), _energy(b)
    first, last = np.maximum(0, lags), np.minimum(len(a), lags + len(b))
    in_a = energy_a[last] - energy_a[first]
    in_b = energy_b[last - lags] - energy_b[first - lags]
    score = products[lags % size] / np.sqrt(np.maximum(in_a * in_b, 1e-30))
    score[last - first < 0.5 * min(len(a), len(b))] = -np.inf
    best = int(np.argmax(score))
    if score[best] < least:
        return None
    return float(lags[best] * step + fixed.time[0] - late.time[0])


def _energy(features: Array) -> Array:
    """Sum of squares up to each sample (N + 1,)."""
    return np.concatenate(([0.0], np.cumsum((features**2).sum(axis=1))))


def _features(motion: Motion, step: float) -> Array:
    """Body x and z axes in E and the height (N, 7), on a uniform clock, each without its mean."""
    clock = np.arange(motion.time[0], motion.time[-1], step)
    x = so3.rotate(motion.quat_EB, np.array([1.0, 0.0, 0.0]))
    z = so3.rotate(motion.quat_EB, np.array([0.0, 0.0, 1.0]))
    raw = np.column_stack((x, z, motion.position_E[:, 2]))
    out = np.stack([np.interp(clock, motion.time, column) for column in raw.T], axis=1)
    out = out - out.mean(axis=0)
    out[:, 6] /= max(float(np.abs(out[:, 6]).max()), 1e-3)
    return np.asarray(out)
