"""What flights could have shown: for each parameter, the smallest change that the search would have made firm.

The wrench of an effect at some size is added to what the flights measured, in the linear problem of the search: with
q_0 what the model leaves and q_p what a unit of the parameter adds, q_0 becomes q_0 + theta q_p, and the products that
sets are scored on become

    P_00 + 2 theta P_0p + theta^2 P_pp,      P_0k + theta P_pk

so that an injection costs one row. Then the sets which the search would have compared are scored by the search's own
function (`SubsetSearch.score`): those found beside the effect, against the likeliest that do without it (as found, and
with the one or two other effects that promise most). The log odds L of the two, of which F come from the fit, vary from
block to block by about 2 F, as a log likelihood ratio does; the weight that the bootstrap over blocks then gives the
effect is the mean of a logistic function over a normal one,

    weight = 1 / (1 + exp(-L / sqrt(1 + pi/8 2 F)))

Source: MacKay, Neural Computation 4, 1992, eq. 10. A size is firm where that weight times the trust in its evidence
(`learn.posterior.scored_sets.Part`) is that of a firm name, and the evidence is worth a name.

A lag is no straight line: through what it adds at the size t0 where it was linearised goes the parabola
J t + c (2 t/t0 - (t/t0)^2), J its derivative there and c what the straight line lacks, and its secant is injected.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.blocks import LEAST_EVIDENCE, needed, paired_t, significant
from wrenchgap.learn.identify.fit import MATERIAL
from wrenchgap.learn.posterior.linear_problem import quadratic
from wrenchgap.learn.posterior.score import Keys, Scorer
from wrenchgap.learn.posterior.scored_sets import (
    ABOVE_SENSORS,
    FIRM,
    OTHERWISE,
    ROUGH,
    bootstrapped,
    by_axis,
    rough_laws,
    size_by_axis,
)
from wrenchgap.learn.posterior.subset_search import SubsetSearch
from wrenchgap.plant.effects import family, find
from wrenchgap.plant.vehicle import Vehicle

ADVERSE = 1.28
"""Standard deviations by which noise may have made an effect look smaller: of ten logs like this, one has more."""
EXACT = 1e-6
"""Share of the sensors' mean square below which nothing is told by what is left on an axis."""
WEIGHED = 4
"""Likeliest sets without the effect that are weighed against the one with it."""
RELEVANT = 0.01
"""Size of the prior, in typical sizes, of other parameters of which few are not zero (`kernels.relevant`)."""
ROUNDS = 3
"""Of the noise's spectrum and of what is left without an effect, in turn."""
RATIO, STRIDE = 1.1, 5
"""Between two sizes that are tried, the resolution of a limit; so many are passed over until the first that is firm."""


@dataclass(frozen=True)
class DetectionLimit:
    """The smallest change of a parameter that would have been firm, all else being as it was found.

    `size` in `unit`, with the sign of the larger plausible change; NaN where no plausible size, up to `plausible`,
    would have been firm. Then `instead` are effects that could make the same; none where it is too weak.
    """

    effect: str
    parameter: str
    unit: str
    size: float
    plausible: float
    instead: tuple[str, ...] = ()

    @property
    def shown(self) -> bool:
        """Whether a plausible size would have been firm."""
        return math.isfinite(self.size)


def detection_limits(
    scorer: Scorer, named: Keys, vehicle: Vehicle, silent: NDArray[np.bool_] | None = None
) -> tuple[DetectionLimit, ...]:
    """Of every effect that stands alone as a candidate and is not `named` already, in any of its forms; on `silent`
    axes (6,) evidence makes no name firm. Without these the search is one for changes, whose evidence is their log odds
    (`learn.changed.search`).
    """  # noqa: D205
    counting = None if silent is None else ~silent[scorer.spectrum.axes]
    search = SubsetSearch(scorer, scorer(named).variance)
    columns = scorer.spectrum.columns
    taken = {family(n) for k in named for n in columns[k].names}
    alone = [k for k, c in columns.items() if len(c.names) == 1 and family(k) not in taken]
    found = []
    for key in alone:
        beside = tuple(k for k in named if k in search.others[key])
        for index, parameter in enumerate(find(key).parameters(vehicle)):
            if not parameter.alone:
                continue
            injection = Injection(search, key, index, beside, counting)
            size, instead = injection.limit()
            found.append(DetectionLimit(key, parameter.name, parameter.unit, size, injection.plausible, instead))
    return tuple(found)


class Untaken(NamedTuple):
    """Of a unit of a parameter: mean squares (bands, A) that nothing else takes up; of a change of it the `share` that
    a fit gives back, and the standard deviation of what it gives (`spread`).
    """  # noqa: D205

    squares: Array
    share: float
    spread: float


