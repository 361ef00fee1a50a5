"""How much of a process held-out time supports: the gain by which its mean is multiplied, output by output.

On samples that were left out of the fit, with residual z and prediction m, the gain of least squares and its standard
error over B blocks of time (ratio estimator; Cochran, Sampling Techniques, 3rd ed., 6.4) are

    g^ = sum_b n_b / sum_b q_b,        n_b = sum z m, q_b = sum m^2 in block b
    s  = sqrt(B / (B - 1) sum_b (n_b - g^ q_b)^2) / sum_b q_b

and what is believed is the positive part of James and Stein's shrinkage (Proc. 4th Berkeley Symp., 1961), with
c = `SUPPORT.certain` standard errors in place of one, and never more than the process itself says:

    g  = min(g^, 1) max(0, 1 - (c s / g^)^2)

Noise has g^ within s of zero, so its gain is zero but for chance; a function that is there has s << g^ and keeps it.
Where less than `SUPPORT.least_share` of the residual's energy is explained the gain is zero too: what it could win is
not worth a risk.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.learn.process.calibration import CALIBRATION


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
    block: NDArray[np.intp]


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
    cross, square = _sums(held.block, z * m), _sums(held.block, m * m)
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
    after = _sums(held.block, (held.actual - gain * held.predicted) ** 2)
    before = _sums(held.block, held.actual**2)
    total = np.maximum(before.sum(axis=0), 1e-300)
    left = after.sum(axis=0) / total
    return left, _spread(after - left * before) / total


def _sums(block: NDArray[np.intp], values: Array) -> Array:
    """Sums (B, L) of values (K, L) over blocks."""
    return np.stack([np.bincount(block, weights=column) for column in values.T], axis=1)


def _spread(differences: Array) -> Array:
    """Standard deviation (L,) of a sum of B independent blocks (B, L)."""
    count = len(differences)
    return np.asarray(np.sqrt(count / max(count - 1, 1) * np.sum(differences**2, axis=0)))
