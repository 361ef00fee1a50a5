"""Which physical effect a Gaussian process is absorbing, if any.

A GP that is learnt on a model is a change c(W_cmd) of the predicted wrench. So is every effect of the catalogue: fitted
alone to what the model leaves, it changes the prediction by e. On the axes that the GP knows, over the flights that
it was learnt on, with the weights w of `learn.data.dataset.Dataset`,

    cosine = <e, c>_w / (|e|_w |c|_w)         whether the two changes look alike
    share  = 1 - |c - e|_w^2 / |c|_w^2        how much of the GP's correction the effect reproduces

e is evaluated on blocks of time that its fit did not see, and has one to twelve parameters where the GP has hundreds of
points: an effect that reproduces most of the correction is what the GP has learnt. It is named if it reproduces at
least half of it and takes error off the measurement beyond chance: a paired t over blocks
(docs/decisions/0006-blocks.md), a smaller one where half of the error goes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.arguments import Progress
from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import Array, Indices
from wrenchgap.learn.data.blocks import SIGNIFICANCE, by_block, paired_t, significant
from wrenchgap.learn.data.candidates import inapplicable, unexcited
from wrenchgap.learn.data.dataset import Dataset, dataset, spread_out
from wrenchgap.learn.data.errors import energy, rms
from wrenchgap.learn.data.prediction import Process, pooled_inputs
from wrenchgap.learn.identify.fit import MATERIAL, Fit, fit, held_out
from wrenchgap.plant.effects import catalogue, family
from wrenchgap.plant.history import Value
from wrenchgap.plant.mismatch import output_indices
from wrenchgap.plant.model import Model


@dataclass(frozen=True)
class Absorbed:
    """One effect against the GP: cosine and share of the two changes.

    `t` is that of the error that the effect takes off the measurement; `named` where all of that is clear.
    """

    name: str
    fit: Fit
    cosine: float
    share: float
    t: float
    named: bool

    @property
    def values(self) -> tuple[Value, ...]:
        """Its parameters as fitted."""
        return self.fit.values(self.name)


@dataclass(frozen=True)
class Absorption:
    """What a GP absorbs: `effects` are one name, or several that do equally well, or none; `tried` all, by share.

    `size` (6,) is the rms of the GP's correction, not a number on axes that it does not know.
    """

    effects: tuple[str, ...]
    tried: tuple[Absorbed, ...]
    size: Array

    @property
    def first(self) -> Absorbed | None:
        """The effect that is named first."""
        return next((a for a in self.tried if self.effects and a.name == self.effects[0]), None)


def absorbed(
    data: Dataset,
    model: Model,
    gp: Process,
    *,
    names: Sequence[str] | None = None,
    progress: Progress | None = None,
    seconds: float = 60.0,
) -> Absorption:
    """Compare the GP that was learnt on `model` from `data` with every effect that `model` does not have.

    Effects are fitted on at most so many `seconds` of flight, in pieces spread over all of it.
    """
    some = spread_out(data.records, seconds)
    data = data if some is data.records else dataset(some, model)
    every = output_indices(gp.outputs)
    correction = gp.mean(pooled_inputs(gp.input_groups, data.records))
    size = np.full(6, np.nan)
    size[every] = rms(correction)
    rows, correction = every[data.measured_axes[every]], correction[:, data.measured_axes[every]]
    if not len(rows):
        return Absorption((), (), size)
    try:
        base = fit(data, model, ())
        given = held_out(data, model, (), base)
    except FitError:  # too short to hold anything out
        return Absorption((), (), size)
    guard = _Guard(data, correction, rows)
    found: list[tuple[Absorbed, Array]] = []
    present = {e.name for e in model.effects}
    others = [n for n in (names or catalogue()) if n not in present and inapplicable(n, model, data.records) is None]
    tried = [n for n in others if unexcited(n, model, data.records) is None]
    for k, name in enumerate(tried):
        if progress is not None:
            progress(k / len(tried), f"does the GP absorb {name}?")
        fitted = fit(data, model, (name,), base=base)
        left = held_out(data, model, (name,), fitted)
        found.append(guard.compare(name, fitted, given, left))
    found.sort(key=lambda pair: -pair[0].share)
    return Absorption(guard.choose(found), tuple(one for one, _ in found), size)


class _Guard:
    """Changes (K, L) on the axes that the GP knows, compared block by block."""

    def __init__(self, data: Dataset, correction: Array, rows: Indices) -> None:
        self.rows = rows
        self.weights = data.weights[rows]
        self.correction = correction
        self.block = data.block
        self.energy = energy(correction, self.weights)

    def t_value(self, worse: Array, better: Array) -> float:
        """Paired t over blocks for `worse` (K, L) being larger than `better`."""
        return float(paired_t(by_block(self.block, ((worse**2 - better**2) * self.weights**2).sum(axis=1))))

    def compare(self, name: str, fitted: Fit, given: Array, left: Array, clear: float = 0.5) -> tuple[Absorbed, Array]:
        """One effect, and what of the correction it does not reproduce (K, L).

        It is named from a share of `clear` of the correction on that it reproduces.
        """
        before, after = given[:, self.rows], left[:, self.rows]
        change = before - after
        rest = self.correction - change
        product = float(np.sum(change * self.correction * self.weights**2))
        lengths = np.sqrt(energy(change, self.weights) * self.energy)
        share = 1.0 - energy(rest, self.weights) / max(self.energy, 1e-30)
        t = self.t_value(before, after)
        large = any(abs(v) >= MATERIAL * p.scale for (_, p), v in zip(fitted.parameters, fitted.theta, strict=True))
        halved = energy(after, self.weights) < 0.5 * energy(before, self.weights)
        named = share >= clear and significant(t, large=halved) and large and not fitted.at_bound
        return Absorbed(name, fitted, product / max(float(lengths), 1e-30), share, t, named), rest

    def choose(self, found: Sequence[tuple[Absorbed, Array]], as_good: float = 0.1) -> tuple[str, ...]:
        """The best of those that are clear, and others that the blocks do not tell from it; fewest parameters first.

        These reproduce a share that is smaller by less than `as_good`.
        """
        clear = [pair for pair in found if pair[0].named]
        if not clear:
            return ()
        best, rest = clear[0]
        equal = [
            one
            for one, other in clear
            if one is best or (one.share > best.share - as_good and self.t_value(other, rest) < SIGNIFICANCE.indistinct)
        ]
        order = sorted(equal, key=lambda a: (len(a.fit.theta), -a.share))
        first = {family(one.name): one.name for one in reversed(order)}  # one form of each effect
        return tuple(one.name for one in order if first[family(one.name)] == one.name)
