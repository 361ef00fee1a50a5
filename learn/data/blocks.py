"""Comparing what two models leave, block of time by block of time.

The loss of a block is the mean over its samples of sum_l r_l^2 / v_l, with v_l the geometric mean of both models' mean
squares on axis l: a pure number in which every axis counts, whatever its unit and size.

Whether one model is better than another is uncertain for two reasons. Blocks differ: the standard error of the paired
difference over blocks (blocks of 2 s, because filtered samples are not independent; docs/decisions/0006-blocks.md).
And no model is exactly right: what the better one leaves above the noise was made by something that neither has, and
that something may as well have made the difference. The second is counted as `DISCREPANCY` times the excess that the
better one leaves. Source of the idea: model discrepancy, Kennedy and O'Hagan, J. R. Stat. Soc. B 63, 2001.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.learn.identify.fit import Dataset

Array = NDArray[np.float64]

DISCREPANCY = 0.25
"""Share of the better model's excess over the noise that may be chance's choice between two models."""


@dataclass(frozen=True)
class Contrast:
    """How much worse one model is than another, in normalised loss.

    `difference` is the mean over blocks, `spread` its standard error, `excess` what the better leaves above the noise.
    """

    difference: float
    spread: float
    excess: float

    @property
    def t(self) -> float:
        """Paired t over blocks: whether there is a difference at all."""
        return self.difference / max(self.spread, 1e-30)

    @property
    def separation(self) -> float:
        """As t, the models' inadequacy included: whether the difference means that the better one is right."""
        return self.difference / max(float(np.hypot(self.spread, DISCREPANCY * self.excess)), 1e-30)


def contrast(data: Dataset, worse: Array, better: Array) -> Contrast:
    """Compare two held-out residuals (K, 6); `Contrast` of nothing where there are fewer than three blocks."""
    squares = np.mean(worse**2, axis=0), np.mean(better**2, axis=0)
    variance = np.sqrt(squares[0] * squares[1]) + 1e-30
    counts = np.bincount(data.block)
    loss = np.sum((worse**2 - better**2) / variance, axis=1)
    difference = np.bincount(data.block, weights=loss) / counts
    if len(difference) < 3:
        return Contrast(0.0, 1.0, 0.0)
    spread = float(np.std(difference, ddof=1) / np.sqrt(len(difference)))
    excess = float(np.sum(np.maximum(squares[1] - data.noise**2, 0.0) / variance))
    return Contrast(float(np.mean(difference)), spread, excess)


def evidence(worse: Array, better: Array) -> float:
    """Sum over axes of log rms ratios of two residuals (K, 6): scale-free, so that a small axis counts too."""
    before, after = (np.maximum(np.sqrt(np.mean(r**2, axis=0)), 1e-30) for r in (worse, better))
    return float(np.sum(np.log(before / after)))


def cosine(data: Dataset, start: Array, first: Array, second: Array) -> float:
    """Cosine between the changes that two models make to the prediction of `start`; all are residuals (K, 6)."""
    a = ((start - first) * data.weights).ravel()
    b = ((start - second) * data.weights).ravel()
    return float(a @ b / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-30))


def energy(data: Dataset, residual: Array) -> float:
    """sum_kl (w_l r_kl)^2 with the weights of the data: newtons and newton metres on one scale."""
    weighted = residual * data.weights
    return float(np.vdot(weighted, weighted))
