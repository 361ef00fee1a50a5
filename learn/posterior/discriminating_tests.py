"""What would settle which of several explanations is true: bench checks, the cheapest first, then a flight.

Every explanation (set of effects) predicts the reading of every bench check; two are separated by a check where their
readings differ by more than it resolves and by more than fitted values are good for. Checks are taken in the order of
their cost, each if it separates a pair that those before do not; where that makes too many, those go without which the
least weight stays unsettled.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Literal

import numpy as np

from wrenchgap.flight.flight import Array, Mask
from wrenchgap.learn.posterior.bench_tests import NO_CHECK, TRIALS, Setup, Trial
from wrenchgap.plant.effects import catalogue
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.vehicle import Vehicle

EffectSet = tuple[str, ...]
Values = Mapping[str, Mapping[str, float]]
"""Fitted values of a set where they are known: {effect: {parameter: value}}."""
Group = tuple[int, ...]

MOST = 4
"""Bench checks that are worth a reader's time."""
WORTH = 0.01
"""Share of all pairs, by weight, that a check must settle: nobody films servos for an explanation of 1 in 1000."""
LISTED = 3
"""Explanations that a sentence names for one outcome, and that one flight is for: the heaviest."""

KNOWN = frozenset(name for trial in TRIALS for name in (*trial.shows, *trial.unclear)) | frozenset(NO_CHECK)


@dataclass(frozen=True)
class Check:
    """Something to do, and which sets of effects it tells apart.

    `what` is one sentence with the outcome for each side. `separates` are two or more groups of sets: the outcome says
    in which of them the truth is. `settles` is the weight of the pairs of sets that it separates, of that of all pairs;
    zero for a flight. `name` is that of the bench check, "flight" for a flight.
    """

    kind: Literal["bench", "flight"]
    what: str
    separates: tuple[tuple[EffectSet, ...], ...]
    name: str
    settles: float = 0.0


@dataclass(frozen=True)
class _Explanation:
    """One set: its effects, weight, and theta of those effects whose values are known."""

    effects: EffectSet
    weight: float
    known: dict[str, Array]


@dataclass(frozen=True)
class _Outcome:
    """What a check reads if an explanation is true: `value` (K,), None for "not what the model expects"."""

    acting: EffectSet
    value: Array | None


@dataclass(frozen=True)
class _Candidate:
    """A check on this vehicle, with the outcomes of those explanations of which it says something, in groups.

    `apart` (n, n) says which explanations it separates.
    """

    trial: Trial
    setup: Setup
    outcomes: dict[int, _Outcome]
    groups: tuple[Group, ...]
    apart: Mask


def discriminating_tests(
    sets: Sequence[frozenset[str] | Sequence[str]],
    weights: Sequence[float],
    values: Sequence[Values],
    vehicle: Vehicle,
) -> tuple[Check, ...]:
    """At most `MOST` bench checks, the cheapest first, then a flight for the most likely of what they leave open.

    `sets` are explanations that fit the same log, `weights` theirs, `values` what is known of each set's fitted values:
    an effect that is not named there has an unknown size, a parameter that is not named is zero. `vehicle` is what the
    effects were fitted to: where the model had effects on its body already, with those in `vehicle.body`. Where the
    bench separates all, the flight confirms. Of less than two sets nothing is to be settled: (). Raises ModelError for
    values of parameters that an effect does not have.
    """
    found = _explanations(sets, weights, values, vehicle)
    if len(found) < 2:
        return ()
    chosen = _chosen(_candidates(found, vehicle), found)
    sides = [tuple(tuple(found[k].effects for k in group) for group in c.groups) for c in chosen]
    pairs = _pair_weights(found)
    worth = [float(np.sum(pairs[c.apart])) for c in chosen]
    bench = [
        Check("bench", _sentence(c, found), side, c.trial.name, settles)
        for c, side, settles in zip(chosen, sides, worth, strict=True)
    ]
    left = ~np.any([c.apart for c in chosen], axis=0) if chosen else np.ones((len(found), len(found)), dtype=bool)
    return (*bench, _flight(_open(left, found), found))


