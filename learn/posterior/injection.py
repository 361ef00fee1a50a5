"""Effects that are added to flights as they were measured: whether a search finds them where their limits say so.

The wrench of an effect goes into the measured one; commands and motion stay (docs/theory/posterior.md).
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.data.prediction import Evaluator
from wrenchgap.learn.identify.least_squares import left_by
from wrenchgap.learn.posterior.detection_limits import DetectionLimit, Flown
from wrenchgap.learn.posterior.relinearisation import spectrum_of
from wrenchgap.learn.posterior.score import Scorer
from wrenchgap.learn.posterior.single_effects import ModelResidual
from wrenchgap.plant.effects import family, find
from wrenchgap.plant.model import Model
from wrenchgap.plant.wrench_model import ModelEffect

SHARES = (1.0, 0.5)
"""Of its limit at which an effect is injected, in turn: there it should be firm; at half of it, no other should be."""


@dataclass(frozen=True)
class Recovery:
    """What the search said of flights with an effect injected at `share` of its limit: whether it was `firm`, and other
    names that were, and are not without it.
    """  # noqa: D205

    effect: str
    parameter: str
    unit: str
    size: float
    share: float
    firm: bool
    others: tuple[str, ...]

    @property
    def as_stated(self) -> bool:
        """Whether it was firm where it should be, and no other name was."""
        return not self.others and (self.firm or self.share < 1.0)


@dataclass(frozen=True)
class Injection:
    """An effect of which the parameters change by `change` (P,)."""

    effect: str
    change: Array

    def into(self, records: Sequence[Record], model: Model) -> tuple[Record, ...]:
        """The records with what it adds to `model`'s prediction in what they measured; commands and motion stay."""
        changed = ModelEffect(find(self.effect), model.theta(self.effect) + self.change)
        models = model.with_replaced([changed]).wrench_model, model.wrench_model
        out = []
        for record in records:
            more, given = map(Evaluator(record), models)
            out.append(replace(record, measured=record.measured + more - given))
        return tuple(out)


def recoveries(
    limits: Sequence[DetectionLimit],
    firm: Sequence[str],
    model: Model,
    number: int,
    seed: int,
    search: Callable[[Injection], Sequence[str]],
) -> tuple[Recovery, ...]:
    """Inject effects at their limits, and at half of them, and search again, so many times; limits are drawn by lot.

    `firm` are the names without an injection; `search` returns those with it.
    """
    order = np.random.default_rng(seed).permutation([k for k, limit in enumerate(limits) if limit.shown])
    out = []
    for limit, share in [(limits[k], share) for k in order for share in SHARES][:number]:
        own, again = family(limit.effect), search(injection(limit, share, model))
        others = tuple(n for n in again if n != own and n not in firm)
        size = share * limit.size
        out.append(Recovery(limit.effect, limit.parameter, limit.unit, size, share, own in again, others))
    return tuple(out)


def injection(limit: DetectionLimit, share: float, model: Model) -> Injection:
    """At a share of a limit; parameters that do nothing by themselves are where it says, or where fits begin."""
    parameters = find(limit.effect).parameters(model.vehicle)
    where = dict(limit.where)
    change = np.array([0.0 if p.alone else where.get(p.name, p.start) for p in parameters])
    change[[p.name for p in parameters].index(limit.parameter)] = share * limit.size
    return Injection(limit.effect, change)


def with_injection(on: ModelResidual, scorer: Scorer) -> Flown:
    """What scores these flights with a limit in what they measured, on the same straight lines.

    What commands answer is worked out anew, from what the change has moved: products of the flights without it do not
    know that.
    """
    space, given = scorer.spectrum, on.data

    def flown(limit: DetectionLimit, candidates: Collection[str]) -> Scorer:
        data = dataset(injection(limit, 1.0, on.model).into(given.records, on.model), on.model, given.answering)
        there = replace(on, data=data, left=left_by(data, on.model))
        return scorer.on(spectrum_of(there, [c for k, c in space.columns.items() if k in candidates], space.factors))

    return flown
