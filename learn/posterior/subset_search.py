"""The search over sets: with the noise's spectrum held fixed every set is a small solve, and thousands are tried.

What is always there is eliminated once. All pairs are scored; then, as long as a better set is found, the best few sets
are changed by one effect: one less, and instead of each or beside all those that promise most. There is no limit to
their number but the evidence.
"""

from __future__ import annotations

import copy
import itertools
from collections.abc import Collection, Sequence

import numpy as np

from wrenchgap.flight.flight import Array, Indices
from wrenchgap.learn.posterior import kernels
from wrenchgap.learn.posterior.columns import compatible, compatible_with, confused
from wrenchgap.learn.posterior.linear_problem import LinearProblem
from wrenchgap.learn.posterior.score import Keys, Scored, Scorer


def with_fit_discounted(log_probability: float, prior: float, fit_counts: float) -> float:
    """The log probability of a set where straight lines are not to be trusted: what bends costs a plain set some of its
    fit, and more effects than there are make up for it. Fits count only this share therefore.
    """  # noqa: D205
    return prior + fit_counts * (log_probability - prior)


class SubsetSearch:
    """Scores of sets at fixed variances of the noise, and the search over them."""

    def __init__(self, scorer: Scorer, variance: Array) -> None:
        self.scorer, self.space, self.variance = scorer, scorer.spectrum, variance
        self.settings = scorer.spectrum.settings
        self.whole = scorer.eliminated(variance)
        columns = scorer.spectrum.columns
        names = tuple(columns)
        self.alone = {n for n in names if compatible((n,), columns)}
        self.others = {n: frozenset(compatible_with(n, names, columns)) for n in names}
        self.scores: dict[Keys, float] = {(): 0.0}
        self.priors: dict[Keys, float] = {(): 0.0}

    def on(self, scorer: Scorer) -> SubsetSearch:
        """The same search with another scorer of the same columns, with no set scored."""
        other = copy.copy(self)
        other.scorer, other.space = scorer, scorer.spectrum
        other.whole = scorer.eliminated(self.variance)
        other.scores, other.priors = {(): 0.0}, {(): 0.0}
        return other

    def score(self, keys: Sequence[str]) -> float:
        """Log probability of a set, that of the empty one being zero; minus infinity for what cannot be one."""
        keys = tuple(sorted(keys))
        if keys not in self.scores:
            self.scores[keys] = self._score(keys) if self._possible(keys) else -np.inf
        return self.scores[keys]

    def _possible(self, keys: Keys) -> bool:
        """`compatible`, which asks of any two of them and of each by itself."""
        pairs = itertools.combinations(keys, 2)
        return self.alone.issuperset(keys) and all(second in self.others[first] for first, second in pairs)

    def _score(self, keys: Keys) -> float:
        space = self.space
        unknown, fixed, sizes, accuracy = self._rows(keys)
        limits = space.low[unknown], space.high[unknown], space.scale[unknown], space.place[unknown]
        fitted, width, further = kernels.score(self.whole, unknown, fixed, sizes, *limits, accuracy)
        self.priors[keys] = width + self.scorer.prior_of(keys, further)
        return float(fitted + self.priors[keys])

    def _rows(self, keys: Keys) -> tuple[Indices, Indices, Indices, Array]:
        """Of a set: rows of its parameters and of what is fixed; sizes of its members, and how well laws are known."""
        space = self.space
        parameters = [space.parameters[k] for k in keys]
        fixed = np.array([0, *(space.offset[k] for k in keys)], dtype=np.intp)
        sizes = np.array([len(p) for p in parameters], dtype=np.intp)
        accuracy = np.array([space.columns[k].accuracy for k in keys], dtype=float)
        return np.concatenate([np.zeros(0, np.intp), *parameters]), fixed, sizes, accuracy

    def run(self, rounds: int = 30) -> list[Keys]:
        """All sets that were scored, best first; sets are changed in so many `rounds` at most."""
        names = list(self.space.columns)
        for first, second in itertools.combinations(names, 2):
            self.score((first, second))
        for name in names:
            self.score((name,))
        changed: set[Keys] = set()
        for _ in range(rounds):
            front = [keys for keys in self.best()[: self.settings.beam] if keys not in changed]
            if not front:
                break
            for keys in front:
                changed.add(keys)
                self._change(keys)
        return self.best()

    def best(self) -> list[Keys]:
        """Sets that can be, best first."""
        return sorted((k for k, v in self.scores.items() if np.isfinite(v)), key=lambda k: -self.scores[k])

    def plain(self) -> list[Keys]:
        """Sets that would be best if fits counted less (`with_fit_discounted`)."""
        counts = self.settings.fit_counts
        return sorted(self.best(), key=lambda k: -with_fit_discounted(self.scores[k], self.priors[k], counts))

    def _change(self, keys: Keys) -> None:
        """Score sets that differ by one effect: one less, and instead or beside the rest those that promise most, and
        those, one or two of them, that are known to be confused with what went. What cannot stand beside the new ones
        goes with it.
        """  # noqa: D205
        for gone in (None, *keys):
            rest = tuple(k for k in keys if k != gone)
            self.score(rest)
            alike = [] if gone is None else [a for a in confused(gone, self.space.columns) if a not in keys]
            single = [(n,) for n in dict.fromkeys([*self.promising(rest), *alike])]
            for new in (*single, *itertools.combinations(alike, 2)):
                self.score((*(k for k in rest if all(k in self.others[n] for n in new)), *new))

    def promising(self, keys: Keys, among: Collection[str] | None = None) -> list[str]:
        """What would take most off what a set leaves, of all others or those `among` them, to second order and without
        bounds.
        """  # noqa: D205
        space = self.space
        wanted = [n for n in (space.columns if among is None else among) if n not in keys]
        others = {n: space.rows(n) for n in wanted}
        if not others:
            return []
        unknown, fixed, _, _ = self._rows(keys)
        starts = np.cumsum([0, *(len(rows) for rows in others.values())])
        rows = np.concatenate(list(others.values()))
        gained = kernels.gains(self.whole, unknown, fixed, rows, starts, space.scale)
        return [n for _, n in sorted(zip(-gained, others, strict=True))][: self.settings.promising]


def searched(space: LinearProblem, jobs: int = 1) -> Scorer:
    """A scorer that has scored the sets which flights make likely: at the noise that everything at once leaves, and
    again at what the best set leaves. Blocks of time that are far louder than others have lost weight.
    """  # noqa: D205
    reference, weights = space.saturated()
    space.calm(weights)
    first = Scorer(space, reference)
    search(first, jobs)
    second = Scorer(space, ordered(first)[0].left)
    search(second, jobs)
    return second


def search(scorer: Scorer, jobs: int = 1, rounds: int = 4) -> None:
    """Score what searches find, with the spectrum that the best leaves, until the best stays the best."""
    scorer(())
    variance, last = scorer.variance, None
    for _ in range(rounds):
        found = SubsetSearch(scorer, variance)
        scorer.many((*found.run()[: found.settings.weighed], *found.plain()[: found.settings.plainest]), jobs)
        best = ordered(scorer)[0]
        if best.keys == last:
            break
        last, variance = best.keys, best.variance


def ordered(scorer: Scorer) -> list[Scored]:
    """Scored sets, the likeliest first."""
    return sorted(scorer.known.values(), key=lambda s: -s.log_probability)
