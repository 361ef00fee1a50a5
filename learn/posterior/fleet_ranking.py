"""Which effects a fleet's model is missing: the search over sets on merged evidence, and cross-validation by flight.

The score of a set is that of `learn.posterior.score` on all flights together; trims are eliminated
(`learn.posterior.fleet_spectrum`). Columns stay where they were linearised: sets are not linearised anew together, as
`explain` does on few flights. What is curved (a lag, a drag in moving air, a payload) is ranked as the straight line at
its declared values, and nearer the truth when the evidence is made anew at the values found (`Ranking.points`).

Flights, and not blocks of time, are what is held out: theta without flight f solves (A - A_f) theta = b - b_f, so
predicting every flight from all others takes no second look at any log. The trim of a flight is its own. Weights of
sets are those of `learn.posterior.scored_sets.weights`, with flights for blocks. What is predicted of held-out flights
stands beside them and is no weight: many flights show how far laws are from exact, and there the more flexible of two
equal sets predicts better.
"""

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.posterior import kernels
from wrenchgap.learn.posterior.columns import Column, compatible
from wrenchgap.learn.posterior.fleet_spectrum import FleetSpectrum, chosen_axes, chosen_rows, products_of
from wrenchgap.learn.posterior.flight_evidence import Evidence, Points
from wrenchgap.learn.posterior.linear_problem import quadratic
from wrenchgap.learn.posterior.posterior import grouped
from wrenchgap.learn.posterior.score import Keys, Scored, Scorer, SetRows
from wrenchgap.learn.posterior.scored_sets import Part, bootstrapped, names_of, parts_of, without_idle
from wrenchgap.learn.posterior.subset_search import ordered, searched
from wrenchgap.plant.effects import family

Read = Callable[[], Iterable[Evidence]]
"""Gives the evidence of every flight, one after the other and each time in the same order; never all at once."""

RANKED = 20
"""Sets that are cross-validated, the likeliest of the search."""
HELD_OUT = 3
"""Flights from which on flights are held out; of fewer, gains are in-sample."""


@dataclass(frozen=True)
class RankedSet:
    """A set of effects on a fleet. `names` are those of its effects worth a name, `theta` and `std` by column.

    `log_odds` are against no effect at all, `weight` is its share among the sets ranked, `gain` what it predicts of
    flights that were held out (`Ranking.held_out`) better than no effect does (sum of log likelihoods), `better` the
    share of flights that it predicts better; `rms` (6,) [N, Nm] is left of held-out flights, trims aside; NaN where
    nothing was measured. Sets of one `group` predict the same, as far as their laws are known: one explanation in
    several words.
    """

    keys: Keys
    names: tuple[str, ...]
    theta: dict[str, Array]
    std: dict[str, Array]
    parts: tuple[Part, ...]
    log_odds: float
    weight: float
    gain: float
    better: float
    rms: Array
    group: int


@dataclass(frozen=True)
class Ranking:
    """Sets by group, the heaviest first, and of one group the plainest first: between those, weights are priors and the
    accuracy of laws, and no finding. `alone` are the log odds of each candidate by itself against none, the best first.
    `rms` (6,) [N, Nm] is what no effect leaves; `held_out` says whether flights were; `points` are the values that the
    fleet gives each candidate by itself. `left_out` are candidates that some flight does not allow.
    """  # noqa: D205

    flights: tuple[str, ...]
    seconds: float
    sets: tuple[RankedSet, ...]
    alone: dict[str, float]
    rms: Array
    held_out: bool
    points: Points
    columns: dict[str, Column]
    left_out: tuple[str, ...]

    def probability(self, name: str) -> float:
        """Weight of the sets that name an effect, in any of its forms, or are of one group with such a set."""
        naming = {s.group for s in self.sets if family(name) in {family(n) for n in s.names}}
        return float(sum(s.weight for s in self.sets if s.group in naming))

    @property
    def groups(self) -> tuple[tuple[RankedSet, ...], ...]:
        """Sets that predict the same put together, heaviest group first."""
        return tuple(tuple(g) for _, g in itertools.groupby(self.sets, key=lambda s: s.group))

    @property
    def effects(self) -> dict[str, float]:
        """Effects that a set names, with their probability, the likeliest first."""
        named = dict.fromkeys(n for s in self.sets for n in s.names)
        return dict(sorted(((n, self.probability(n)) for n in named), key=lambda item: -item[1]))


