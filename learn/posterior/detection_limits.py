"""What flights could have shown: for each parameter, the smallest change that the search would have made firm.

The wrench of an effect at some size is added to what the flights measured, in the linear problem of the search, which
costs one row of its products (docs/theory/posterior.md, Detection limits). Then the search's own functions are asked:
the set that was found with the effect is weighed against the likeliest sets without it (as found, or without one of its
members, and with the one or two other effects that promise most), and what is said of its members is what is said of
any set. Noise may make an effect look smaller: the limit is the smallest size that is firm, and `ADVERSE` standard
deviations more.

A lag is no straight line: through what it adds at the size t0 where it was linearised goes the parabola
J t + c (2 t/t0 - (t/t0)^2), J its derivative there and c what the straight line lacks, and its secant is injected.

What is firm in products need not be on the axes where commands answer the motion: there a limit is confirmed with the
effect in what the flights measured (`learn.posterior.injection`), where searches are repeated too.
"""

import itertools
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array, Mask
from wrenchgap.learn.data.blocks import SIGNIFICANCE, common_variance, needed, paired_t, significant
from wrenchgap.learn.identify.fit import MATERIAL
from wrenchgap.learn.posterior.columns import confused
from wrenchgap.learn.posterior.joint_search import alias_weight, aliases
from wrenchgap.learn.posterior.linear_problem import LinearProblem
from wrenchgap.learn.posterior.posterior import predict_the_same
from wrenchgap.learn.posterior.score import Keys, Scorer
from wrenchgap.learn.posterior.scored_sets import GROWTH, Rule, bootstrapped, by_axis, parts_of, scored_set
from wrenchgap.learn.posterior.spectrum import Spectrum
from wrenchgap.learn.posterior.subset_search import SubsetSearch
from wrenchgap.plant.effects import family, find
from wrenchgap.plant.vehicle import Vehicle

ADVERSE = 1.28
"""Standard deviations by which noise may have made an effect look smaller: of ten logs like this, one has more."""
WEIGHED = 4
"""Likeliest sets without the effect that are weighed against the one with it."""
RATIO, STRIDE = 1.1, 5
"""Between two sizes that are tried, the resolution of a limit; so many are passed over until the first that is firm."""


@dataclass(frozen=True)
class DetectionLimit:
    """The smallest change of a parameter that would have been firm, all else being as it was found.

    `size` in `unit`, with the sign of the larger plausible change; NaN where no plausible size, up to `plausible`,
    would have been firm. Then `instead` are effects that could make the same; none where it is too weak. `where` are
    the values, by name, that parameters have of which nothing is seen without it: the height of the ground, say.
    """

    effect: str
    parameter: str
    unit: str
    size: float
    plausible: float
    instead: tuple[str, ...] = ()
    where: tuple[tuple[str, float], ...] = ()

    @property
    def shown(self) -> bool:
        """Whether a plausible size would have been firm."""
        return math.isfinite(self.size)


Flown = Callable[[DetectionLimit, Collection[str]], Scorer]
"""What scores flights with a change in them, with these candidates."""


def detection_limits(
    scorer: Scorer,
    named: Keys,
    vehicle: Vehicle,
    rule: Rule = GROWTH,
    silent: Mask | None = None,
    of: Sequence[str] | None = None,
    flown: Flown | None = None,
) -> tuple[DetectionLimit, ...]:
    """Of every effect, or of those in `of`, that stands alone as a candidate and is not `named` already, in any of its
    forms; members of sets are judged by this rule.

    With `silent` axes (6,), on which evidence makes no name firm, members are to be needed on blocks of time as well
    (`learn.posterior.members`); without, the search has no such test (`learn.changed.search`). With `flown`, which
    scores the flights with a change in them (`injection.with_injection`), a limit is what is firm there too.
    """  # noqa: D205
    search = SubsetSearch(scorer, scorer(named).variance)
    columns = scorer.spectrum.columns
    taken = {family(n) for k in named for n in columns[k].names}
    found = []
    for key in (k for k, c in columns.items() if len(c.names) == 1 and family(k) not in taken):
        if of is not None and key not in of:
            continue
        beside = tuple(k for k in named if k in search.others[key])
        parameters = find(key).parameters(vehicle)
        first = zip(parameters, columns[key].theta, strict=False)  # a second kind of loss may follow (`learn.changed`)
        where = tuple((p.name, float(value)) for p, value in first if not p.alone)
        for index, parameter in enumerate(parameters):
            if parameter.alone:
                one = Injections(search, rule, key, index, beside, silent, vehicle)
                size, instead = one.limit()
                limit = DetectionLimit(key, parameter.name, parameter.unit, size, one.plausible, instead, where)
                found.append(limit if flown is None else one.confirmed(limit, flown))
    return tuple(found)


