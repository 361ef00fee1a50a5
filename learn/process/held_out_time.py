"""What held-out time says of a process: whether sigma is right, how much of its mean is believed, and the verdict.

Derivation and sources: docs/theory/process.md, How much is believed. **Calibration**: each of `CALIBRATION.folds` sets
of blocks is left out in turn, with the hyperparameters kept, and predicted from the rest; sigma is multiplied, output
by output, by

    s = quantile_95 |z - mu| / sigma  /  1.96

**Support**: on samples that were left out of the fit, with residual z and prediction m, the gain of least squares, its
standard error over B blocks of time, and the gain by which the mean is multiplied, with c = `SUPPORT.certain`, are

    g^ = sum_b n_b / sum_b q_b,        n_b = sum z m, q_b = sum m^2 in block b
    s  = sqrt(B / (B - 1) sum_b (n_b - g^ q_b)^2) / sum_b q_b
    g  = min(g^, 1) max(0, 1 - (c s / g^)^2)

Where less than `SUPPORT.least_share` of the residual's energy is explained the gain is zero too: what it could win is
not worth a risk.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Self

import numpy as np
from pydantic import Field

from wrenchgap.flight.flight import Array, Indices, Mask
from wrenchgap.learn.data.errors import sums_by
from wrenchgap.plant.reader import Number, Real, expected, stored

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
    """Shares (L,) within 1.96 and 3 standard deviations, expected 0.95 and 0.997; NaN where not measured."""

    within_95: Array
    within_3_sigma: Array

    @classmethod
    def of(cls, error: Array, std: Array) -> Self:
        """From errors and standard deviations (K, L)."""
        size = np.abs(error) / std
        shares = (np.where(np.isnan(size), np.nan, size < limit).mean(axis=0) for limit in (CALIBRATION.quantile, 3.0))
        return cls(*shares)


@dataclass(frozen=True)
class SupportThresholds:
    """When a gain is believed."""

    certain: float = 2.0
    """Standard errors by which a gain is shrunk."""
    least_share: float = 0.1
    """Share of the residual's energy that must be explained: less is not worth a risk."""


SUPPORT = SupportThresholds()


@dataclass(frozen=True)
class HeldOut:
    """Samples that were left out: residual, prediction and its standard deviation (K, L), and their blocks (K,)."""

    actual: Array
    predicted: Array
    std: Array
    block: Indices


@dataclass(frozen=True)
class Support:
    """What held-out time supports: gain (L,), share (L,) of the residual's energy that is explained with it, and the
    reduction of the residual's rms with the ends of its 95 % interval (L, 3).
    """  # noqa: D205

    gain: Array
    share: Array
    reduction: Array


def support(held: HeldOut) -> Support:
    """The gain of each output; see the module."""
    z, m = held.actual, held.predicted
    cross, square = sums_by(held.block, z * m), sums_by(held.block, m * m)
    total = np.maximum(square.sum(axis=0), 1e-300)
    estimate = cross.sum(axis=0) / total
    error = _spread(cross - estimate * square) / total
    certain = 1.0 - (SUPPORT.certain * error / np.maximum(np.abs(estimate), 1e-300)) ** 2
    gain = np.clip(estimate, 0.0, 1.0) * np.maximum(certain, 0.0)
    share = 1.0 - _left(held, gain)[0]
    gain = np.where(share < SUPPORT.least_share, 0.0, gain)
    return Support(gain, np.where(gain > 0, share, 0.0), reduction(held, gain))


def reduction(held: HeldOut, gain: Array) -> Array:
    """Share (L, 3) by which the residual's rms falls, and the ends of its 95 % interval over blocks."""
    left, error = _left(held, gain)
    ends = np.stack([left, left + CALIBRATION.quantile * error, left - CALIBRATION.quantile * error], axis=1)
    return np.asarray(1.0 - np.sqrt(np.maximum(ends, 0.0)))


def _left(held: HeldOut, gain: Array) -> tuple[Array, Array]:
    """Share of the energy (L,) that is left with these gains, and its standard error."""
    after = sums_by(held.block, (held.actual - gain * held.predicted) ** 2)
    before = sums_by(held.block, held.actual**2)
    total = np.maximum(before.sum(axis=0), 1e-300)
    left = after.sum(axis=0) / total
    return left, _spread(after - left * before) / total


def _spread(differences: Array) -> Array:
    """Standard deviation (L,) of a sum of B independent blocks (B, L)."""
    count = len(differences)
    return np.asarray(np.sqrt(count / max(count - 1, 1) * np.sum(differences**2, axis=0)))


class Decision(StrEnum):
    """Whether an output of a process is to be flown."""

    COMPENSATE = "compensate"
    DO_NOT = "do not"
    NEEDS = "needs"


class Reason(StrEnum):
    """Why."""

    HELPS = "helps"  # held-out time supports it
    NOTHING = "nothing"  # the residual is not above the sensors' noise, or too small to count
    LAG = "lag"  # the residual is a lag of the vehicle, which no function of the command can correct
    WORSE = "worse"  # on unseen flights the process increases the error
    INPUTS = "inputs"  # there is a residual, and the command does not determine it
    EXCITATION = "excitation"  # there is one, and the flight does not show what it depends on
    LONGER = "longer"  # the flights are too short to hold time out


@stored
@dataclass(frozen=True)
class Verdict:
    """Of one output.

    gain       what the process is multiplied by, 0 to 1
    reduction  of the residual's rms on held-out time, with the ends of its 95 % interval; empty where nothing was
               held out
    """

    output: str
    decision: Decision
    reason: Reason
    gain: Annotated[Number, Field(ge=0.0, le=1.0), expected("a number from 0 to 1")]
    reduction: tuple[Real, ...]
