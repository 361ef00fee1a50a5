"""Which changes: the search over sets of `learn.posterior`, with changes on suspect flights as its candidates.

A change of the mean of a flight can always be said to be trim. What a set is worth is therefore the log odds in all,
trims and their prior included, and not what it takes off what is left, which trims would take off as well. Two sets are
one class where they differ by less than `indistinct` standard errors of everything that is always there.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.changed.linearised_effects import relinearised_at
from wrenchgap.learn.changed.pooled_flights import PooledFlights
from wrenchgap.learn.changed.priors import change_prior
from wrenchgap.learn.changed.propeller import read
from wrenchgap.learn.changed.relinearise import relinearised
from wrenchgap.learn.identify.fit import MATERIAL
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.equivalence_classes import (
    EquivalenceClass,
    NamedSet,
    checks_between,
    grouped,
    merged_by_names,
)
from wrenchgap.learn.posterior.posterior import Posterior
from wrenchgap.learn.posterior.score import Keys, Scored, Scorer
from wrenchgap.learn.posterior.scored_sets import (
    Part,
    ScoredSet,
    described,
    part,
    pruned,
    shares,
    weights,
)
from wrenchgap.learn.posterior.spectrum import Spectrum
from wrenchgap.learn.posterior.subset_search import SubsetSearch, ordered, searched
from wrenchgap.plant.effects import find
from wrenchgap.plant.vehicle import Vehicle

FAR = 0.3
"""Change from where it was linearised, in sizes of its prior (of a lag outside the best set, of itself where that is
more), that calls for new derivatives.
"""


class ChangeScorer(Scorer):
    """Scores sets of changes; some changes are rarer than others (`learn.changed.priors`)."""

    def __init__(self, spectrum: Spectrum, reference: Array) -> None:
        super().__init__(spectrum, reference)
        self.described: dict[Keys, ScoredSet] = {}
        """Sets of which everything is said already."""

    def on(self, spectrum: Spectrum) -> Self:
        """The same scorer on another spectrum of the same columns."""
        other = super().on(spectrum)
        other.described = {}
        return other

    def prior_of(self, keys: Keys) -> float:
        """Log probability of the set before any flight."""
        return super().prior_of(keys) - sum(change_prior(n).price for k in keys for n in self.spectrum.columns[k].names)


@dataclass(frozen=True)
class Weighed:
    """Sets of changes with their weights; the scorer that says more of each. With `settled` the heaviest set is near
    where it was linearised.
    """  # noqa: D205

    posterior: Posterior
    scorer: ChangeScorer
    pool: PooledFlights
    suspects: tuple[int, ...]
    settled: bool

    @property
    def nothing(self) -> float:
        """Weight of the set in which nothing changed."""
        return sum(s.weight for s in self.posterior.sets if not s.names)


def weigh(pool: PooledFlights, suspects: Collection[int], jobs: int = 1, rounds: int = 6) -> Weighed:
    """Weigh sets of changes on these flights of a pool that was calibrated on the others.

    Changes are linearised where their laws are, then where they are found: of what happens to commands by itself (two
    lags that are each half right make up for what their lines lack), and everything beside the best set; what is then,
    after so many `rounds`, still far from there is not established.
    """
    rows, vehicle, turned = pool.rows(suspects), pool.model.vehicle, False
    for number in range(rounds):
        scorer = searched(pool.spectrum(tuple(one.change(rows) for one in pool.laws), suspects), ChangeScorer, jobs)
        late, far = _late(scorer, vehicle), _moved(scorer)
        if number + 1 == rounds or not (late or far):
            break
        turned = turned or far
        if turned:
            best = ordered(scorer)[0].theta
            changes = {n: read(vehicle, n, len(theta)) @ theta for n, theta in best.items()}
            pool = relinearised(pool, suspects, changes, late, jobs)
        else:
            renewed = [
                relinearised_at(pool.data, pool.model, o, late[o.name]) if o.name in late else o for o in pool.laws
            ]
            pool = replace(pool, laws=tuple(renewed))
    log = ordered(scorer)
    settings = pool.settings
    kept = [s for s in log[: settings.weighed] if s.log_probability > log[0].log_probability - settings.behind]
    described_sets = [scored_set(scorer, s.keys) for s in kept]
    sets = merged_by_names(described_sets, weights(described_sets))
    found = Posterior(sets, classes_of(sets, scorer, vehicle), checks_between(sets, vehicle), settings=settings)
    return Weighed(found, scorer, pool, tuple(suspects), not far)


def worth_a_name(scorer: ChangeScorer, name: str) -> bool:
    """Whether a change by itself is large enough for a name: what is smaller, however well established, is what laws
    are off by from one trajectory to the next.
    """  # noqa: D205
    return float(np.max(np.abs(scorer((name,)).theta[name]) / scorer.spectrum.columns[name].scale)) >= MATERIAL


def _late(scorer: Scorer, vehicle: Vehicle) -> dict[str, Array]:
    """Lags and delays outside the best set that are far from where they were linearised by themselves, with values."""
    best, nothing = ordered(scorer)[0], scorer(()).log_probability
    late: dict[str, Array] = {}
    for name, column in scorer.spectrum.columns.items():
        effect, alone = find(name), scorer((name,))
        lags = effect.place == "commands" and any(p.start != 0.0 for p in effect.parameters(vehicle))
        better = alone.log_probability > nothing
        size = np.maximum(column.scale, np.abs(column.theta))
        if lags and better and name not in best.theta and _far(alone.theta[name], column, size):
            late[name] = alone.theta[name]
    return late


def _moved(scorer: Scorer) -> bool:
    """Whether a change of the best set is far from where it was linearised; gains are straight lines."""
    columns = scorer.spectrum.columns
    bent = {
        name: theta
        for name, theta in ordered(scorer)[0].theta.items()
        if not (find(name).place == "thrusts" and find(name).sparse)
    }
    return any(_far(theta, columns[name], columns[name].scale) for name, theta in bent.items())


def _far(theta: Array, column: Column, size: Array) -> bool:
    return float(np.max(np.abs(theta - column.theta) / size)) > FAR


def scored_set(scorer: ChangeScorer, keys: Keys) -> ScoredSet:
    """All that is said of a set, and what remains of it without what is not worth its price."""

    def idle(some: Keys) -> list[Keys]:
        parts = zip(some, _described(scorer, some).parts, strict=True)
        return [tuple(k for k in some if k != gone) for gone, p in parts if p.evidence <= 0.0]

    leaves = pruned(keys, idle, math.inf)
    described = (_described(scorer, leaf) for leaf in leaves)
    return replace(_described(scorer, keys), leaves=tuple(zip(described, shares(scorer, leaves), strict=True)))


def _described(scorer: ChangeScorer, keys: Keys) -> ScoredSet:
    if keys not in scorer.described:
        scorer.described[keys] = described(scorer, keys, parts_of(scorer, keys))
    return scorer.described[keys]


def parts_of(scorer: Scorer, keys: Keys) -> tuple[Part, ...]:
    """What is said of each change of a set; its evidence is the log odds of the set against the one without it."""
    scored = scorer(keys)
    parts = []
    for key in keys:
        c, theta = scorer.spectrum.columns[key], scored.theta[key]
        odds = scored.log_probability - scorer(tuple(k for k in keys if k != key)).log_probability
        parts.append(part(c, theta, odds, 1.0, scorer.spectrum.settings))
    return tuple(parts)


def classes_of(sets: Sequence[NamedSet], scorer: Scorer, vehicle: Vehicle) -> tuple[EquivalenceClass, ...]:
    """Every set in the class of the heaviest set that it cannot be told from."""
    search = SubsetSearch(scorer, sets[0].scored_set.scored.variance)

    def alike(one: NamedSet, other: NamedSet) -> bool:
        return bool(one.names) == bool(other.names) and apart(search, one, other) < search.settings.indistinct

    return grouped(sets, alike, vehicle)


def apart(search: SubsetSearch, first: NamedSet, second: NamedSet) -> float:
    """Standard errors between two sets' predictions, all that is always there being free to make up for them."""
    weights = changes_only(search, first.scored_set.scored) - changes_only(search, second.scored_set.scored)
    return float(np.sqrt(max(float(weights @ search.whole @ weights), 0.0)))


def changes_only(search: SubsetSearch, scored: Scored) -> Array:
    """Weights (Q,) of a set's own columns in the stacked quantities."""
    out = np.zeros_like(scored.weights)
    for key in scored.keys:
        mine = np.append(search.space.parameters[key], search.space.offset[key])
        out[mine] = scored.weights[mine]
    return out
