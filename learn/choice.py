"""What a process should look at, and how: alternatives compared on blocks of time that were left out.

Every alternative is fitted to the same samples, and predicts every block from the others (`learn.calibration`). Its
error is put against that of what was asked for, block by block:

    gain = 1 - rms(alternative) / rms(asked)        over outputs, each in units of its own mismatch's rms
    t    = mean(d) / (std(d) / sqrt(B))             d (B,): difference of the blocks' mean squares

An alternative is worth it where it gains at least `WORTH_IT` beyond chance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flight.errors import FitError
from learn.calibration import BLOCKS
from learn.gp import FitSettings
from learn.train import left_out_errors
from plant.mismatch_inputs import COLUMNS

Array = NDArray[np.float64]
Inputs = Callable[[tuple[str, ...]], Array]
"""Groups of inputs -> all inputs (M, D). Raises FitError for a group that the logs do not have."""
Progress = Callable[[float, str], None]

WORTH_IT = 0.1
"""Least gain worth an input that has to be known in flight, or another inference."""
POINTS = 80
"""Points at most in a comparison, to be done within seconds."""
SIGNIFICANT = 2.0
"""Least paired t over blocks."""


@dataclass(frozen=True)
class Choice:
    """An alternative: its settings, rms (L,) [N, Nm] on left-out blocks, and gain and t against what was asked for."""

    settings: FitSettings
    rms: Array
    gain: float
    t: float

    @property
    def worth_it(self) -> bool:
        """Whether it is better beyond chance."""
        return self.gain > WORTH_IT and self.t > SIGNIFICANT


def alternatives(settings: FitSettings) -> list[FitSettings]:
    """What was asked for, the other inference, and each further group of inputs, alone."""
    more = [(*settings.inputs, name) for name in COLUMNS if name not in settings.inputs]
    return [settings, other_inference(settings), *(replace(settings, inputs=groups) for groups in more)]


def other_inference(settings: FitSettings) -> FitSettings:
    """Sparse for exact, exact for sparse."""
    return replace(settings, inference="sparse" if settings.inference == "exact" else "exact")


def best(found: Sequence[Choice]) -> Choice | None:
    """The alternative that gains most, of those that are worth it."""
    return max((c for c in found if c.worth_it), key=lambda c: c.gain, default=None)


def choices(
    inputs: Inputs,
    outputs: Array,
    names: tuple[str, ...],
    tried: Sequence[FitSettings],
    progress: Progress | None = None,
) -> tuple[Choice, ...]:
    """The first of `tried` and how the others compare with it, for mismatches (M, L) named `names`.

    Groups of inputs that the logs do not have are left out. Nothing is compared where the samples are too few.
    """
    scale = np.sqrt(np.mean(outputs**2, axis=0)) + 1e-12
    found: list[tuple[FitSettings, Array]] = []
    for k, settings in enumerate(tried):
        if progress is not None:
            progress(k / len(tried), f"comparing inputs: {', '.join(('command', *settings.inputs))}")
        try:
            quick = replace(settings, restarts=0, points=min(settings.points, POINTS))
            error = left_out_errors(inputs(settings.inputs), outputs, names, quick)
        except FitError:
            if k == 0:
                raise
            continue
        if error is None:
            return ()
        found.append((settings, error))
    first = found[0][1] / scale
    return tuple(Choice(s, np.sqrt(np.mean(e**2, axis=0)), *_gain(first, e / scale)) for s, e in found)


def _gain(asked: Array, other: Array) -> tuple[float, float]:
    """Gain and t of errors (K, L) in common units."""
    before, after = np.mean(asked**2, axis=1), np.mean(other**2, axis=1)
    block = np.arange(len(before)) * BLOCKS // len(before)
    difference = np.bincount(block, weights=before - after) / np.bincount(block)
    spread = float(np.std(difference, ddof=1)) / np.sqrt(len(difference))
    gain = 1.0 - float(np.sqrt(np.mean(after) / max(float(np.mean(before)), 1e-30)))
    return gain, float(np.mean(difference)) / max(spread, 1e-30)
