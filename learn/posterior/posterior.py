"""The posterior over sets of effects: what is established, what is open.

Sets are searched with every candidate linearised by itself; those that come close are linearised anew together, lags
and delays also in each other's place, and weighed. Sets with the same names are one; sets that predict the same on
these flights are one class (`learn.posterior.equivalence_classes`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.posterior.columns import Column, compatible
from wrenchgap.learn.posterior.discriminating_tests import Check
from wrenchgap.learn.posterior.equivalence_classes import (
    LATE_CLOCK,
    LIGHT,
    EquivalenceClass,
    NamedSet,
    checks_between,
    equivalence_classes,
    merged_by_names,
    one_per_names,
    predict_the_same,
)
from wrenchgap.learn.posterior.relinearisation import (
    columns_hold,
    lags_and_delays,
    likeliest,
    moves_when_relinearised,
    relinearised_sets,
    rest_holds,
    search_around,
    spectrum_of,
    with_known_rests,
    without_doubtful,
)
from wrenchgap.learn.posterior.score import Keys, Scored, Scorer
from wrenchgap.learn.posterior.scored_sets import ScoredSet, scored_set, shares, weights
from wrenchgap.learn.posterior.settings import DEFAULT, SearchSettings
from wrenchgap.learn.posterior.single_effects import ModelResidual
from wrenchgap.learn.posterior.subset_search import ordered, searched, with_fit_discounted
from wrenchgap.plant.effects import family, find
from wrenchgap.plant.vehicle import Vehicle


@dataclass(frozen=True)
class Posterior:
    """Named sets, heaviest first, the classes that they form, and what would settle which of all sets is true;
    `wholes` are the heaviest sets with all that they do not need; `scorer` is what they were scored by, by these
    `settings`.
    """  # noqa: D205

    sets: tuple[NamedSet, ...]
    classes: tuple[EquivalenceClass, ...]
    settle: tuple[Check, ...]
    wholes: tuple[ScoredSet, ...] = ()
    scorer: Scorer | None = field(default=None, repr=False, compare=False)
    settings: SearchSettings = DEFAULT

    @property
    def best(self) -> NamedSet:
        """The heaviest set of the heaviest class."""
        return self.classes[0].sets[0]

    def probability(self, names: Iterable[str]) -> float:
        """That one of these effects, in any form, is there: weight of the sets that name one, as far as trusted."""
        shared = {family(n) for n in names}
        total = 0.0
        for s in self.sets:
            total += s.weight * max((s.trust[n] for n in s.names if family(n) in shared), default=0.0)
        return min(self.settings.certain, total)

    def without(self, name: str, vehicle: Vehicle) -> Posterior:
        """The same where `name` turned out to do nothing beside the rest of the best set: it goes from all sets that
        have that rest.
        """  # noqa: D205
        rest = set(self.best.names) - {name}

        def shorter(sets: Sequence[NamedSet]) -> tuple[NamedSet, ...]:
            every = []
            for s in sets:
                kept = tuple(n for n in s.names if dict(s.stands_for).get(n, n) != name)
                every.append(replace(s, names=kept) if rest <= set(s.names) else s)
            return one_per_names(every)

        groups = [replace(c, sets=shorter(c.sets)) for c in self.classes]
        return self._with(shorter(self.sets), groups, vehicle)

    def at(self, changes: Mapping[str, Array], vehicle: Vehicle) -> Posterior:
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
        new = replace(best, scored_set=replace(best.scored_set, parts=tuple(parts)))

        def fitted(sets: Sequence[NamedSet]) -> tuple[NamedSet, ...]:
            return tuple(new if set(s.names) == set(best.names) else s for s in sets)

        groups = [replace(c, sets=fitted(c.sets)) for c in self.classes]
        return self._with(fitted(self.sets), groups, vehicle)

    def _with(self, sets: tuple[NamedSet, ...], groups: Sequence[EquivalenceClass], vehicle: Vehicle) -> Posterior:
        """These sets and classes, with what would settle which is true."""

        def checks(sets: Sequence[NamedSet], before: Sequence[Check]) -> tuple[Check, ...]:
            clock = [c for c in before if c.name == LATE_CLOCK and any(s.stands_for for s in sets)]
            return (*clock, *checks_between(sets, vehicle))

        kept = tuple(replace(c, settle=checks(c.sets, c.settle)) for c in groups)
        return replace(self, sets=sets, classes=kept, settle=checks(sets, self.settle))

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


def posterior(
    on: ModelResidual,
    columns: Sequence[Column],
    *,
    jobs: int = 1,
    rounds: int = 3,
    settling: int = 3,
    few: int = 3,
    progress: Callable[[float, str], None] | None = None,
) -> Posterior:
    """Weigh the sets of these columns.

    In so many `rounds` likely sets are linearised anew, in `settling` more only what would do as well as the heaviest;
    of the `few` heaviest it is asked what of them is idle.
    """
    tell = progress or (lambda fraction, words: None)
    tell(0.0, "weighing sets of effects")
    linear = searched(spectrum_of(on, columns), Scorer, jobs)
    anew: dict[Keys, ScoredSet | None] = {}
    todo = sets_to_relinearise(linear, ordered(linear))
    scorers: dict[Keys, Scorer] = {}
    nearby: list[tuple[Scored, Scorer, Keys]] = []
    for number in range(rounds + settling):
        tell((1 + number) / (2 + rounds + settling), "fitting the likeliest sets")
        anew |= zip(todo, relinearised_sets(on, linear, todo, jobs), strict=True)
        todo, centre = [], likeliest(anew) if number < rounds else None
        if centre is not None and centre.keys not in scorers and moves_when_relinearised(linear, centre):
            scorer = scorers[centre.keys] = search_around(on, linear, centre, jobs)
            found = [s for s in ordered(scorer) if columns_hold(s.keys, centre.keys)]
            todo = sets_to_relinearise(scorer, found)
            nearby = [(s, scorer, centre.keys) for s in found]
        straight = [(s, by) for s, by, middle in nearby if rest_holds(s.keys, middle, by, anew)]
        lines = [*straight, *((s, linear) for s in ordered(linear))]
        kept = sets_to_weigh(lines, anew)
        share = weights(kept)
        best = sorted(range(len(kept)), key=lambda k: -share[k])
        todo += [kept[k].keys for k in best[:few] if kept[k].keys and number < rounds]
        heaviest = kept[best[0]]
        todo += substitutes(scorers.get(heaviest.keys, linear), heaviest)
        todo += [rest for k in best[:few] for rest in without_doubtful(kept[k])]
        todo = [keys for keys in dict.fromkeys(todo) if keys not in anew]
        if not todo:
            break
    bends = with_known_rests(on, linear, [kept[k] for k in best if share[k] > LIGHT], anew, jobs)
    kept = sets_to_weigh(lines, anew, bends)
    share = weights(kept)
    best = sorted(range(len(kept)), key=lambda k: -share[k])
    wholes = tuple(kept[k] for k in best[:few])
    for k in best[:few]:
        kept[k] = replace(kept[k], leaves=equivalents_without_idle(linear, kept[k]))
    sets = merged_by_names(kept, share)
    vehicle = on.model.vehicle
    by = scorers.get(sets[0].scored_set.keys, linear)
    return Posterior(
        sets, equivalence_classes(sets, linear, vehicle), checks_between(sets, vehicle), wholes, by, on.settings
    )


def sets_to_relinearise(linear: Scorer, ranked: Sequence[Scored]) -> list[Keys]:
    """Sets to linearise anew, of those scored, the likeliest first: the best, the best without each of its members, the
    plainest, and of the best and these those with lags and delays, or with what moves in the air, in each other's
    place; one effect for its parts.
    """  # noqa: D205
    if not ranked:
        return []
    best, settings = ranked[0].log_probability, linear.spectrum.settings
    close = [s for s in ranked if s.log_probability > best - settings.behind]
    columns = linear.spectrum.columns
    found: dict[frozenset[str], Keys] = {}
    for s in close:
        large = frozenset(family(n) for k in s.keys if _size(linear, s.theta, k) > 0.1 for n in columns[k].names)
        if s.keys and len(found) < settings.contenders:
            found.setdefault(large, s.keys)
    alternatives = [next((s.keys for s in close if key not in s.keys), ()) for key in ranked[0].keys]
    by_prior = sorted(ranked, key=lambda s: -with_fit_discounted(s.log_probability, s.prior, settings.fit_counts))
    plain = [s.keys for s in by_prior if s.log_probability > best - settings.far_behind][: settings.plainest]
    late = exchanges(ranked[0].keys, lags_and_delays(columns), columns)
    aired = [k for s in (ranked[0].keys, *plain) for k in exchanges(s, _in_moving_air(columns), columns)]
    in_air = [keys for keys in aired if linear(keys).log_probability > best - settings.far_behind]
    whole = with_compounds(ranked[0].keys, columns)
    return [keys for keys in dict.fromkeys([*found.values(), *alternatives, *plain, *late, *in_air, *whole]) if keys]


def with_compounds(keys: Keys, columns: dict[str, Column]) -> list[Keys]:
    """The sets with one effect in the place of its parts and of what looks like it (a payload for a mass and a centre
    of mass): products of parameters, which straight lines do not show.
    """  # noqa: D205
    out = []
    for key, c in columns.items():
        parts = {p for n in c.names for p in find(n).parts}
        if key not in keys and parts & set(keys):
            gone = parts | {a for n in c.names for a in find(n).confused_with}
            rest = tuple(k for k in keys if not gone & set(columns[k].names))
            out.append(tuple(sorted((*rest, key))))
    return out


def substitutes(scorer: Scorer, heaviest: ScoredSet) -> list[Keys]:
    """The sets with another candidate in the place of one that is named, if they are about as likely, the likeliest
    first: what the heaviest set is weighed against must have been linearised as it was.
    """  # noqa: D205
    columns, keys, settings = scorer.spectrum.columns, heaviest.keys, scorer.spectrum.settings
    named = {n for leaf, _ in heaviest.leaves for n in leaf.names}
    fixed = [k for k in keys if not named & set(columns[k].names)]
    others = [k for k in columns if k not in lags_and_delays(columns)]
    swapped = [s for s in exchanges(keys, others, columns) if set(fixed) <= set(s)]
    close = [s for s in map(scorer, swapped) if s.log_probability > scorer(keys).log_probability - settings.moved]
    return [s.keys for s in sorted(close, key=lambda s: -s.log_probability)[: settings.contenders]]


def equivalents_without_idle(scorer: Scorer, whole: ScoredSet) -> tuple[tuple[ScoredSet, float], ...]:
    """What remains of a set, where something idle was taken out shared with what does the same by itself: an idle
    member's fit (a delay of turbulence) is no reason for one name rather than another. Not where the straight lines of
    `scorer` miss what remains, so that they say nothing of what does the same (a payload behind a lag, linearised
    where it weighed nothing).
    """  # noqa: D205
    columns, settings = scorer.spectrum.columns, scorer.spectrum.settings
    others = [k for k in columns if k not in lags_and_delays(columns)]
    out: list[tuple[ScoredSet, float]] = []
    for leaf, part in whole.leaves:
        alike = [leaf]
        straight = scorer(leaf.keys).log_probability
        if len(leaf.keys) < len(whole.keys) and straight > leaf.scored.log_probability - settings.behind:
            least = straight - settings.moved
            likely = [k for k in exchanges(leaf.keys, others, columns) if scorer(k).log_probability > least]
            found = [c for c in (scored_set(scorer, k) for k in likely) if all(p.named for p in c.parts)]
            alike += [c for c in found if predict_the_same(leaf, c, scorer)]
        out += zip(alike, [part * share for share in shares(scorer, [c.keys for c in alike])], strict=True)
    return tuple(out)


def exchanges(keys: Keys, alike: Sequence[str], columns: dict[str, Column]) -> list[Keys]:
    """The sets with another of these candidates in the place of one."""
    out = []
    for gone in set(alike) & set(keys):
        rest = tuple(k for k in keys if k != gone)
        out += [tuple(sorted((*rest, other))) for other in alike if other not in keys]
    return [k for k in out if compatible(k, columns)]


def _in_moving_air(columns: Iterable[str]) -> list[str]:
    """What sees an air that moves: a velocity times a coefficient is no straight line either."""
    return [k for k in columns if "wind" in k.split(" + ")]


def _size(linear: Scorer, theta: dict[str, Array], key: str) -> float:
    return float(max(abs(theta[key]) / linear.spectrum.columns[key].scale))


def sets_to_weigh(
    scored: Sequence[tuple[Scored, Scorer]],
    anew: dict[Keys, ScoredSet | None],
    bends: Mapping[str, Array] | None = None,
) -> list[ScoredSet]:
    """The sets to weigh: those linearised anew, and of those scored the likeliest as they are, each once."""
    settings = scored[0][1].spectrum.settings
    again = [c for c in anew.values() if c is not None]
    best = max((c.scored.log_probability for c in again), default=-1e300)
    first: dict[Keys, tuple[Scored, Scorer]] = {}
    for s, by in scored:
        if anew.get(s.keys) is None:
            first.setdefault(s.keys, (s, by))
    others = sorted(first.values(), key=lambda pair: -pair[0].log_probability)[: settings.weighed]
    likely = [(s, by) for s, by in others if s.log_probability > best - settings.behind or not again]
    return [*again, *(scored_set(by, s.keys, bends=bends) for s, by in likely)]