class Injection:
    """One parameter of a candidate, injected beside the sets that were found; sizes are changes of the parameter."""

    def __init__(
        self, search: SubsetSearch, key: str, index: int, beside: Keys, counting: NDArray[np.bool_] | None = None
    ) -> None:
        """Of the parameter `index` of the candidate `key`; evidence is taken from axes that are `counting` (A,), if it
        is asked for.
        """  # noqa: D205
        self.counting = counting
        space = search.space
        self.search, self.key, self.beside = search, key, beside
        self.row, self.offset = int(space.parameters[key][index]), space.offset[key]
        column = space.columns[key]
        low, high = column.low[index], column.high[index]
        self.least = MATERIAL * float(column.scale[index])
        self.plausible = float(low if -low > high else high)
        self.bend = float(column.theta[0]) if len(column.theta) == 1 else 0.0
        same = family(key)
        self.others = [k for k, c in space.columns.items() if same not in {family(n) for n in c.names}]

    def limit(self) -> tuple[float, tuple[str, ...]]:
        """The smallest firm size that is worth a name, or NaN; then what could make the same."""
        least, most = self.least, abs(self.plausible)
        count = 1 + math.ceil(math.log(max(most / least, 1.0)) / math.log(RATIO))
        sizes = np.copysign(np.geomspace(min(least, most), most, count), self.plausible)
        low = -1
        for high in dict.fromkeys([*range(0, count, STRIDE), count - 1]):
            instead, firm = self.tried(sizes[high])
            if firm:
                break
            low = high
        else:
            return math.nan, instead
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self.tried(sizes[middle])[1] else (middle, high)
        return float(sizes[high]), ()

    def tried(self, size: float) -> tuple[tuple[str, ...], bool]:
        """Effects that could make what this size makes, and whether it would have been firm."""
        search = self.injected(size)
        own = tuple(sorted((*self.beside, self.key)))
        if not math.isfinite(search.score(own)):
            return (), False
        weights = {rival: self.weight(search, own, rival) for rival in self.rivals(search)}
        likeliest = min(weights, key=lambda rival: weights[rival])
        columns = search.space.columns
        if weights[likeliest] < FIRM:
            return tuple(n for k in likeliest if k not in self.beside for n in columns[k].names), False
        unit = self.untaken(size)
        if unit.share * abs(size) - ADVERSE * unit.spread <= self.least:
            return (), False
        if self.counting is None:
            return (), True
        trust, evidence = self.told(size, unit.squares)
        if evidence <= LEAST_EVIDENCE:
            return (), False
        if weights[likeliest] * trust < FIRM:
            return tuple(n for k in self.beside if columns[k].accuracy > ROUGH for n in columns[k].names), False
        return self.weighed(size, [own, *sorted(weights, key=search.score)[-WEIGHED:]], trust, evidence)

    def weighed(self, size: float, sets: Sequence[Keys], trust: float, evidence: float) -> tuple[tuple[str, ...], bool]:
        """The same by scores with the noise unknown and the bootstrap over blocks of time: no other set has a weight
        that counts, and of the first set, which has the effect, every member is needed in more than a few blocks.
        """  # noqa: D205
        scorer = self.injected_scorer(size)
        scored = [replace(s, weights=self.with_injection(s.weights, size)) for s in map(scorer, sets)]
        by_block = np.array([scorer.by_block(one) for one in scored])
        share = bootstrapped(by_block, np.array([one.prior for one in scored]))
        columns = scorer.spectrum.columns
        if share[0] * trust < FIRM or share[1:].max() >= OTHERWISE:
            likeliest = sets[1 + int(np.argmax(share[1:]))]
            return tuple(n for k in likeliest if k not in self.beside for n in columns[k].names), False
        if not needed(self.significance(scorer, sets[0], self.key, size), evidence):
            return (), False
        lost = [k for k in self.beside if not significant(self.significance(scorer, sets[0], k, size), large=True)]
        return tuple(n for k in lost for n in columns[k].names), not lost

    def significance(self, scorer: Scorer, keys: Keys, gone: str, size: float) -> float:
        """Paired t over blocks of a set against the same without one member (`learn.data.blocks.contrast`)."""
        space = self.search.space
        both = [scorer(some).weights for some in (keys, tuple(k for k in keys if k != gone))]
        better, worse = (space.combined(self.with_injection(w, size)) ** 2 for w in both)
        over = np.sqrt(better.mean(axis=0) * worse.mean(axis=0))
        loss = (worse - better) / np.maximum(over, EXACT * by_axis(scorer, space.sensor))
        return float(paired_t(np.add.reduceat(loss.sum(axis=1), space.starts)))

    def weight(self, search: SubsetSearch, own: Keys, rival: Keys) -> float:
        """Of the set with the effect against one without it."""
        odds = search.score(own) - search.score(rival)
        fit = odds - (search.priors[own] - search.priors[rival])
        return 1.0 / (1.0 + math.exp(min(-odds / math.sqrt(1.0 + math.pi / 4.0 * max(fit, 0.0)), 700.0)))

    def injected(self, size: float) -> SubsetSearch:
        """The search on the flights with the effect at this size in them."""
        search = copy.copy(self.search)
        search.scores, search.priors = {(): 0.0}, {(): 0.0}
        search.whole = self.search.whole.copy()
        self._inject(search.whole, size)
        return search

    def injected_scorer(self, size: float) -> Scorer:
        """The scorer of the flights with the effect at this size in them."""
        space = copy.copy(self.search.space)
        products = space.products.copy()
        self._inject(products, size)
        space.__dict__["products"] = products
        scorer = copy.copy(self.search.scorer)
        scorer.spectrum, scorer.known = space, {}
        return scorer

    def with_injection(self, weights: Array, size: float) -> Array:
        """Weights (Q,) of the quantities of the flights with the effect in them, as weights of those without it."""
        out = weights.copy()
        out[self.row] += size
        out[self.offset] = self._secant(size) * out[self.row]
        return out

    def _inject(self, products: Array, size: float) -> None:
        """Into products (..., Q, Q): the candidate becomes the straight line through what it adds at this size, and
        that is added to what the model leaves.
        """  # noqa: D205
        share = self._secant(size)
        for rows in (products, products.swapaxes(-1, -2)):
            rows[..., self.row, :] += share * rows[..., self.offset, :]
            rows[..., self.offset, :] = 0.0
        for rows in (products, products.swapaxes(-1, -2)):
            rows[..., 0, :] += size * rows[..., self.row, :]

    def _secant(self, size: float) -> float:
        return (2.0 - min(abs(size / self.bend), 1.0)) / self.bend if self.bend else 0.0

    def rivals(self, search: SubsetSearch) -> list[Keys]:
        """What was found as it is or without one of its members, and with the one or two others that promise most."""
        starts = [self.beside, *(tuple(k for k in self.beside if k != gone) for gone in self.beside)]
        first = [*starts, *(keys for start in starts for keys in self.extended(search, start))]
        best = sorted(first, key=search.score)[-3:]
        return [*first, *(k for keys in best for k in self.extended(search, keys))]

    def extended(self, search: SubsetSearch, keys: Keys) -> list[Keys]:
        """A set with each of those others that promise most."""
        wanted = [k for k in search.promising(keys, self.others) if all(k in search.others[o] for o in keys)]
        return [tuple(sorted((*keys, k))) for k in wanted]

    def told(self, size: float, squares: Array) -> tuple[float, float]:
        """Trust in the evidence for this size beside what was found, and that evidence (`scored_sets.parts_of`) where
        noise takes `ADVERSE` standard deviations off it. `squares` are those of `untaken`.
        """  # noqa: D205
        scorer, space = self.search.scorer, self.search.space
        found = scorer(self.beside)
        sensor = by_axis(scorer, space.sensor)
        left = np.maximum(by_axis(scorer, found.left), EXACT * sensor)
        returns = size**2 * by_axis(scorer, squares) / left
        above = np.maximum(1.0 - ABOVE_SENSORS**2 * sensor / left, 0.0) * returns / (returns + 1.0)
        own = size**2 * by_axis(scorer, space.products[:, :, self.row, self.row])
        law = rough_laws(space, {k: size_by_axis(scorer, found, k) for k in self.beside})
        trusted = returns * own / np.maximum(own + law, 1e-30)
        spread = np.sqrt(np.sum(returns / (1.0 + returns) / (1.0 + returns) / scorer.count.sum(axis=0)))
        evidence = 0.5 * float(np.log1p(returns)[self.counting].sum()) - ADVERSE * float(spread)
        return float(trusted.sum() / max(float(np.sum(returns + above)), 1e-30)), evidence

    def untaken(self, size: float) -> Untaken:
        """What a fit leaves to the parameter, all else that was found and is always there being free; at the noise that
        is then left without the effect (`Scorer.pooled`), in `ROUNDS` turns.
        """  # noqa: D205
        scorer, space = self.search.scorer, self.search.space
        own = np.setdiff1d(space.parameters[self.key], [self.row])
        unknown = np.concatenate([*(space.parameters[k] for k in self.beside), space.always]).astype(np.intp)
        every = np.concatenate([unknown, own, [self.row, self.offset]])
        added = np.array([1.0, self._secant(size)])
        n, sizes = len(unknown), space.scale[every[:-1]] * np.where(space.sparse[every[:-1]], RELEVANT, 1.0)
        sizes[-1] = abs(size) if space.sparse[self.row] else space.scale[self.row]  # `kernels.relevant`, of one alone
        products = space.products[:, :, every[:, None], every]
        found = scorer(self.beside)
        squares = np.zeros(found.left.shape)
        for _ in range(ROUNDS):
            whole = scorer.weighed(scorer.pooled(found.left + size**2 * squares))[np.ix_(every, every)]
            whole[:, -2] = whole[:, -2:] @ added
            whole[-2] = added @ whole[-2:]
            inner = whole[:-1, :-1] + np.diag(sizes**-2.0)
            weights = np.concatenate([-np.linalg.solve(inner[:n, :n], whole[:n, -2]), np.zeros(len(own)), added])
            squares = np.maximum(quadratic(products, weights), 0.0)
        inverse = np.linalg.inv(inner)
        return Untaken(squares, float(inverse[-1] @ whole[:-1, -2]), float(np.sqrt(inverse[-1, -1])))
