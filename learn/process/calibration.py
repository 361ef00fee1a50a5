"""Is sigma what it says? Scale it by what it turns out to be on blocks of time that were left out.

A Gaussian process believes that its samples are independent and its kernel is the truth. Neither holds: neighbouring
samples of a filtered signal are alike, and what the command does not determine (lags, wind) looks like noise in some
places and like function in others. So each of `CALIBRATION.folds` sets of blocks is left out in turn, with the
hyperparameters kept, and predicted from the rest:

    s = quantile_95 |z - mu| / sigma  /  1.96          per output;  sigma is then multiplied by s

which makes 95 % intervals hold 95 % of unseen samples, if unseen flights are like unseen blocks. (Conformal
prediction with a normalised score does the same: Angelopoulos and Bates 2023, section 2.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array

Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
Predict = Callable[[Mask, Indices], tuple[Array, ...]]
"""(which samples may be used (M,), indices of those asked for (K,)) -> what is said of them, (K, L) each."""


@dataclass(frozen=True)
class CalibrationSettings:
    """What is left out in turn, and by how much sigma may be scaled."""

    blocks: int = 16
    """Contiguous stretches of the samples."""
    folds: int = 4
    """Sets of blocks that are left out in turn: every fourth block makes a fold."""
    fewest: int = 200
    """Samples below which nothing is left out."""
    level: float = 0.95
    """Share of unseen samples that the intervals are to hold."""
    quantile: float = 1.96
    """The standard normal's for that share."""
    scale: tuple[float, float] = (1.0, 10.0)
    """Bounds of the factor. Never below one: blocks of the training flight are more like the rest of it than an unseen
    flight is, so that sigma may well prove too large on them."""

    def block(self, count: int) -> Indices:
        """The block (N,) of each of `count` samples."""
        return np.arange(count) * self.blocks // count


CALIBRATION = CalibrationSettings()


def left_out(count: int, asked: Indices, predict: Predict) -> tuple[Array, ...]:
    """What is predicted (K, L) of the samples `asked` out of `count`, each without the blocks of its fold."""
    folds = CALIBRATION.folds
    fold = CALIBRATION.block(count) % folds
    parts = [predict(fold != k, asked[fold[asked] == k]) for k in range(folds)]
    out = tuple(np.empty((len(asked), part.shape[1])) for part in parts[0])
    for k, found in enumerate(parts):
        for whole, part in zip(out, found, strict=True):
            whole[fold[asked] == k] = part
    return out


def sigma_scale(error: Array, std: Array) -> Array:
    """Factors (L,) from errors and standard deviations (K, L) of samples that were left out."""
    ratio = np.quantile(np.abs(error) / std, CALIBRATION.level, axis=0) / CALIBRATION.quantile
    return np.asarray(np.clip(ratio, *CALIBRATION.scale))


@dataclass(frozen=True)
class Coverage:
    """Shares (L,) of samples whose error is within 1.96 and within 3 standard deviations; expected 0.95 and 0.997.

    Not a number on axes that were not measured.
    """

    within_95: Array
    within_3_sigma: Array

    @classmethod
    def of(cls, error: Array, std: Array) -> Coverage:
        """From errors and standard deviations (K, L)."""
        size = np.abs(error) / std
        shares = (np.where(np.isnan(size), np.nan, size < limit).mean(axis=0) for limit in (CALIBRATION.quantile, 3.0))
        return cls(*shares)
