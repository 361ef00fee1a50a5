"""Classes of explanations: sets that predict the same on these flights are one explanation in several words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.posterior.discriminating_tests import Check, discriminating_tests
from wrenchgap.learn.posterior.score import Scorer
from wrenchgap.learn.posterior.scored_sets import ScoredSet
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import Vehicle

LIGHT = 0.005
"""Weight below which a set is not worth a line."""
LATE_CLOCK = "late_clock"
"""Name, in sets and of its check, of what is no effect: late stamps of the IMU (`learn.posterior.late_clock`)."""


@dataclass(frozen=True)
class NamedSet:
    """A set by the names of its effects, with the weight of all sets that name the same.

    `scored_set` is the heaviest of those; `trust` says for each name how much of its evidence what is left unexplained
    could not have made. `stands_for` are names of what is no effect of the catalogue, with the effect that was fitted.
    """

    names: tuple[str, ...]
    weight: float
    scored_set: ScoredSet
    stands_for: tuple[tuple[str, str], ...] = ()

    @property
    def trust(self) -> dict[str, float]:
        """By name."""
        found = {n: p.trust for p in self.scored_set.parts if p.named for n in p.names}
        return found | {name: found[effect] for name, effect in self.stands_for}

    def theta(self, model: Model) -> dict[str, Array]:
        """Parameters of the named effects, where the set fits best, by effect."""
        own = {e.name: e.theta for e in model.effects}
        out: dict[str, Array] = {}
        for part in self.scored_set.parts:
            at = 0
            for name in part.names:
                size = len(find(name).parameters(model.vehicle))
                out[name] = part.theta[at : at + size] + own.get(name, np.zeros(size))
                at += size
        return {name: out[name] for name in self.names if name in out}

    def values(self, vehicle: Vehicle) -> dict[str, dict[str, float]]:
        """Fitted parameters by effect and name; of an effect that the model has already, their changes."""
        out: dict[str, dict[str, float]] = {}
        for part in self.scored_set.parts:
            left = list(part.theta)
            for name in part.names:
                known = find(name).parameters(vehicle)
                out[name] = {p.name: float(v) for p, v in zip(known, left, strict=False)}
                left = left[len(known) :]
        return {name: out[name] for name in self.names if name in out}


@dataclass(frozen=True)
class EquivalenceClass:
    """Sets that these flights cannot tell apart, heaviest first, and their weight together; what would tell them."""

    weight: float
    sets: tuple[NamedSet, ...]
    settle: tuple[Check, ...] = ()

    @property
    def established(self) -> tuple[str, ...]:
        """Effects on which all of its sets agree."""
        common = set.intersection(*(set(s.names) for s in self.sets))
        return tuple(n for n in self.sets[0].names if n in common)


def merged_by_names(scored_sets: Sequence[ScoredSet], share: Array) -> tuple[NamedSet, ...]:
    """Sets with the same names put together, heaviest first."""
    together: dict[frozenset[str], list[tuple[float, ScoredSet]]] = {}
    for whole, weight in zip(scored_sets, share, strict=True):
        for leaf, part in whole.leaves:
            together.setdefault(frozenset(leaf.names), []).append((float(weight) * part, leaf))
    heaviest = [max(listed, key=lambda pair: pair[0])[1] for listed in together.values()]
    total = [sum(weight for weight, _ in listed) for listed in together.values()]
    sets = [NamedSet(leaf.names, weight, leaf) for leaf, weight in zip(heaviest, total, strict=True)]
    sets.sort(key=lambda s: -s.weight)
    return tuple(s for k, s in enumerate(sets) if k == 0 or s.weight >= LIGHT)


def one_per_names(sets: Sequence[NamedSet]) -> tuple[NamedSet, ...]:
    """Sets with the same names put together, heaviest first."""
    by_names: dict[frozenset[str], list[NamedSet]] = {}
    for s in sets:
        by_names.setdefault(frozenset(s.names), []).append(s)
    joined = [
        replace(max(alike, key=lambda s: s.weight), weight=sum(s.weight for s in alike)) for alike in by_names.values()
    ]
    return tuple(sorted(joined, key=lambda s: -s.weight))


def equivalence_classes(sets: Sequence[NamedSet], scorer: Scorer, vehicle: Vehicle) -> tuple[EquivalenceClass, ...]:
    """Every set in the class of the heaviest set that predicts the same."""
    return grouped(sets, lambda one, other: predict_the_same(one.scored_set, other.scored_set, scorer), vehicle)


def grouped(
    sets: Sequence[NamedSet], alike: Callable[[NamedSet, NamedSet], bool], vehicle: Vehicle
) -> tuple[EquivalenceClass, ...]:
    """Every set in the class of the first set that it is `alike`, or a class of its own; heaviest class first."""
    groups: list[list[NamedSet]] = []
    for s in sets:
        home = next((g for g in groups if alike(g[0], s)), None)
        if home is None:
            groups.append([s])
        else:
            home.append(s)
    found = [EquivalenceClass(sum(s.weight for s in g), tuple(g), checks_between(g, vehicle)) for g in groups]
    return tuple(sorted(found, key=lambda c: -c.weight))


def checks_between(sets: Sequence[NamedSet], vehicle: Vehicle, least: float = 0.02) -> tuple[Check, ...]:
    """What would settle which of several sets is true, of those that weigh this much; nothing where there is one."""
    shown = [s for s in sets if s.names and s.weight >= least and not s.stands_for]
    if len(shown) < 2:
        return ()
    return discriminating_tests(
        [s.names for s in shown], [s.weight for s in shown], [s.values(vehicle) for s in shown], vehicle
    )


def predict_the_same(first: ScoredSet, second: ScoredSet, scorer: Scorer) -> bool:
    """Whether two predictions differ by less than noise shows, or than laws are known to."""
    space = scorer.spectrum
    weight = scorer.count / np.maximum(space.count, 1.0) / np.minimum(first.scored.variance, second.scored.variance)
    weight = weight[space.band]

    def size(square: Array) -> float:
        return float(np.sqrt(np.sum(weight * square)))

    difference = size((first.predicted - second.predicted) ** 2)
    return difference < max(
        space.settings.indistinct, 2.0 * min(size(c.scored.inexact[space.band]) for c in (first, second))
    )
