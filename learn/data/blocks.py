"""Whether a difference is significant: statistics over blocks of time, and every threshold that they are held against.

Filtered samples are not independent, so blocks of 2 s are (docs/decisions/0006-blocks.md). What is compared is a loss
of two models, block by block:

    t = mean_b d_b / (std_b d_b / sqrt(B)),        d_b the difference of block b, B blocks

`paired_t` is that, for any loss; fewer than `SIGNIFICANCE.fewest` blocks say nothing. The losses differ with the
question: energies on one scale where that is what a user sees, mean squares normalised by both models' own where every
axis is to count.

Whether one model is better than another is uncertain for two reasons. Blocks differ: the standard error above. And no
model is exactly right: what the better one leaves above the noise was made by something that neither has, and that
something may as well have made the difference. `Contrast.separation` counts the second as `SIGNIFICANCE.discrepancy`
times the excess that the better one leaves. Source of the idea: model discrepancy, Kennedy and O'Hagan, J. R. Stat.
Soc. B 63, 2001.

A t is judged by one of `SIGNIFICANCE`, whatever is compared. Where chance is counted by random orders or by a
distribution instead, `SIGNIFICANCE.level` is the probability of a false alarm.
"""

from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import Array, Indices, Mask
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import rms, weighted


@dataclass(frozen=True)
class SignificanceThresholds:
    """From when on a difference is more than chance, and large enough to matter."""

    fewest: int = 3
    """Blocks below which no difference can be judged."""
    alone: float = 3.0
    """t on its own. With 10 to 20 blocks Student's t exceeds it by chance in 0.2 to 0.7 % of trials on one side, and
    some thirty effects are tried at every step."""
    large: float = 2.0
    """t where the gain itself is large (`large_evidence`): an effect that acts in few blocks only (near the ground, at
    speed) makes blocks differ and its own t small, but chance does not take so much off blocks that were not fitted."""
    indistinct: float = 2.5
    """t below which two explanations are indistinguishable: between the others, so that what was named on the strength
    of a t of 3 is not at once indistinguishable from nothing."""
    unsteady: float = 1.0
    """t for what is strong in some blocks and absent in others by its nature (a load that swings); the share of the
    energy that it explains decides there, or evidence that is `overwhelming`."""
    level: float = 0.01
    """Probability of a false alarm."""
    least_evidence: float = 0.2
    """Smallest evidence (sum of log rms ratios over axes) worth a name: e.g. 7 % of the rms of three axes."""
    large_evidence: float = 0.5
    """Evidence of a large gain: 40 % off the rms of one axis, or as much over several."""
    overwhelming: float = 2.0
    """Evidence of a gain that is no chance even where few blocks have most of it: one axis' rms falls to a seventh."""
    discrepancy: float = 0.25
    """Share of the better model's excess over the noise that may be chance's choice between two models."""


SIGNIFICANCE = SignificanceThresholds()


def significant(t: float, *, large: bool = False) -> bool:
    """Whether a paired t is beyond chance; `large` where the gain itself is large."""
    return t > (SIGNIFICANCE.large if large else SIGNIFICANCE.alone)


def beyond_chance(t: float, evidence: float) -> bool:
    """Whether evidence is enough for a name, and its paired t beyond chance."""
    return evidence > SIGNIFICANCE.least_evidence and significant(t, large=evidence > SIGNIFICANCE.large_evidence)


def needed(t: float, evidence: float) -> bool:
    """Whether a gain is beyond chance and matters; of an overwhelming one a few blocks may have nearly all."""
    return t > SIGNIFICANCE.unsteady if evidence > SIGNIFICANCE.overwhelming else beyond_chance(t, evidence)


def by_block(block: Indices, values: Array) -> Array:
    """Means (B,) of values (K,) over blocks numbered from zero."""
    return np.asarray(np.bincount(block, weights=values) / np.bincount(block))


def standard_error(differences: Array) -> Array:
    """Of the mean over blocks: () of (B,), (L,) of (B, L)."""
    return np.asarray(np.std(differences, axis=0, ddof=1) / np.sqrt(len(differences)))


def paired_t(differences: Array) -> Array:
    """Paired t of differences by block, () of (B,) or (L,) of (B, L); zero where they are too few."""
    if len(differences) < SIGNIFICANCE.fewest:
        return np.zeros(differences.shape[1:])
    return np.asarray(np.mean(differences, axis=0) / np.maximum(standard_error(differences), 1e-300))


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
        return self.difference / max(float(np.hypot(self.spread, SIGNIFICANCE.discrepancy * self.excess)), 1e-30)


def contrast(data: Dataset, worse: Array, better: Array, *, axes: Mask | None = None) -> Contrast:
    """Compare two held-out residuals (K, 6); `Contrast` of nothing where there are fewer than three blocks.

    On `axes` (6,), all that were measured unless they are given.

    The loss of a sample is sum_l r_l^2 / v_l, with v_l the geometric mean of both models' mean squares on axis l: a
    pure number in which every axis counts, whatever its unit and size.
    """
    known = data.measured_axes if axes is None else axes
    worse, better, noise = worse[:, known], better[:, known], data.noise[known]
    square = np.mean(better**2, axis=0)
    variance = common_variance(worse**2, better**2)
    difference = by_block(data.block, np.sum((worse**2 - better**2) / variance, axis=1))
    if len(difference) < SIGNIFICANCE.fewest:
        return Contrast(0.0, 1.0, 0.0)
    excess = float(np.sum(np.maximum(square - noise**2, 0.0) / variance))
    return Contrast(float(np.mean(difference)), float(standard_error(difference)), excess)


def common_variance(worse: Array, better: Array) -> Array:
    """The geometric mean (L,) of the mean squares of two models, of squares (K, L): each axis counts by ratios."""
    return np.asarray(np.sqrt(np.mean(worse, axis=0) * np.mean(better, axis=0)) + 1e-30)


def evidence(worse: Array, better: Array) -> float:
    """Sum over measured axes of log rms ratios of two residuals (K, 6): scale-free, so that a small axis counts too."""
    before, after = (np.maximum(rms(r), 1e-30) for r in (worse, better))
    return float(np.nansum(np.log(before / after)))


def cosine(data: Dataset, start: Array, first: Array, second: Array) -> float:
    """Cosine between the changes that two models make to the prediction of `start`; all are residuals (K, 6)."""
    a, b = (weighted(start - other, data.weights).ravel() for other in (first, second))
    return float(a @ b / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-30))
