"""The posterior over sets of effects: what is established, what is open.

Sets are searched with every candidate linearised by itself; those that come close are linearised anew together, lags
and delays also in each other's place, and weighed. Sets with the same names are one; sets that predict the same on
these flights are one class (`learn.posterior.classes`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from wrenchgap.flight.flight import Array
from wrenchgap.learn.parallel import each
from wrenchgap.learn.posterior.classes import Class, NamedSet, classes, merged, one_each, settled
from wrenchgap.learn.posterior.columns import Column, compatible
from wrenchgap.learn.posterior.score import Keys, Scorer
from wrenchgap.learn.posterior.sets import Contender, contender, ordered, searched, weights
from wrenchgap.learn.posterior.settle import Check
from wrenchgap.learn.posterior.table import Ground
from wrenchgap.learn.posterior.together import Noise, linearised_together, spectrum_of
from wrenchgap.plant.effects import family, find
from wrenchgap.plant.vehicle import Vehicle

KEPT = 40
"""Sets that are weighed."""
CONTENDERS = 6
"""Sets that are linearised anew in one round, at most; in the first also those with lags in each other's place."""
BEHIND = 15.0
"""Log odds behind the best set up to which another may still turn out better when both are linearised anew."""
ROUNDS = 3
FIRM = 0.9
"""Share of the weight from which on a name is firm."""
SUREST = 0.98
"""Largest probability that is stated: no catalogue is complete."""


@dataclass(frozen=True)
class Posterior:
    """Named sets, heaviest first, the classes that they form, and what would settle which of all sets is true."""

    sets: tuple[NamedSet, ...]
    classes: tuple[Class, ...]
    settle: tuple[Check, ...]

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
        return min(SUREST, total)

    def without(self, name: str, vehicle: Vehicle) -> Posterior:
        """The same where `name` turned out to do nothing beside the rest of the best set: it goes from all sets that
        have that rest.
        """  # noqa: D205
        rest = set(self.best.names) - {name}

        def shorter(sets: Sequence[NamedSet]) -> tuple[NamedSet, ...]:
            every = [
                replace(s, names=tuple(n for n in s.names if n != name)) if rest <= set(s.names) else s for s in sets
            ]
            return one_each(every)

        sets = shorter(self.sets)
        groups = [Class(c.weight, shorter(c.sets)) for c in self.classes]
        kept = [replace(c, settle=settled(c.sets, vehicle)) for c in groups]
        return Posterior(sets, tuple(kept), settled(sets, vehicle))

    @property
    def firm(self) -> tuple[str, ...]:
        """Names that are in nine tenths of the weight; of an effect with several forms that of its family."""
        named = dict.fromkeys(family(n) for s in self.sets for n in s.names)
        return tuple(f for f in named if self.probability([f]) >= FIRM)


def posterior(
    on: Ground,
    columns: Sequence[Column],
    *,
    jobs: int = 1,
    progress: Callable[[float, str], None] | None = None,
) -> Posterior:
    """Weigh the sets of these columns."""
    tell = progress or (lambda fraction, words: None)
    tell(0.0, "weighing sets of effects")
    linear = searched(spectrum_of(on, columns))
    anew: dict[Keys, Contender | None] = {}
    todo = first_contenders(linear)
    for number in range(ROUNDS):
        tell((1 + number) / (2 + ROUNDS), "fitting the likeliest sets")
        anew |= zip(todo, linearised(on, linear, todo, jobs), strict=True)
        kept = candidates(linear, anew)
        share = weights(kept)
        best = sorted(range(len(kept)), key=lambda k: -share[k])
        todo = [kept[k].keys for k in best[:3] if kept[k].keys and kept[k].keys not in anew]
        if not todo:
            break
    sets = merged(kept, share)
    vehicle = on.model.vehicle
    return Posterior(sets, classes(sets, linear, vehicle), settled(sets, vehicle))


def first_contenders(linear: Scorer) -> list[Keys]:
    """Sets to linearise anew: the best, and the best with lags and delays in each other's place."""
    best = ordered(linear)
    close = [s for s in best if s.log_probability > best[0].log_probability - BEHIND]
    found: list[Keys] = []
    seen: set[frozenset[str]] = set()
    for s in close:
        large = frozenset(k for k in s.keys if _size(linear, s.theta, k) > 0.1)
        if s.keys and large not in seen and len(found) < CONTENDERS:
            seen.add(large)
            found.append(s.keys)
    columns = linear.spectrum.columns
    bent = [k for k in columns if _bent(k)]
    for gone in set(bent) & set(best[0].keys):
        rest = tuple(k for k in best[0].keys if k != gone)
        swapped = [tuple(sorted((*rest, other))) for other in bent if other not in best[0].keys]
        found += [keys for keys in swapped if compatible(keys, columns)]
    return list(dict.fromkeys(found))


def _bent(key: str) -> bool:
    """Whether a candidate is one of time, far from a straight line."""
    return all(find(n).place == "commands" for n in key.split(" + "))


def _size(linear: Scorer, theta: dict[str, Array], key: str) -> float:
    return float(max(abs(theta[key]) / linear.spectrum.columns[key].scale))


def linearised(on: Ground, linear: Scorer, sets: Sequence[Keys], jobs: int) -> list[Contender | None]:
    """`linearised_together` of these sets, by `jobs` processes."""
    lines = {k: ([linear.spectrum.columns[c] for c in k], [linear(k).theta[c] for c in k]) for k in sets}
    by_name = {" | ".join(k): k for k in sets}
    noise = Noise(linear.reference, linear.spectrum.factors)

    def work(name: str) -> Contender | None:
        columns, theta = lines[by_name[name]]
        return linearised_together(on, columns, theta, noise)

    return list(each(work, list(by_name), jobs, (on.data, on.model)))


def candidates(linear: Scorer, anew: dict[Keys, Contender | None]) -> list[Contender]:
    """The sets to weigh: those linearised anew, and of the others the likeliest as they are."""
    again = [c for c in anew.values() if c is not None]
    best = max((c.scored.log_probability for c in again), default=-1e300)
    others = [s for s in ordered(linear)[:KEPT] if anew.get(s.keys) is None]
    likely = [s for s in others if s.log_probability > best - BEHIND or not again]
    return [*again, *(contender(linear, s.keys) for s in likely)]