def _explanations(
    sets: Sequence[frozenset[str] | Sequence[str]],
    weights: Sequence[float],
    values: Sequence[Values],
    vehicle: Vehicle,
) -> list[_Explanation]:
    """Heaviest first; sets that are given twice count once, with the sum of the weights."""
    order = sorted(range(len(sets)), key=lambda k: -weights[k])
    listed: dict[frozenset[str], _Explanation] = {}
    for k in order:
        key = frozenset(sets[k])
        names = tuple(sorted(key)) if isinstance(sets[k], frozenset) else tuple(dict.fromkeys(sets[k]))
        if key in listed:
            before = listed[key]
            listed[key] = _Explanation(before.effects, before.weight + weights[k], before.known)
            continue
        known = {}
        for n in names:
            if n in values[k] and n in KNOWN:
                zero = {p.name: 0.0 for p in catalogue()[n].parameters(vehicle)}  # parameters that are not named
                known[n] = make_effect(vehicle, n, zero | dict(values[k][n])).theta
        listed[key] = _Explanation(names, float(weights[k]), known)
    return sorted(listed.values(), key=lambda e: -e.weight)


def _candidates(found: Sequence[_Explanation], vehicle: Vehicle) -> list[_Candidate]:
    """Every bench check that separates any of these explanations."""
    there = {name for e in found for name in e.effects}
    out = []
    for trial in TRIALS:
        if not there & set(trial.shows) or (trial.tilts and vehicle.arms is not None and not vehicle.arms.tilts.any()):
            continue
        setup = trial.setup(vehicle, [e.known for e in found])
        predicted = ((k, _outcome(trial, setup, e, vehicle)) for k, e in enumerate(found))
        outcomes = {k: outcome for k, outcome in predicted if outcome is not None}
        groups = _groups(setup, outcomes, found)
        if len(groups) > 1:
            label = np.full(len(found), -1)
            for number, group in enumerate(groups):
                label[list(group)] = number
            apart = (label[:, None] != label) & (label[:, None] >= 0) & (label >= 0)
            out.append(_Candidate(trial, setup, outcomes, groups, apart))
    return out


def _outcome(trial: Trial, setup: Setup, explanation: _Explanation, vehicle: Vehicle) -> _Outcome | None:
    """None where it is not known what this check reads.

    So it is with effects of a user's own, and with effects of unknown size of which even a typical one would not show.
    """
    if not set(explanation.effects) <= KNOWN.difference(trial.unclear):
        return None
    acting = tuple(n for n in explanation.effects if n in trial.shows)
    sized = all(n in explanation.known for n in acting)
    value = setup.predict({n: explanation.known[n] if sized else typical(vehicle, n) for n in acting})
    if np.isnan(value).any() or not sized:
        return None if setup.same(value, setup.predict({})) else _Outcome(acting, None)
    return _Outcome(acting, value)


def typical(vehicle: Vehicle, name: str) -> Array:
    """Parameters (P,) of an effect of this name and of typical size; a sparse one has one of them."""
    effect = catalogue()[name]
    scale = np.array([p.scale for p in effect.parameters(vehicle)])
    return np.where(np.arange(len(scale)) == 0, scale, 0.0) if effect.sparse else scale


def _groups(setup: Setup, outcomes: Mapping[int, _Outcome], found: Sequence[_Explanation]) -> tuple[Group, ...]:
    """Explanations that the check does not tell apart, in groups that it does; the heaviest explanation's first.

    An effect of unknown size reads like any of known size, and would join all of them to one group; where leaving it
    out separates more, nothing is said of it.
    """

    def worth(groups: tuple[Group, ...]) -> float:
        sums = [sum(found[k].weight for k in group) for group in groups]
        return sum(a * b for a, b in combinations(sums, 2))

    def connected(members: Sequence[int]) -> tuple[Group, ...]:
        """Members that any chain of readings connects, in the order of their first ones."""
        from scipy.sparse.csgraph import connected_components  # here: others need not wait for it

        if not members:
            return ()
        _, labels = connected_components(_alike(setup, [outcomes[k] for k in members]), directed=False)
        by_label = [[k for k, g in zip(members, labels, strict=True) if g == one] for one in dict.fromkeys(labels)]
        return tuple(map(tuple, by_label))

    sized = [k for k, o in outcomes.items() if o.value is not None]
    return max((connected(members) for members in (list(outcomes), sized)), key=worth)


def _alike(setup: Setup, outcomes: Sequence[_Outcome]) -> Mask:
    """Which outcomes (n, n) the check does not tell apart; one of unknown size is unlike the model's reading only."""
    nominal = setup.predict({})
    unknown = np.array([o.value is None for o in outcomes], dtype=bool)
    values = np.array([nominal, *(nominal if o.value is None else o.value for o in outcomes)])
    close = setup.alike(values)
    moved = unknown | ~close[0, 1:]
    either, both = unknown[:, None] | unknown, moved[:, None] & moved
    return np.asarray(np.where(either, both, close[1:, 1:]), dtype=bool)


