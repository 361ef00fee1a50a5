"""Error budget: what the nominal model's mean square error is made of, per axis.

    E_nominal = noise + physics + process + unexplained

    physics      E_nominal - E_model             what the effects in the model take off; negative where they do harm
    process      E_model - E_model+GP            what a Gaussian process of the commanded wrench takes off what is left
    noise        min(sigma_noise^2, E_left)      sensor noise that passes the filter (`learn.data.measurement`)
    unexplained  E_left - noise                  the rest, E_left being what model and process leave

The process is fitted on other blocks of time than those on which it is judged: blocks go to four folds in turn. On
an axis where it does not take anything off beyond chance (paired t over blocks, docs/decisions/0006-blocks.md) it is
not used and its part is zero: there it has learnt noise, and would do harm. It is a small process, made to see how
much structure there is, not to fly with; `wrenchgap learn` makes better ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.data.blocks import SIGNIFICANCE, by_block, paired_t
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import weighted
from wrenchgap.learn.process.gp import FitSettings

PARTS = ("noise", "physics", "process", "unexplained")


class Source(StrEnum):
    """Which process is meant: fitted for the budget and judged on blocks that it had not seen, given, or none."""

    FITTED = "fitted"
    GIVEN = "given"
    NONE = "none"


@dataclass(frozen=True)
class Budget:
    """Mean squares (6,) [N^2, Nm^2] that add up to `nominal`; `weights` (6,) put them on one scale."""

    nominal: Array
    noise: Array
    physics: Array
    process: Array
    unexplained: Array
    weights: Array
    source: Source

    @property
    def has_physics(self) -> bool:
        """Whether the effects of the model take anything off."""
        return bool(np.nan_to_num(self.physics).any())

    def shares(self) -> dict[str, Array]:
        """Parts as fractions of the nominal error (6,), by name."""
        return {name: getattr(self, name) / np.maximum(self.nominal, 1e-300) for name in PARTS}

    def whole(self) -> dict[str, float]:
        """The same for all axes together, newtons and newton metres on one scale."""
        scale = self.weights**2
        total = max(float(weighted(self.nominal, scale).sum()), 1e-300)
        return {name: float(weighted(getattr(self, name), scale).sum()) / total for name in PARTS}


def budget(data: Dataset, nominal: Array, left: Array, process: Array | None, source: Source) -> Budget:
    """Budget of residuals (K, 6): of the nominal model, of the model, and the process's prediction of the latter.

    `process` (K, 6) is None where there is none; a given one counts wherever it helps at all.
    """
    before, model = (np.mean(r**2, axis=0) for r in (nominal, left))
    after = model
    if process is not None:
        better = np.mean((left - process) ** 2, axis=0)
        least = 0.0 if source is Source.GIVEN else SIGNIFICANCE.large
        t = paired_t(np.stack([by_block(data.block, c) for c in (left**2 - (left - process) ** 2).T], axis=1))
        believed = (better < after) & (t > least)
        after = np.where(believed, better, after)
    else:
        source = Source.NONE
    noise = np.minimum(data.noise**2, after)
    return Budget(before, noise, before - model, model - after, after - noise, data.weights, source)


def held_out_process(
    data: Dataset,
    residual: Array,
    *,
    points: int = 150,
    folds: int = 4,
    progress: Callable[[int, int], None] | None = None,
) -> Array | None:
    """Prediction (K, 6) of a residual (K, 6) from the command, by processes that did not see its block of time.

    Not a number on axes that were not measured.

    None where the log is too short to hold anything out, or the command never moves.
    """
    from wrenchgap.learn.process.train import fit  # here: others need not wait for it

    xi = data.commanded
    fold = data.block % folds
    every = max(1, int(1.0 / data.independence))  # closer samples say the same
    settings = FitSettings(points=points, restarts=0, mean="constant", pre_thin=1500)
    known = data.measured_axes
    outputs = tuple(axis for axis, measured in zip(AXES, known, strict=True) if measured)
    out = np.where(known, 0.0, np.full_like(residual, np.nan))
    for f in range(folds):
        test, train = fold == f, np.flatnonzero(fold != f)[::every]
        if progress is not None:
            progress(f, folds)
        if not test.any():
            continue
        if len(train) < 4 * xi.shape[1] or not (np.ptp(xi[train], axis=0) > 0).any():
            return None
        out[np.ix_(test, known)] = fit(xi[train], residual[np.ix_(train, known)], outputs, settings).mean(xi[test])
    return out
