"""The search over sets for a few flights: straight lines of each candidate, then of likely sets together, then weights.

linear search     sets on the lines of each candidate by itself       `learn.posterior.subset_search`
rounds            likely sets are linearised where they fit best; beside the likeliest, everything else is linearised
                  from next to nothing; all that came close is weighed, and says what to linearise next
names             sets by what they name, and the classes that they form       `learn.posterior.posterior`
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.arguments import Progress, silent
from wrenchgap.flight.flight import Array
from wrenchgap.learn.identify.fit import MATERIAL
from wrenchgap.learn.posterior.columns import Column, compatible, confused
from wrenchgap.learn.posterior.posterior import (
    WeighedSets,
    equivalence_classes,
    merged_by_names,
    predict_the_same,
)
from wrenchgap.learn.posterior.relinearisation import (
    lags_and_delays,
    lines_beside,
    relinearised_sets,
    without_doubtful,
)
from wrenchgap.learn.posterior.score import Keys, Scored, Scorer
from wrenchgap.learn.posterior.scored_sets import ScoredSet, scored_set, shares, shares_of, weights
from wrenchgap.learn.posterior.single_effects import ModelResidual
from wrenchgap.learn.posterior.subset_search import ordered, with_fit_discounted
from wrenchgap.plant.effects import family, find

Joint = Mapping[Keys, ScoredSet | None]
"""Sets that were linearised together; None where the model refuses one."""
Begun = tuple[Keys, Sequence[Array]]
"""A set, and the values at which linearising it anew begins."""

ROUNDS = 3
"""In which likely sets are linearised, and one more candidate is looked for beside the likeliest."""
SETTLING = 3
"""Further rounds, in which only what would do as well as the heaviest is linearised."""
FEW = 3
"""Heaviest sets of which it is asked what of them is idle."""


@dataclass(frozen=True)
class Round:
    """What is known after a round: sets linearised together, straight lines `beside` some of them; all sets that were
    `weighed`, the heaviest first, with their weights; what to linearise `next`, and where to begin.
    """  # noqa: D205

    joint: Joint
    beside: Mapping[Keys, Scorer]
    weighed: tuple[tuple[ScoredSet, float], ...]
    next: Sequence[Begun]


def joint_search(on: ModelResidual, linear: Scorer, *, jobs: int = 1, tell: Progress = silent) -> WeighedSets:
    """Weigh the sets that were searched as straight lines, linearised anew."""
    tell(0.0, "weighing sets of effects")
    last = Round({}, {}, (), beginning(linear, sets_to_relinearise(linear, ordered(linear))))
    for number in range(ROUNDS + SETTLING):
        tell((1 + number) / (2 + ROUNDS + SETTLING), "fitting the likeliest sets")
        last = next_round(on, linear, last, jobs, settling=number >= ROUNDS)
        if not last.next:
            break
    weighed = with_aliases(on, linear, last, jobs)
    rests = {leaf.keys for one, _ in weighed[:FEW] for leaf, _ in one.leaves if leaf.keys} - last.joint.keys()
    joint = {**last.joint, **relinearised_sets(on, linear, beginning(linear, sorted(rests)), jobs)}
    wholes = tuple(with_leaves_of(joint, one) for one, _ in weighed[:FEW])
    kept = [replace(one, leaves=equivalents_without_idle(linear, one)) for one in wholes]
    sets = merged_by_names((*kept, *(one for one, _ in weighed[FEW:])), [share for _, share in weighed])
    classes = equivalence_classes(sets, lambda a, b: predict_the_same(a.scored_set, b.scored_set, linear))
    best = sets[0].scored_set
    return WeighedSets(sets, classes, wholes, last.beside.get(best.keys) or lines_beside(on, linear, best, jobs))


def next_round(on: ModelResidual, linear: Scorer, last: Round, jobs: int, *, settling: bool) -> Round:
    """Linearise what the last round asked for, weigh all that came close, and ask for more."""
    joint = better_of(last.joint, relinearised_sets(on, linear, last.next, jobs))
    known = [c for c in joint.values() if c is not None]
    centre = max(known, key=lambda c: c.scored.log_probability, default=None)
    beside, more = last.beside, dict[Keys, list[Array]]()
    if not settling and centre is not None and centre.keys not in beside:
        beside = {**beside, centre.keys: lines_beside(on, linear, centre, jobs)}
        more = one_more(beside[centre.keys], centre, joint)
    weighed = by_weight(sets_to_weigh(ordered(linear), linear, joint))
    heaviest = weighed[0][0]
    wanted = [one.keys for one, _ in weighed[:FEW] if one.keys and not settling]
    wanted += substitutes(beside.get(heaviest.keys, linear), heaviest)
    wanted += [rest for one, _ in weighed[:FEW] for rest in without_doubtful(one)]
    wanted += [leaf.keys for one, _ in weighed[:FEW] for leaf, _ in one.leaves if leaf.keys]
    new = (keys for keys in dict.fromkeys(wanted) if keys not in joint and keys not in more)
    return Round(joint, beside, weighed, [*more.items(), *beginning(linear, new)])


def one_more(beside: Scorer, centre: ScoredSet, joint: Joint) -> dict[Keys, list[Array]]:
    """The sets with one candidate more, and where they begin, that are likelier by straight lines beside the centre,
    the likeliest first: not those that were linearised and are as likely as they promise.
    """  # noqa: D205
    columns, settings = beside.spectrum.columns, beside.spectrum.settings
    sets = (tuple(sorted((*centre.keys, k))) for k in columns if k not in centre.keys)
    found = [beside(keys) for keys in sets if compatible(keys, columns)]
    least = max(beside(centre.keys).log_probability, centre.scored.log_probability)

    def seen(one: Scored) -> bool:
        known = joint.get(one.keys)
        return known is not None and known.scored.log_probability > one.log_probability - settings.moved

    likely = [one for one in found if one.log_probability > least and not seen(one)]
    first = sorted(likely, key=lambda one: -one.log_probability)[: settings.contenders]
    return {one.keys: [one.theta[k] for k in one.keys] for one in first}


def better_of(joint: Joint, new: Joint) -> dict[Keys, ScoredSet | None]:
    """Of sets that were linearised from two places, the likelier."""

    def log(one: ScoredSet | None) -> float:
        return -math.inf if one is None else one.scored.log_probability

    return {**joint, **{keys: one for keys, one in new.items() if keys not in joint or log(one) > log(joint[keys])}}


def beginning(linear: Scorer, sets: Iterable[Keys]) -> list[Begun]:
    """Sets with the values at which they fit best as straight lines, where linearising them anew begins."""
    return [(keys, [linear(keys).theta[k] for k in keys]) for keys in sets]


def by_weight(sets: Sequence[ScoredSet]) -> tuple[tuple[ScoredSet, float], ...]:
    """Sets with their weights, the heaviest first."""
    return tuple(sorted(zip(sets, weights(sets).tolist(), strict=True), key=lambda pair: -pair[1]))


def with_aliases(on: ModelResidual, linear: Scorer, last: Round, jobs: int) -> tuple[tuple[ScoredSet, float], ...]:
    """The sets of the last round, with those `aliases` of the heaviest that predict the same, by `alias_weight`."""
    weighed = last.weighed
    heaviest, share = weighed[0]
    beside = last.beside.get(heaviest.keys, linear)
    begun = beginning(beside, aliases(beside, heaviest.scored))
    found = [one for one in relinearised_sets(on, linear, begun, jobs).values() if one]
    alike = {one.keys: one for one in found if predict_the_same(heaviest, one, linear)}
    weight = {one.keys: share for one, share in weighed}
    for keys, one in alike.items():
        least = share * alias_weight(linear, one.scored, heaviest.scored)
        weight[keys] = max(weight.get(keys, 0.0), least)
    sets = {one.keys: one for one, _ in weighed} | alike
    total = sum(weight.values())
    return tuple(sorted(((one, weight[keys] / total) for keys, one in sets.items()), key=lambda pair: -pair[1]))


def aliases(linear: Scorer, heaviest: Scored) -> list[Keys]:
    """The sets with another effect that is known to look like it, of no more parameters, in the place of one; of an
    effect with more parameters, those count that are large enough for a name: two opposite rotors that lose as much are
    no better a reason than less thrust and a yaw torque.
    """  # noqa: D205
    columns = linear.spectrum.columns

    def large(one: Scored, key: str) -> int:
        return int(np.sum(np.abs(one.theta[key]) >= MATERIAL * columns[key].scale))

    def no_more(keys: Keys, gone: str, new: str) -> bool:
        fewer = columns[new].scale.size <= columns[gone].scale.size
        return fewer or large(linear(keys), new) <= large(heaviest, gone)

    swaps = [(gone, new) for gone in heaviest.keys for new in confused(gone, columns)]
    swapped = (k for pair in swaps for k in exchanges(heaviest.keys, pair, columns) if no_more(k, *pair))
    return list(dict.fromkeys(swapped))


def alias_weight(linear: Scorer, alias: Scored, heaviest: Scored) -> float:
    """The weight of a set that predicts the same, where the heaviest has 1: by fit and price alone. How wide the priors
    of parameters are is no finding, and a centre of mass that is low, and in the middle, loses nothing for the places
    across that it could have had.
    """  # noqa: D205
    fits = [
        one.log_probability - one.prior - linear.spectrum.settings.price * sum(linear.kinds[k] for k in one.keys)
        for one in (alias, heaviest)
    ]
    return math.exp(min(fits[0] - fits[1], 0.0))


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
        sizes = {k: max(abs(s.theta[k]) / columns[k].scale) for k in s.keys}
        large = frozenset(family(n) for k in s.keys if sizes[k] > 0.1 for n in columns[k].names)
        if s.keys and len(found) < settings.contenders:
            found.setdefault(large, s.keys)
    alternatives = [next((s.keys for s in close if key not in s.keys), ()) for key in ranked[0].keys]
    by_prior = sorted(ranked, key=lambda s: -with_fit_discounted(s.log_probability, s.prior, settings.fit_counts))
    plain = [s.keys for s in by_prior if s.log_probability > best - settings.far_behind][: settings.plainest]
    delays = lags_and_delays(columns)
    late = exchanges(ranked[0].keys, delays, columns)
    if set(delays) & set(ranked[0].keys):  # beside a lag a delay looks like more of it, by straight lines
        both = (tuple(sorted((*ranked[0].keys, k))) for k in delays if k not in ranked[0].keys)
        late += [keys for keys in both if compatible(keys, columns)]
    in_wind = [k for k in columns if "wind" in k.split(" + ")]  # a velocity times a coefficient is no straight line
    aired = [k for s in (ranked[0].keys, *plain) for k in exchanges(s, in_wind, columns)]
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


def with_leaves_of(joint: Joint, whole: ScoredSet) -> ScoredSet:
    """A set with what remains of it as that is where it was linearised itself: of a lag and a delay, either of which is
    idle beside the other, the one that does as well alone; a set that lacks another member, too, where it is likelier
    than what remains. Where the whole is d > 1 nats likelier than the best of them, their odds count to the power
    1 / d: of two that are both wrong, the one that is less so need not be there. As it was where one of the sets that
    remain was not linearised.
    """  # noqa: D205
    known = [joint.get(leaf.keys) if leaf.keys else leaf for leaf, _ in whole.leaves]
    there = {one.keys: one for one in known if one is not None}
    if len(there) < len(known):
        return whole
    best = max(one.scored.log_probability for one in there.values())
    for gone in whole.keys:
        rest = joint.get(tuple(k for k in whole.keys if k != gone))
        if rest is not None and rest.scored.log_probability > best:
            there |= {leaf.keys: joint.get(leaf.keys) or leaf for leaf, _ in rest.leaves}
    log = [one.scored.log_probability for one in there.values()]
    share = shares_of(log, max(whole.scored.log_probability - max(log), 1.0))
    return replace(whole, leaves=tuple(zip(there.values(), share, strict=True)))


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
            swapped = dict.fromkeys((*exchanges(leaf.keys, others, columns), *for_two(leaf.keys, columns)))
            found = [scored_set(scorer, k) for k in swapped if scorer(k).log_probability > least]
            bare = [c for c in found if all(p.named for p in c.parts) or not likely_without_one(scorer, c.keys, least)]
            alike += [c for c in bare if predict_the_same(leaf, c, scorer)]
        out += zip(alike, [part * share for share in shares(scorer, [c.keys for c in alike])], strict=True)
    return tuple(out)


def likely_without_one(scorer: Scorer, keys: Keys, least: float) -> bool:
    """Whether a set without one of these members would be likely enough, its prior counted: with a constant wrench a
    loss of thrust is idle as far as the fit goes, and makes the wrench ten times more plausible.
    """  # noqa: D205
    return any(scorer(tuple(k for k in keys if k != gone)).log_probability > least for gone in keys)


def for_two(keys: Keys, columns: dict[str, Column]) -> list[Keys]:
    """The sets with two candidates that are known to be confused with one in its place."""
    out = []
    for gone in keys:
        rest = tuple(k for k in keys if k != gone)
        out += [tuple(sorted((*rest, *pair))) for pair in itertools.combinations(confused(gone, columns), 2)]
    return [k for k in out if len(set(k)) == len(k) and compatible(k, columns)]


def exchanges(keys: Keys, alike: Sequence[str], columns: dict[str, Column]) -> list[Keys]:
    """The sets with another of these candidates in the place of one."""
    out = []
    for gone in set(alike) & set(keys):
        rest = tuple(k for k in keys if k != gone)
        out += [tuple(sorted((*rest, other))) for other in alike if other not in keys]
    return [k for k in out if compatible(k, columns)]


def sets_to_weigh(scored: Sequence[Scored], linear: Scorer, joint: Joint) -> list[ScoredSet]:
    """The sets to weigh: those linearised together, and of those on lines the likeliest as they are, each once."""
    settings = linear.spectrum.settings
    again = [c for c in joint.values() if c is not None]
    best = max((c.scored.log_probability for c in again), default=-1e300)
    others = [s for s in scored if joint.get(s.keys) is None][: settings.weighed]
    likely = [s for s in others if s.log_probability > best - settings.behind or not again]
    return [*again, *(scored_set(linear, s.keys) for s in likely)]