def _chosen(candidates: Sequence[_Candidate], found: Sequence[_Explanation]) -> list[_Candidate]:
    """Cheapest first, each for pairs that those before do not separate; `MOST` of them at most.

    Of checks that cost and settle the same, the one in which more explanations change the reading.
    """
    weight = _pair_weights(found)

    def gain(one: _Candidate, others: Sequence[_Candidate]) -> float:
        return float(weight[one.apart & ~np.any([np.zeros_like(one.apart), *(c.apart for c in others)], axis=0)].sum())

    def order(one: _Candidate) -> tuple[float, float, float]:
        acting = sum(found[k].weight for k, outcome in one.outcomes.items() if outcome.acting)
        return one.trial.minutes, -gain(one, chosen), -acting

    chosen: list[_Candidate] = []
    waiting = list(candidates)
    while waiting:
        best = min(waiting, key=order)
        waiting.remove(best)
        if gain(best, chosen) >= WORTH:
            chosen.append(best)
    while len(chosen) > MOST:
        chosen.remove(min(chosen, key=lambda c: (gain(c, [o for o in chosen if o is not c]), -c.trial.minutes)))
    return chosen


def _pair_weights(found: Sequence[_Explanation]) -> Array:
    """(n, n): how likely it is that the truth is one of two explanations; the sum of all is one, the diagonal zero."""
    heaviest = max(e.weight for e in found)
    weights = np.array([max(e.weight, 1e-9 * heaviest) for e in found])  # so that zeros leave something to divide by
    pairs = np.outer(weights, weights)
    np.fill_diagonal(pairs, 0.0)
    return np.asarray(pairs / pairs.sum())


def _sentence(candidate: _Candidate, found: Sequence[_Explanation]) -> str:
    """What to do, and what is read on each side; last the side on which the reading is the model's."""

    def either(sets: Sequence[EffectSet]) -> str:
        texts = list(dict.fromkeys(" + ".join(names) if names else "nothing is missing" for names in sets))
        hidden = len(texts) - LISTED
        more = [] if hidden < 1 else ["one other"] if hidden == 1 else [f"one of {hidden} others"]
        return " or ".join((*texts[:LISTED], *more))

    outcomes, setup = candidate.outcomes, candidate.setup
    nominal = setup.predict({})

    def unchanged(group: Group) -> bool:
        value = outcomes[group[0]].value
        return value is not None and setup.same(value, nominal)

    # whether effects that change the reading name a side without doubt: no set of another side has them all
    sides_apart = combinations(candidate.groups, 2)
    pairs = [p for one, other in sides_apart for p in (*product(one, other), *product(other, one))]
    acting = {k: frozenset(outcomes[k].acting) for group in candidate.groups for k in group}
    short = not any(acting[i] and acting[i] <= set(found[j].effects) for i, j in pairs)
    whole = len(outcomes) == len(found)
    sides = []
    for group in sorted(candidate.groups, key=unchanged):
        rest = unchanged(group) and short and whole and len(candidate.groups) == 2
        names = [outcomes[k].acting if short and outcomes[k].acting else found[k].effects for k in group]
        known = next((o.value for o in (outcomes[k] for k in group) if o.value is not None), None)
        reading = setup.changed if known is None else setup.says(known)
        sides.append(f"{reading} {'if not' if rest else f'if {either(names)}'}")
    return f"{setup.action}: {'; '.join(sides)}."


def _open(left: Mask, found: Sequence[_Explanation]) -> Group:
    """The likeliest pair that the bench leaves together, `left` (n, n), and what it leaves with them; `LISTED` at most.

    Where it leaves none: the heaviest.
    """
    weight = np.where(np.triu(left, 1), _pair_weights(found), 0.0)
    if not weight.any():
        return tuple(range(len(found)))[:LISTED]
    pair = [int(k) for k in np.unravel_index(np.argmax(weight), weight.shape)]
    third = [k for k in range(len(found)) if k not in pair and left[k, pair].any()]
    return tuple(sorted((*pair, *third[: LISTED - 2])))


def _flight(group: Group, found: Sequence[_Explanation]) -> Check:
    """A flight for these explanations: for the effects in which they differ, what excites them."""
    members = [found[k] for k in group]
    names = dict.fromkeys(n for e in members for n in e.effects if not all(n in other.effects for other in members))
    effects = catalogue()
    excited = [f"{n}: {effects[n].excited_by.replace(';', ',')}" for n in names if n in effects]
    command = (
        f" what `wrenchgap design {' '.join(names)} -m MODEL -o flight.toml` writes, if such a flight exists"
        if len(names) > 1
        else ""
    )
    what = f"Fly{command or ' again'}; what excites the differences: {'; '.join(excited) or ', '.join(names)}."
    return Check("flight", what, tuple((e.effects,) for e in members), "flight")
