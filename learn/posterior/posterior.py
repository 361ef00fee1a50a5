"""The posterior over sets of effects: what is established, what is open, and what would settle it.

Sets with the same names are one; sets that predict the same on these flights are one class, an explanation in several
words.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.posterior.columns import by_effect
from wrenchgap.learn.posterior.discriminating_tests import Check, discriminating_tests
from wrenchgap.learn.posterior.score import Scorer
from wrenchgap.learn.posterior.scored_sets import ScoredSet
from wrenchgap.learn.posterior.settings import DEFAULT, SearchSettings
from wrenchgap.plant.effects import family, find
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import Vehicle

LIGHT = 0.005
"""Weight below which a set is not worth a line."""
T = TypeVar("T")


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

    def changes(self, vehicle: Vehicle) -> dict[str, Array]:
        """Parameters of the named effects where the set fits best, counted from what the model has, by effect."""
        out: dict[str, Array] = {}
        for part in self.scored_set.parts:
            out |= by_effect(part.theta, part.names, vehicle)
        return {name: out[name] for name in self.names if name in out}

    def theta(self, model: Model) -> dict[str, Array]:
        """The same as they are in all."""
        return {name: change + model.theta(name) for name, change in self.changes(model.vehicle).items()}

    def values(self, vehicle: Vehicle) -> dict[str, dict[str, float]]:
        """`changes` by effect and name."""
        return {
            name: {p.name: float(v) for p, v in zip(find(name).parameters(vehicle), change, strict=False)}
            for name, change in self.changes(vehicle).items()
        }


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


@dataclass(frozen=True)
class Posterior:
    """Named sets, heaviest first, their classes, what would settle which is true, and the search's `settings`."""

    sets: tuple[NamedSet, ...]
    classes: tuple[EquivalenceClass, ...]
    settle: tuple[Check, ...]
    settings: SearchSettings = DEFAULT

    @property
    def best(self) -> NamedSet:
        """The heaviest set of the heaviest class."""
        return self.classes[0].sets[0]

    def probability(self, names: Iterable[str]) -> float:
        """That one of these effects, in any form, is there."""
        return min(self.settings.certain, trusted_weight(self.sets, ((n,) for n in names)))

    @property
    def firm(self) -> tuple[str, ...]:
        """Names that are in nine tenths of the weight and in every likely set of their class; of an effect with
        several forms that of its family. Between sets that predict the same, weights are priors, and no finding.
        """  # noqa: D205
        named = dict.fromkeys(family(n) for s in self.sets for n in s.names)
        best = self.classes[0].sets if self.classes else ()
        least = self.settings.otherwise * sum(s.weight for s in best)
        likely = [{family(n) for n in s.names} for s in best if s.weight >= least]
        return tuple(f for f in named if self.probability([f]) >= self.settings.firm and all(f in s for s in likely))


def trusted_weight(sets: Sequence[NamedSet], groups: Iterable[Sequence[str]]) -> float:
    """Weight of the sets that name all effects of one of these groups, in any form, as far as each is trusted."""
    wanted = [{family(n) for n in group} for group in groups]

    def trusted(one: NamedSet) -> float:
        trust: dict[str, float] = {}
        for name, value in one.trust.items():
            trust[family(name)] = max(value, trust.get(family(name), 0.0))
        return max((min(trust[f] for f in group) for group in wanted if group <= trust.keys()), default=0.0)

    return sum(s.weight * trusted(s) for s in sets)


def posterior(
    sets: tuple[NamedSet, ...],
    classes: Sequence[EquivalenceClass],
    vehicle: Vehicle,
    settings: SearchSettings,
    causes: Sequence[Check] = (),
) -> Posterior:
    """Of these sets and classes, with what would settle which is true: those of `causes` of which something stands in
    them for effects that were fitted.
    """  # noqa: D205

    def checks(some: Sequence[NamedSet]) -> tuple[Check, ...]:
        standing = {name for s in some for name, _ in s.stands_for}
        first = (c for c in causes if c.name in standing)
        return (*first, *checks_between(some, vehicle))

    return Posterior(sets, tuple(replace(c, settle=checks(c.sets)) for c in classes), checks(sets), settings)


def checks_between(sets: Sequence[NamedSet], vehicle: Vehicle, least: float = 0.02) -> tuple[Check, ...]:
    """What would settle which of several sets is true, of those that weigh this much; nothing where there is one."""
    shown = [s for s in sets if s.names and s.weight >= least and not s.stands_for]
    if len(shown) < 2:
        return ()
    return discriminating_tests(
        [s.names for s in shown], [s.weight for s in shown], [s.values(vehicle) for s in shown], vehicle
    )


