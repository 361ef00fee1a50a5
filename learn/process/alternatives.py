"""What a process should look at, and how: alternatives compared on blocks of time that were left out.

Every alternative is fitted to the same samples, and predicts every block from the others
(`learn.process.held_out_time`). Errors of two are compared block by block:

    gain = 1 - rms(b) / rms(a)                      over outputs, each in units of its own mismatch's rms
    t    = mean(d) / (std(d) / sqrt(B))             d (B,): difference of the blocks' mean squares

Groups of inputs are added one after the other, as long as one gains at least `COMPARED.worth_it` beyond chance; then
the other inference is tried.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from wrenchgap.flight.arguments import Progress
from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.blocks import by_block, paired_t, significant
from wrenchgap.learn.data.errors import rms
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.learn.process.held_out_time import CALIBRATION
from wrenchgap.learn.process.train import Found, left_out_errors
from wrenchgap.plant.mismatch_inputs import COLUMNS

Inputs = Callable[[tuple[str, ...]], Array]
"""Groups of inputs -> all inputs (M, D). Raises FitError for a group that the logs do not have."""


@dataclass(frozen=True)
class ComparisonSettings:
    """How alternatives are compared, and when one is better."""

    worth_it: float = 0.1
    """Least gain worth an input that has to be known in flight, or another inference."""
    points: int = 80
    """Points at most, so that a comparison is done within seconds."""
    seen: int = 2_000
    """Samples at most among which these are chosen, and that are predicted: the choice takes the square of them, and
    what decides are differences over 16 blocks of time."""


COMPARED = ComparisonSettings()


@dataclass(frozen=True)
class Alternative:
    """An alternative: its settings, rms (L,) [N, Nm] on left-out blocks, gain and t against what was asked for."""

    settings: FitSettings
    rms: Array
    gain: float
    t: float

    @property
    def worth_it(self) -> bool:
        """Whether it is better beyond chance."""
        return self.gain > COMPARED.worth_it and significant(self.t, large=True)


@dataclass(frozen=True)
class Alternatives:
    """All that were tried, what was asked for first, and the settings that are best."""

    tried: tuple[Alternative, ...]
    best: FitSettings

    @property
    def better(self) -> Alternative | None:
        """The best, where it is not what was asked for."""
        asked = not self.tried or self.best == self.tried[0].settings
        return None if asked else next(c for c in self.tried if c.settings == self.best)


@dataclass
class _Trials:
    """Errors of settings, each fitted once."""

    inputs: Inputs
    outputs: Array
    names: tuple[str, ...]
    progress: Progress | None
    errors: dict[FitSettings, Array] = field(default_factory=dict)
    found: Found = field(default_factory=dict)

    def fit(self, settings: FitSettings) -> bool:
        """Whether this can be fitted, which it then is."""
        if settings in self.errors:
            return True
        if self.progress is not None:
            words = f"comparing inputs: {', '.join(('command', *settings.inputs))}, {settings.inference}"
            self.progress(min(len(self.errors) / 10, 1.0), words)
        points, seen = min(settings.points, COMPARED.points), min(settings.pre_thin, COMPARED.seen)
        quick = replace(settings, restarts=0, points=points, pre_thin=seen)
        try:
            error = left_out_errors(self.inputs(settings.inputs), self.outputs, self.names, quick, self.found)
        except FitError:
            return False
        if error is not None:
            self.errors[settings] = error
        return error is not None

    def choice(self, settings: FitSettings, against: FitSettings) -> Alternative:
        scale = rms(self.outputs) + 1e-12
        error = self.errors[settings]
        before, after = (np.mean((e / scale) ** 2, axis=1) for e in (self.errors[against], error))
        gain = 1.0 - float(np.sqrt(np.mean(after) / max(float(np.mean(before)), 1e-30)))
        t = float(paired_t(by_block(CALIBRATION.block(len(before)), before - after)))
        return Alternative(settings, rms(error), gain, t)

    def better(self, current: FitSettings, others: list[FitSettings]) -> FitSettings:
        """The best of the others that is worth it, else the current."""
        found = [self.choice(s, current) for s in others if self.fit(s)]
        best = max((c for c in found if c.worth_it), key=lambda c: c.gain, default=None)
        return current if best is None else best.settings


def compare_alternatives(
    inputs: Inputs, outputs: Array, names: tuple[str, ...], asked: FitSettings, progress: Progress | None = None
) -> Alternatives:
    """Whether other inputs or the other inference would predict mismatches (M, L) named `names` better than `asked`.

    Groups of inputs that the logs do not have are left out. Nothing is compared where the samples are too few.
    """
    trials = _Trials(inputs, outputs, names, progress)
    if not trials.fit(asked):
        return Alternatives((), asked)
    best = asked
    before = None
    while best != before:
        before = best
        more = [replace(best, inputs=(*best.inputs, name)) for name in COLUMNS if name not in best.inputs]
        best = trials.better(best, more)
    best = trials.better(best, [replace(best, inference="sparse" if best.inference == "exact" else "exact")])
    return Alternatives(tuple(trials.choice(s, asked) for s in trials.errors), best)
