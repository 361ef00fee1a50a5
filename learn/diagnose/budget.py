"""Error budget: what the nominal model's mean square error is made of, per axis.

    E_nominal = noise + physics + process + unexplained

    physics      E_nominal - E_model             what the effects in the model take off; negative where they do harm
    process      E_model - E_model+GP            what a Gaussian process of the commanded wrench takes off what is left
    noise        min(sigma_noise^2, E_left)      sensor noise that passes the filter (`learn.data.measurement`)
    unexplained  E_left - noise                  the rest, E_left being what model and process leave

The process is fitted on other blocks of time than those on which it is judged: blocks go to `FOLDS` folds in turn. On
an axis where it does not take anything off beyond chance (paired t over blocks, docs/decisions/0006-blocks.md) it is
not used and its part is zero: there it has learnt noise, and would do harm. It is a small process, made to see how
much structure there is, not to fly with; `wrenchgap learn` makes better ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import AXES
from wrenchgap.learn.identify.fit import Dataset
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.learn.process.train import fit

Array = NDArray[np.float64]
Source = Literal["fitted", "given", "none"]

POINTS = 150
FOLDS = 4
BEYOND_CHANCE = 2.0
"""Paired t over blocks above which the process is believed on an axis."""
PARTS = ("noise", "physics", "process", "unexplained")


@dataclass(frozen=True)
class Budget:
    """Mean squares (6,) [N^2, Nm^2] that add up to `nominal`; `weights` (6,) put them on one scale.

    `source` says which process is meant: "fitted" here and judged on blocks that it had not seen, "given", or "none".
    """

    nominal: Array
    noise: Array
    physics: Array
    process: Array
    unexplained: Array
    weights: Array
    source: Source

    def shares(self) -> dict[str, Array]:
        """Parts as fractions of the nominal error (6,), by name."""
        return {name: getattr(self, name) / np.maximum(self.nominal, 1e-300) for name in PARTS}

    def whole(self) -> dict[str, float]:
        """The same for all axes together, newtons and newton metres on one scale."""
        scale = self.weights**2
        total = max(float(self.nominal @ scale), 1e-300)
        return {name: float(getattr(self, name) @ scale) / total for name in PARTS}

    def to_json(self) -> dict[str, Any]:
        """Mean squares by part, and shares of the whole."""
        parts = {name: getattr(self, name).tolist() for name in ("nominal", *PARTS)}
        return {"mean_square": parts, "whole_shares": self.whole(), "process_source": self.source}


def budget(data: Dataset, nominal: Array, left: Array, process: Array | None, source: Source) -> Budget:
    """Budget of residuals (K, 6): of the nominal model, of the model, and the process's prediction of the latter.

    `process` (K, 6) is None where there is none; a given one counts wherever it helps at all.
    """
    squares = [np.mean(r**2, axis=0) for r in (nominal, left)]
    after = squares[1]
    if process is not None:
        better = np.mean((left - process) ** 2, axis=0)
        least = 0.0 if source == "given" else BEYOND_CHANCE
        believed = (better < after) & (gain_t(data, left, left - process) > least)
        after = np.where(believed, better, after)
    noise = np.minimum(data.noise**2, after)
    return Budget(
        squares[0],
        noise,
        squares[0] - squares[1],
        squares[1] - after,
        after - noise,
        data.weights,
        source if process is not None else "none",
    )


def gain_t(data: Dataset, before: Array, after: Array) -> Array:
    """Paired t over blocks (6,) for the squares of `before` (K, 6) being larger than those of `after`."""
    counts = np.bincount(data.block)
    columns = [np.bincount(data.block, weights=c) / counts for c in (before**2 - after**2).T]
    difference = np.stack(columns, axis=1)
    if len(difference) < 3:
        return np.zeros(before.shape[1])
    spread = difference.std(axis=0, ddof=1) / np.sqrt(len(difference))
    return np.asarray(difference.mean(axis=0) / np.maximum(spread, 1e-300))


def held_out_process(
    data: Dataset,
    residual: Array,
    *,
    inputs: Array | None = None,
    points: int = POINTS,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Array | None:
    """Prediction (K, 6) of a residual (K, 6) by processes that did not see its block of time.

    Inputs are the commanded wrench (K, 6), or `inputs` (K, D). None where the log is too short to hold anything out,
    or the command never moves.
    """
    xi = data.commanded if inputs is None else inputs
    fold = data.block % FOLDS
    every = max(1, int(1.0 / data.independence))  # closer samples say the same
    settings = FitSettings(points=points, restarts=0, mean="constant", seed=seed, pre_thin=1500)
    out = np.zeros_like(residual)
    for f in range(FOLDS):
        test, train = fold == f, np.flatnonzero(fold != f)[::every]
        if progress is not None:
            progress(f, FOLDS)
        if not test.any():
            continue
        if len(train) < 4 * xi.shape[1] or not (np.ptp(xi[train], axis=0) > 0).any():
            return None
        out[test] = fit(xi[train], residual[train], AXES, settings).mean(xi[test])
    return out
