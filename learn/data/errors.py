"""How an error is averaged: the one place where residuals become numbers that a user reads.

A residual (K, 6) is measured minus predicted wrench over K samples. Per axis it is averaged to mean, standard
deviation, rms and maximum of its size; over all axes, newtons and newton metres come on one scale with the weights w
(6,) of `learn.data.dataset.Dataset`:

    energy = sum_kl (w_l r_kl)^2,        whole = sqrt(sum_l (w_l rms_l)^2)

An axis that was not measured is not a number, its weight is zero, and it counts in no sum. What is not a number on all
axes stays so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array, Indices


def rms(residual: Array) -> Array:
    """Root mean square over samples: (L,) of (K, L)."""
    return np.asarray(np.sqrt(np.mean(residual**2, axis=0)))


def sums_by(label: Indices, values: NDArray[Any], labels: int = 0) -> Array:
    """Sums (labels, L) of values (K, L) with these labels (K,): blocks of time, flights, bands of frequency."""
    count = max(labels, int(label.max(initial=-1)) + 1)
    columns = [np.bincount(label, weights=column, minlength=count) for column in values.T]
    return np.stack(columns, axis=1) if columns else np.zeros((count, 0))


def means_by(label: Indices, values: NDArray[Any], labels: int = 0) -> Array:
    """Means (labels, L) of values (K, L) with these labels (K,); zero where a label has none."""
    count = np.bincount(label, minlength=labels)
    return np.asarray(sums_by(label, values, labels) / np.maximum(count, 1)[:, None])


def reduction(before: Array, after: Array) -> Array:
    """Fraction of an error, e.g. of rms (L,), that is gone; negative where it grew."""
    return np.asarray(1.0 - after / np.maximum(before, 1e-30))


def weighted(residual: Array, weights: Array) -> Array:
    """Residual (..., L) times weights (L,); zero, whatever stands there, where the weight is."""
    product = residual * weights
    return product if np.all(weights) else np.where(weights == 0.0, 0.0, product)


def energy(residual: Array, weights: Array) -> float:
    """sum_kl (w_l r_kl)^2: newtons and newton metres on one scale."""
    scaled = weighted(residual, weights)
    return float(np.vdot(scaled, scaled))


def whole(rms_by_axis: Array, weights: Array) -> float:
    """One number for all axes of rms (6,), on the scale of the weights."""
    return float(np.sqrt(np.sum(weighted(rms_by_axis, weights) ** 2)))


def length(vectors: Array) -> Array:
    """Length (...) of vectors (..., L) over the components that are known; not a number where none is."""
    known = ~np.isnan(vectors)
    return np.where(known.any(axis=-1), np.sqrt(np.sum(np.where(known, vectors, 0.0) ** 2, axis=-1)), np.nan)


def force_and_torque(rms_by_axis: Array) -> Array:
    """Root mean square norms (2,) of force [N] and torque [Nm] from the rms by axis (6,), over the measured axes."""
    return np.array([length(rms_by_axis[:3]), length(rms_by_axis[3:])])


@dataclass(frozen=True)
class Errors:
    """Of the absolute error, per axis (6,): mean, standard deviation, root mean square, maximum [N, Nm].

    `mean` (6,) is that of the error itself, measured minus predicted, with its sign.
    """

    mean_abs: Array
    std_abs: Array
    rms: Array
    max_abs: Array
    mean: Array

    @classmethod
    def of(cls, residual: Array) -> Errors:
        """Errors of residuals (K, 6)."""
        size = np.abs(residual)
        return cls(size.mean(axis=0), size.std(axis=0), rms(residual), size.max(axis=0), residual.mean(axis=0))