class InjectedSpectrum(Spectrum):
    """A spectrum of the same flights with a candidate in them: `size` of its parameter in the row `row`.

    The candidate is the straight line through what it adds at this size: its offset, `secant` times, is part of it.
    """

    def __init__(self, given: LinearProblem, row: int, offset: int, size: float, secant: float) -> None:
        self.__dict__.update(given.__dict__)
        self.row, self.offset_row, self.size, self.secant = row, offset, size, secant
        products = given.products.copy()
        for rows in (products, products.swapaxes(-1, -2)):
            rows[..., row, :] += secant * rows[..., offset, :]
            rows[..., offset, :] = 0.0
        for rows in (products, products.swapaxes(-1, -2)):
            rows[..., 0, :] += size * rows[..., row, :]
        self.__dict__["products"] = products

    def combined(self, weights: Array) -> Array:
        """As of any spectrum."""
        given = weights.copy()
        given[self.row] += self.size * given[0]
        given[self.offset_row] = self.secant * given[self.row]
        return super().combined(given)


class Injections:
    """One parameter of a candidate at different sizes, beside the set that was found."""

    def __init__(
        self,
        search: SubsetSearch,
        rule: Rule,
        key: str,
        index: int,
        found: Keys,
        silent: Mask | None,
        vehicle: Vehicle,
    ) -> None:
        """Of the parameter `index` of the candidate `key`; the rest as for `detection_limits`.

        A change is plausible up to the effect's own bounds: those of a search between flights are wider.
        """
        self.search, self.rule, self.silent = search, rule, silent
        self.settings = search.settings
        self.seldom = math.exp(-0.5 * (math.sqrt(-2.0 * math.log(self.settings.otherwise)) + ADVERSE) ** 2)
        """Weight up to which another set keeps no name from being firm, when noise is as adverse to what tells them."""
        self.key, self.index, self.found = key, index, found
        columns = search.space.columns
        column = columns[key]
        own, origin = find(key).parameters(vehicle)[index], float(column.origin[index])
        low, high = max(column.low[index], own.low - origin), min(column.high[index], own.high - origin)
        self.least = MATERIAL * float(column.scale[index])
        self.plausible = float(low if -low > high else high)
        self.bend = float(column.theta[0]) if len(column.theta) == 1 else 0.0
        self.own = tuple(sorted((*found, key)))
        self.others = [k for k, c in columns.items() if family(key) not in {family(n) for n in c.names}]

    def limit(self) -> tuple[float, tuple[str, ...]]:
        """The smallest change that would have been firm, or NaN; then what could make the same."""
        most = abs(self.plausible)
        if not most:  # healthy flights are at the bound of what is plausible already
            return math.nan, ()
        count = 1 + math.ceil(math.log(max(most / self.least, 1.0)) / math.log(RATIO))
        sizes = np.copysign(np.geomspace(min(self.least, most), most, count), self.plausible)
        low = -1
        for high in dict.fromkeys([*range(0, count, STRIDE), count - 1]):
            instead, spread = self.tried(sizes[high], rivals_wanted=high == count - 1)
            if math.isfinite(spread):
                break
            low = high
        else:
            return math.nan, instead
        while high - low > 1:
            middle = (low + high) // 2
            _, other = self.tried(sizes[middle])
            if math.isfinite(other):
                high, spread = middle, other
            else:
                low = middle
        size = float(sizes[high] + math.copysign(ADVERSE * spread, self.plausible))
        return (size, ()) if abs(size) <= most else (math.nan, ())

    def confirmed(self, limit: DetectionLimit, flown: Flown, larger: float = 1.5) -> DetectionLimit:
        """The limit as it is firm where it was flown, perhaps some times `larger`; none where it is not. There it is
        weighed against what comes close in the products.
        """  # noqa: D205
        if not limit.shown:
            return limit
        rivals = self.likeliest_without(self.search.on(self.injected(limit.size)))
        near = {*self.own, *itertools.chain(*rivals), *confused(self.key, self.search.space.columns)}
        while abs(limit.size) <= abs(limit.plausible):
            try:
                instead, spread = self.judged(flown(limit, near), rivals_wanted=True)
            except ModelError:  # an inertia that no body has, say
                break
            if math.isfinite(spread):
                return limit
            limit = replace(limit, size=larger * limit.size, instead=instead)
        return replace(limit, size=math.nan)

    def injected(self, size: float) -> Scorer:
        """What scores the products of flights with this size of it."""
        secant = (2.0 - min(abs(size / self.bend), 1.0)) / self.bend if self.bend else 0.0
        space = self.search.space
        row = int(space.parameters[self.key][self.index])
        return self.search.scorer.on(InjectedSpectrum(space, row, space.offset[self.key], size, secant))

    def tried(self, size: float, *, rivals_wanted: bool = False) -> tuple[tuple[str, ...], float]:
        """`judged` where the flights have this size of it."""
        return self.judged(self.injected(size), rivals_wanted=rivals_wanted)

    def judged(self, scorer: Scorer, *, rivals_wanted: bool) -> tuple[tuple[str, ...], float]:
        """Effects that could make what the flights have, if `rivals_wanted`; the standard deviation of a fit of it, NaN
        where it would not have been firm.
        """  # noqa: D205
        space, search = scorer.spectrum, self.search.on(scorer)
        if not rivals_wanted and search.score(self.own) < search.score(self.found):
            return (), math.nan  # too small, whatever else could make it
        rivals = self.likeliest_without(search)
        if search.score(self.own) < search.score(rivals[0]):
            return self.instead([r for r in rivals if search.score(r) > search.score(self.own)]), math.nan
        scored = [scorer(keys) for keys in (self.own, *rivals)]
        weights = bootstrapped(np.array([scorer.by_block(s) for s in scored]), np.array([s.prior for s in scored]))
        if weights[1:].max() >= self.seldom:
            return self.instead([r for r, w in zip(rivals, weights[1:], strict=True) if w >= self.seldom]), math.nan
        part = parts_of(scorer, self.own, rule=self.rule)[self.own.index(self.key)]
        if not part.named:
            return (), math.nan
        if weights[0] * part.trust < self.settings.firm:
            rough = [k for k in self.found if space.columns[k].accuracy > self.settings.rough]
            return self.names(rough), math.nan
        if self.silent is not None and (lost := self.not_needed(scorer, self.silent)):
            return self.names([k for k in lost if k != self.key]), math.nan
        if self.silent is not None and (alike := self.alike(scorer)):
            return alike, math.nan
        return (), float(scorer.deviations(scored[0])[self.key][self.index])

    def alike(self, scorer: Scorer) -> tuple[str, ...]:
        """Effects that would make the same, to all that these flights show."""
        own, least = scored_set(scorer, self.own, rule=self.rule), self.seldom
        others = [k for k in aliases(scorer, own.scored) if self.key not in k]
        close = [k for k in others if alias_weight(scorer, scorer(k), own.scored) >= least]
        same = [k for k in close if predict_the_same(own, scored_set(scorer, k, rule=self.rule), scorer)]
        return self.instead(same)

    def likeliest_without(self, search: SubsetSearch) -> list[Keys]:
        """`WEIGHED` sets without the effect, the likeliest first."""
        starts = [self.found, *(tuple(k for k in self.found if k != gone) for gone in self.found)]
        first = [*starts, *(keys for start in starts for keys in self.extended(search, start))]
        best = sorted(first, key=search.score)[-3:]
        every = dict.fromkeys([*first, *(k for keys in best for k in self.extended(search, keys))])
        return sorted(every, key=search.score, reverse=True)[:WEIGHED]

    def extended(self, search: SubsetSearch, keys: Keys) -> list[Keys]:
        """A set with each of those others that promise most."""
        others = [k for k in self.others if k in search.space.columns]
        wanted = [k for k in search.promising(keys, others) if all(k in search.others[o] for o in keys)]
        return [tuple(sorted((*keys, k))) for k in wanted]

    def instead(self, rivals: Sequence[Keys]) -> tuple[str, ...]:
        """Effects by which the plainest of these sets, the likeliest first, is more than what was found."""
        return min((self.names([k for k in keys if k not in self.found]) for keys in rivals), key=len, default=())

    def names(self, keys: Sequence[str]) -> tuple[str, ...]:
        """Effects of candidates."""
        return tuple(n for k in keys for n in self.search.space.columns[k].names)

    def not_needed(self, scorer: Scorer, silent: Mask) -> list[str]:
        """Members without which blocks of time are left no worse, beyond chance; the effect itself where its evidence
        is on `silent` axes.
        """  # noqa: D205
        space, out = scorer.spectrum, []
        with_it = by_axis(scorer, scorer(self.own).left)
        better = space.combined(scorer(self.own).weights) ** 2
        for key in self.own:
            rest = scorer(tuple(k for k in self.own if k != key))
            worse = space.combined(rest.weights) ** 2
            loss = (worse - better) / common_variance(worse, better)
            t = float(paired_t(np.add.reduceat(loss.sum(axis=1), space.starts)))
            gain = 0.5 * np.log(by_axis(scorer, rest.left) / with_it)
            enough = needed(t, float(gain.sum())) and gain[~silent[space.axes]].sum() > SIGNIFICANCE.least_evidence
            if not (enough if key == self.key else significant(t, large=True)):
                out.append(key)
        return out
