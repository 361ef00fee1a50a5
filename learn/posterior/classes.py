"""Classes of explanations: sets that predict the same on these flights are one explanation in several words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.posterior.score import DISCREPANCY, Scorer
from wrenchgap.learn.posterior.sets import Contender

LIGHT = 0.005
"""Weight below which a set is not worth a line."""
NEAR = 3.0
"""Difference of two predictions, in standard errors, that flights cannot show."""


@dataclass(frozen=True)
class NamedSet:
    """A set by the names of its effects, with the weight of all sets that name the same.

    `contender` is the heaviest of those; `trust` says for each name how much of its evidence what is left unexplained
    could not have made.
    """

    names: tuple[str, ...]
    weight: float
    contender: Contender

    @property
    def trust(self) -> dict[str, float]:
        """By name."""
        return {n: p.trust for p in self.contender.parts if p.named for n in p.names}

    def theta(self, name: str) -> Array:
        """Fitted parameters (P,) of the candidate that an effect belongs to."""
        return next(p.theta for p in self.contender.parts if name in p.names)


@dataclass(frozen=True)
class Class:
    """Sets that these flights cannot tell apart, heaviest first, and their weight together."""

    weight: float
    sets: tuple[NamedSet, ...]

    @property
    def established(self) -> tuple[str, ...]:
        """Effects on which all of its sets agree."""
        common = set.intersection(*(set(s.names) for s in self.sets))
        return tuple(n for n in self.sets[0].names if n in common)


def merged(contenders: Sequence[Contender], share: Array) -> tuple[NamedSet, ...]:
    """Sets with the same names put together, heaviest first."""
    together: dict[frozenset[str], list[int]] = {}
    for k in np.argsort(-share):
        together.setdefault(frozenset(contenders[k].names), []).append(int(k))
    sets = [NamedSet(contenders[ks[0]].names, float(share[ks].sum()), contenders[ks[0]]) for ks in together.values()]
    sets.sort(key=lambda s: -s.weight)
    return tuple(s for k, s in enumerate(sets) if k == 0 or s.weight >= LIGHT)


def classes(sets: Sequence[NamedSet], scorer: Scorer) -> tuple[Class, ...]:
    """Put every set into the class of the heaviest set that predicts the same, or begin a new one."""
    groups: list[list[NamedSet]] = []
    for s in sets:
        home = next((g for g in groups if same(g[0].contender, s.contender, scorer)), None)
        if home is None:
            groups.append([s])
        else:
            home.append(s)
    found = [Class(sum(s.weight for s in g), tuple(g)) for g in groups]
    return tuple(sorted(found, key=lambda c: -c.weight))


def same(first: Contender, second: Contender, scorer: Scorer) -> bool:
    """Whether two predictions differ by less than noise shows, or than laws are known to."""
    space = scorer.spectrum
    weight = scorer.count / np.maximum(space.count, 1.0) / np.minimum(first.scored.variance, second.scored.variance)
    weight = weight[space.band]

    def size(predicted: Array) -> float:
        return float(np.sqrt(np.sum(weight * predicted**2)))

    difference = size(first.predicted - second.predicted)
    return difference < max(NEAR, 2.0 * DISCREPANCY * min(size(first.predicted), size(second.predicted)))