def ranking(read: Read) -> Ranking:
    """Rank sets of effects on the flights of one vehicle. Raises FitError where there is no flight."""
    keys, axes, left_out = common_candidates(read())
    space = FleetSpectrum(read(), keys, axes)
    scorer = searched(space)
    none = scorer(())
    best = [s for s in ordered(scorer) if s.keys][:RANKED]
    ranked = {s.keys for s in best}
    best += [s for s in equivalents(scorer, best[0]) if s.keys not in ranked] if best else []
    alone = {k: scorer((k,)).log_probability - none.log_probability for k in space.columns}
    held_out = len(space.flights) >= HELD_OUT
    likelihood, _, _ = by_flight(scorer, space, [none, *best], read(), held_out=False)
    share = bootstrapped(likelihood, np.array([s.prior for s in (none, *best)]))
    weights: dict[Keys, float] = {}
    for s, weight in zip((none, *best), share, strict=True):  # of two effects that do the same, one or the other
        for leaf, part in without_idle(scorer, s.keys).items():
            weights[leaf] = weights.get(leaf, 0.0) + float(weight) * part
    kept = [scorer(keys) for keys in dict.fromkeys([(), *weights])]
    _, predicted, squares = by_flight(scorer, space, kept, read(), held_out=held_out)
    rms = np.full((len(kept), len(AXES)), np.nan)
    rms[:, space.axes] = np.sqrt(squares / space.count.sum(axis=0))
    heaviest_first = sorted(kept, key=lambda s: -weights.get(s.keys, 0.0))
    groups = grouped(heaviest_first, lambda one, other: alike(scorer, one, other))
    home = {s.keys: k for k, group in enumerate(groups) for s in group}

    def ranked_set(k: int, s: Scored) -> RankedSet:
        parts, gain = parts_of(scorer, s.keys), predicted[k] - predicted[0]
        return RankedSet(
            keys=s.keys,
            names=names_of(parts),
            theta=s.theta,
            std=scorer.deviations(s),
            parts=parts,
            log_odds=s.log_probability - none.log_probability,
            weight=weights.get(s.keys, 0.0),
            gain=float(gain.sum()),
            better=float(np.mean(gain > 0.0)),
            rms=rms[k],
            group=home[s.keys],
        )

    return Ranking(
        tuple(space.flights),
        float(sum(space.seconds)),
        by_group([ranked_set(k, s) for k, s in enumerate(kept)]),
        dict(sorted(alone.items(), key=lambda item: -item[1])),
        rms[0],
        held_out,
        {k: [float(v) for v in scorer((k,)).theta[k] + space.columns[k].origin] for k in space.columns},
        space.columns,
        left_out,
    )


def equivalents(scorer: Scorer, best: Scored) -> list[Scored]:
    """Sets that predict what the best predicts, with another candidate, or none, in the place of one of its members:
    many flights tell them apart by what no law is known to, and the search goes on with the likelier alone.
    """  # noqa: D205
    columns = scorer.spectrum.columns
    found = {}
    for leaf in without_idle(scorer, best.keys):
        for gone, other in itertools.product(leaf, columns):  # instead of itself: none
            keys = tuple(sorted({*leaf, other} - {gone}))
            new = other == gone or other not in leaf
            if keys and new and compatible(keys, columns) and alike(scorer, scorer(leaf), scorer(keys)):
                found[keys] = scorer(keys)
    return list(found.values())


def alike(scorer: Scorer, first: Scored, second: Scored) -> bool:
    """Whether two predictions differ by less than noise, or laws' accuracy, shows (`predict_the_same`)."""
    apart = first.weights - second.weights
    used = np.flatnonzero(apart)
    over = scorer.count / np.minimum(first.variance, second.variance)
    difference = np.sum(over * quadratic(scorer.spectrum.products[:, :, used[:, None], used], apart[used]))
    known = min(np.sum(over * s.inexact) for s in (first, second))
    return bool(np.sqrt(max(difference, 0.0)) < max(scorer.spectrum.settings.indistinct, 2.0 * np.sqrt(known)))