@dataclass(frozen=True)
class WeighedSets:
    """What a search over sets hands on: named sets and their classes, before anything else is known of them.

    `wholes` are the heaviest sets with all that they do not need; `scorer` scored the likeliest.
    """

    sets: tuple[NamedSet, ...]
    classes: tuple[EquivalenceClass, ...]
    wholes: tuple[ScoredSet, ...]
    scorer: Scorer

    @property
    def best(self) -> NamedSet:
        """The heaviest set of the heaviest class."""
        return self.classes[0].sets[0]

    def each(self, change: Callable[[Sequence[NamedSet]], tuple[NamedSet, ...]]) -> WeighedSets:
        """The same with the sets, and those of every class, changed."""
        classes = tuple(replace(c, sets=change(c.sets)) for c in self.classes)
        return replace(self, sets=change(self.sets), classes=classes)

    def without(self, name: str) -> WeighedSets:
        """The same where `name` does nothing beside the rest of the best set: it goes from all sets with that rest."""
        rest = set(self.best.names) - {name}

        def shorter(one: NamedSet) -> NamedSet:
            if not rest <= set(one.names):
                return one
            return replace(one, names=tuple(n for n in one.names if dict(one.stands_for).get(n, n) != name))

        return self.each(lambda sets: one_per_names(map(shorter, sets)))

    def at(self, changes: Mapping[str, Array]) -> WeighedSets:
        """The same with the best set's values as they were fitted at last, so that a bench check reads what the answer
        says: `changes` (P,) by effect, of what the model has.
        """  # noqa: D205
        best = self.best
        if not set(best.names) <= set(changes):
            return self
        parts = [
            replace(p, theta=np.concatenate([changes[n] for n in p.names])) if set(p.names) <= set(changes) else p
            for p in best.scored_set.parts
        ]
        new, names = replace(best.scored_set, parts=tuple(parts)), set(best.names)
        return self.each(lambda sets: tuple(replace(s, scored_set=new) if set(s.names) == names else s for s in sets))


def merged_by_names(scored_sets: Sequence[ScoredSet], share: Sequence[float]) -> tuple[NamedSet, ...]:
    """What remains of these sets, which weigh `share` (S,), those with the same names put together, heaviest first."""
    pairs = [(leaf, w * part) for whole, w in zip(scored_sets, share, strict=True) for leaf, part in whole.leaves]
    sets = one_per_names(NamedSet(leaf.names, weight, leaf) for leaf, weight in pairs)
    return tuple(s for k, s in enumerate(sets) if k == 0 or s.weight >= LIGHT)


def one_per_names(sets: Iterable[NamedSet]) -> tuple[NamedSet, ...]:
    """Sets with the same names put together, heaviest first."""
    by_names: dict[frozenset[str], list[NamedSet]] = {}
    for s in sets:
        by_names.setdefault(frozenset(s.names), []).append(s)
    joined = [
        replace(max(alike, key=lambda s: s.weight), weight=sum(s.weight for s in alike)) for alike in by_names.values()
    ]
    return tuple(sorted(joined, key=lambda s: -s.weight))


def equivalence_classes(
    sets: Sequence[NamedSet], alike: Callable[[NamedSet, NamedSet], bool]
) -> tuple[EquivalenceClass, ...]:
    """Sets by class, the heaviest first."""
    found = [EquivalenceClass(sum(s.weight for s in group), tuple(group)) for group in grouped(sets, alike)]
    return tuple(sorted(found, key=lambda c: -c.weight))


def grouped(items: Iterable[T], alike: Callable[[T, T], bool]) -> list[list[T]]:
    """Everything in the group of the first item that it is `alike`, or in a group of its own."""
    groups: list[list[T]] = []
    for item in items:
        home = next((g for g in groups if alike(g[0], item)), None)
        if home is None:
            groups.append([item])
        else:
            home.append(item)
    return groups


def predict_the_same(first: ScoredSet, second: ScoredSet, scorer: Scorer) -> bool:
    """Whether two predictions differ by less than noise shows, or than laws are known to."""
    space = scorer.spectrum
    weight = scorer.count / np.maximum(space.count, 1.0) / np.minimum(first.scored.variance, second.scored.variance)
    weight = weight[space.band]

    def size(square: Array) -> float:
        return float(np.sqrt(np.sum(weight * square)))

    difference = size((first.predicted - second.predicted) ** 2)
    known = min(size(c.scored.inexact[space.band]) for c in (first, second))
    return difference < max(space.settings.indistinct, 2.0 * known)