def by_group(sets: Sequence[RankedSet]) -> tuple[RankedSet, ...]:
    """Groups by weight, numbered anew; in one of them the plainest set first."""
    total: dict[int, float] = {}
    for s in sets:
        total[s.group] = total.get(s.group, 0.0) + s.weight
    rank = {g: k for k, g in enumerate(sorted(total, key=lambda g: -total[g]))}

    def plainness(s: RankedSet) -> tuple[int, int, float]:
        return rank[s.group], sum(map(np.size, s.theta.values())), -s.weight

    return tuple(replace(s, group=rank[s.group]) for s in sorted(sets, key=plainness))


def common_candidates(parts: Iterable[Evidence]) -> tuple[list[str], list[int], tuple[str, ...]]:
    """Candidates that every flight has and one of them at least excites; axes that all measured; candidates without."""
    keys: dict[str, int] = {}
    excited: set[str] = set()
    axes: set[int] | None = None
    flights = 0
    for one in parts:
        flights += 1
        keys |= {k: keys.get(k, 0) + 1 for k in one.keys}
        excited |= {c.key for c in one.columns if not set(c.names) & set(one.unexcited)}
        own = {int(a) for a in one.axes}
        axes = own if axes is None else axes & own
    kept = [k for k, count in keys.items() if count == flights and k in excited]
    return kept, sorted(axes or ()), tuple(k for k in keys if k not in kept)


class FittedSet:
    """The least squares of one set on all flights, at the noise that it leaves; trims are eliminated."""

    def __init__(self, scorer: Scorer, scored: Scored) -> None:
        self.rows = SetRows(scorer.spectrum, scored.keys)
        self.weights = scored.weights[self.rows.every]
        self.sizes = scored.sizes
        self.g = scorer.share / scored.variance
        self.noise = scorer.as_noise(scored)
        self.off = scored.doubt**2 * scored.inexact + scorer.spectrum.leak
        self.log = scorer.share * np.log(scored.variance)
        self.whole = self.rows.weighed(scorer.count / scored.variance, self.g[0, self.rows.trims.axes])

    def left(self, products: Array, flight: int, weights: Array) -> Array:
        """Sums of squares (bands, L) that weights (R,) leave of one flight, its own trim taken out."""
        trims = self.rows.trims.of(flight=flight)
        likeliest = trims.likeliest(self.g[0, trims.axes], weights)
        return np.maximum(trims.added_to(quadratic(products, weights), likeliest, weights, np.ones_like(self.g)), 0.0)

    def log_likelihood(self, left: Array, count: Array) -> float:
        """Of a flight of which the set leaves these sums of squares (bands, L), of `count` (bands, L)."""
        return -0.5 * float(np.sum(self.g * (self.noise * left + self.off * count) + self.log * count))

    def without(self, products: Array, flight: int) -> Array:
        """Weights (R,) of the quantities that all other flights give."""
        trims = self.rows.trims.of(flight=flight)
        own = np.tensordot(self.g, products, axes=([0, 1], [0, 1]))
        theirs = self.whole - trims.eliminated_from(own, self.g[0, trims.axes])
        size, out = len(self.sizes), self.weights.copy()
        A, b = np.ascontiguousarray(theirs[:size, :size]), theirs[:size, size:] @ out[size:]
        out[:size] = -kernels.bounded(A, b, self.rows.low, self.rows.high, self.sizes)
        return out


def by_flight(
    scorer: Scorer, space: FleetSpectrum, sets: Sequence[Scored], parts: Iterable[Evidence], *, held_out: bool
) -> tuple[Array, Array, Array]:
    """Log likelihoods (S, F) of each flight under each set; the same predicted; sums of squares (S, L) that are left.

    `held_out` predicts a flight with the parameters that all others give.
    """
    fitted = [FittedSet(scorer, s) for s in sets]
    likelihood, predicted = np.empty((2, len(sets), len(space.flights)))
    squares = np.zeros((len(sets), len(space.axes)))
    for f, one in enumerate(parts):
        at = chosen_axes(one, space.axes)
        products = products_of(one, chosen_rows(one, space.keys), at)[space.bands]
        count = one.usable[space.bands][:, at]
        for k, each in enumerate(fitted):
            own = products[:, :, each.rows.every[:, None], each.rows.every]
            left = each.left(own, f, each.weights)
            likelihood[k, f] = each.log_likelihood(left, count)
            if held_out:
                left = each.left(own, f, each.without(own, f))
            predicted[k, f] = each.log_likelihood(left, count)
            squares[k] += (left * (count > 0.0)).sum(axis=0)
    return likelihood, predicted, squares
