"""Which changes: the search over sets of `learn.posterior`, with changes on suspect flights as its candidates.

A change of the mean of a flight can always be said to be trim. What a set is worth is therefore the log odds in all,
trims and their prior included, and not what it takes off what is left, which trims would take off as well. Two sets are
one class where they differ by less than `indistinct` standard errors of everything that is always there.

Where drag has grown five times, the wind of the day pushes five times as much, and a rotor that is lost turns the
vehicle about a centre of mass that lies elsewhere: what else there may be is multiplied by what has changed. So
everything is linearised anew on the suspect flights, beside changes that are large (`relinearised`).
"""

import copy
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array, Mask
from wrenchgap.learn.changed.linearised_effects import LinearisedEffect, linearised, relinearised_at
from wrenchgap.learn.changed.pooled_flights import PooledFlights
from wrenchgap.learn.changed.priors import ROTOR_THRUST, read
from wrenchgap.learn.identify.fit import MATERIAL
from wrenchgap.learn.identify.least_squares import left_by
from wrenchgap.learn.parallel import each
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.posterior import (
    EquivalenceClass,
    NamedSet,
    Posterior,
    equivalence_classes,
    merged_by_names,
    posterior,
)
from wrenchgap.learn.posterior.score import Keys, Scorer
from wrenchgap.learn.posterior.scored_sets import Rule, scored_set, weights
from wrenchgap.learn.posterior.subset_search import ordered, searched
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import ModelEffect

FAR = 0.3
"""Change from where it was linearised, in sizes of its prior (of a lag outside the best set, of itself where that is
more), that calls for new derivatives.
"""


def log_odds(scorer: Scorer, keys: Keys) -> dict[str, float]:
    """Of a set against the one without each of its changes."""
    whole = scorer(keys).log_probability
    return {gone: whole - scorer(tuple(k for k in keys if k != gone)).log_probability for gone in keys}


ODDS = Rule(log_odds, lambda scorer, keys: dict.fromkeys(keys, 1.0), 0.0, math.inf)
"""Of sets of changes."""


@dataclass(frozen=True)
class Weighed:
    """Sets of changes with their weights; the scorer that says more of each. With `settled` the heaviest set is near
    where it was linearised.
    """  # noqa: D205

    posterior: Posterior
    scorer: Scorer
    pool: PooledFlights
    settled: bool

    @property
    def nothing(self) -> float:
        """Weight of the set in which nothing changed."""
        return sum(s.weight for s in self.posterior.sets if not s.names)


def weigh(pool: PooledFlights, suspects: Collection[int], jobs: int = 1, rounds: int = 6) -> Weighed:
    """Weigh sets of changes on these flights of a pool that was calibrated on the others.

    Changes are linearised where their laws are, then where they are found: of what happens to commands by itself (two
    lags that are each half right make up for what their lines lack), and everything beside the best set; what is then,
    after so many `rounds`, still far from there is not established.
    """
    rows, vehicle, turned = pool.rows(suspects), pool.model.vehicle, False
    for number in range(rounds):
        scorer = searched(pool.spectrum(tuple(one.change(rows) for one in pool.laws), suspects), jobs)
        if number == 0 and regained(scorer):
            stronger = tuple(replace(one, regained=one.name == ROTOR_THRUST) for one in pool.laws)
            pool = replace(pool, laws=stronger)
            continue
        late, far = _late(scorer, vehicle), _moved(scorer)
        if number + 1 == rounds or not (late or far):
            break
        turned = turned or far
        if turned:
            best = ordered(scorer)[0].theta
            changes = {n: read(vehicle, n, len(theta)) @ theta for n, theta in best.items()}
            pool = relinearised(pool, suspects, changes, late, jobs)
        else:
            renewed = [
                relinearised_at(pool.data, pool.model, o, late[o.name]) if o.name in late else o for o in pool.laws
            ]
            pool = replace(pool, laws=tuple(renewed))
    log = ordered(scorer)
    settings = pool.settings
    kept = [s for s in log[: settings.weighed] if s.log_probability > log[0].log_probability - settings.behind]
    scored = [scored_set(scorer, s.keys, rule=ODDS) for s in kept]
    sets = merged_by_names(scored, weights(scored).tolist())
    found = posterior(sets, classes_of(sets, scorer), vehicle, settings)
    return Weighed(found, scorer, pool, not far)


def regained(scorer: Scorer, against: float = 3.0) -> bool:
    """Whether a rotor that is stronger on the suspect flights explains more by itself than all sets that were scored:
    its propeller is new, or the flights of both sides were exchanged.

    So it is in one comparison of twenty: `against` are log odds.
    """  # noqa: D205
    space = copy.copy(scorer.spectrum)
    if ROTOR_THRUST not in space.columns:
        return False
    rows = space.parameters[ROTOR_THRUST]
    space.low, space.high = space.low.copy(), space.high.copy()
    space.low[rows], space.high[rows] = 0.0, -space.low[rows]
    gain = scorer.on(space)((ROTOR_THRUST,)).log_probability
    return gain > ordered(scorer)[0].log_probability + against


def worth_a_name(scorer: Scorer, name: str) -> bool:
    """Whether a change by itself is large enough for a name: what is smaller, however well established, is what laws
    are off by from one trajectory to the next.
    """  # noqa: D205
    return float(np.max(np.abs(scorer((name,)).theta[name]) / scorer.spectrum.columns[name].scale)) >= MATERIAL


def _late(scorer: Scorer, vehicle: Vehicle) -> dict[str, Array]:
    """Lags and delays outside the best set that are far from where they were linearised by themselves, with values."""
    best, nothing = ordered(scorer)[0], scorer(()).log_probability
    late: dict[str, Array] = {}
    for name, column in scorer.spectrum.columns.items():
        effect, alone = find(name), scorer((name,))
        lags = effect.place == "commands" and any(p.start != 0.0 for p in effect.parameters(vehicle))
        better = alone.log_probability > nothing
        size = np.maximum(column.scale, np.abs(column.theta))
        if lags and better and name not in best.theta and _far(alone.theta[name], column, size):
            late[name] = alone.theta[name]
    return late


def _moved(scorer: Scorer) -> bool:
    """Whether a change of the best set is far from where it was linearised; gains are straight lines."""
    columns = scorer.spectrum.columns
    bent = {
        name: theta
        for name, theta in ordered(scorer)[0].theta.items()
        if not (find(name).place == "thrusts" and find(name).sparse)
    }
    return any(_far(theta, columns[name], columns[name].scale) for name, theta in bent.items())


def _far(theta: Array, column: Column, size: Array) -> bool:
    return float(np.max(np.abs(theta - column.theta) / size)) > FAR


def classes_of(sets: Sequence[NamedSet], scorer: Scorer) -> tuple[EquivalenceClass, ...]:
    """Every set in the class of the heaviest set that it cannot be told from: there are less than `indistinct` standard
    errors between their predictions, all that is always there being free to make up for them.
    """  # noqa: D205
    space, whole = scorer.spectrum, scorer.eliminated(sets[0].scored_set.scored.variance)

    def changes(one: NamedSet) -> Array:
        """Weights (Q,) of a set's own columns in the stacked quantities."""
        scored = one.scored_set.scored
        mine = space.rows(*scored.keys)
        out = np.zeros_like(scored.weights)
        out[mine] = scored.weights[mine]
        return out

    def alike(one: NamedSet, other: NamedSet) -> bool:
        apart = changes(one) - changes(other)
        errors = float(np.sqrt(max(float(apart @ whole @ apart), 0.0)))
        return bool(one.names) == bool(other.names) and errors < space.settings.indistinct

    return equivalence_classes(sets, alike)


def relinearised(
    pool: PooledFlights,
    suspects: Collection[int],
    changes: Mapping[str, Array],
    points: Mapping[str, Array],
    jobs: int = 1,
) -> PooledFlights:
    """The pool with all laws linearised anew on the suspect flights, where these effects have changed by `changes`
    (each (P,)), and other effects by themselves at `points` or where they are; as it was where no vehicle can be so.

    Every change has the offset that makes it exact on top of the larger ones: what remains with smaller ones left out
    is as exact as it was.
    """  # noqa: D205
    rows, mine = pool.rows(suspects), pool.only(suspects)
    model = changed_model(pool, changes)

    def work(name: str) -> Column:
        one = next(law for law in mine.laws if law.name == name)
        there = one.reference + changes.get(name, points.get(name, one.bent.theta))
        return linearised(mine.data, model, name, one.reference, there)

    try:
        names = [one.name for one in mine.laws]
        found = dict(zip(names, each(work, names, jobs, (mine, model)), strict=True))
        offsets = _offsets(mine, found, changes)
    except (ModelError, np.linalg.LinAlgError):  # an inertia that no body has, say
        return pool
    laws = tuple(_with(one, found[one.name], rows, offsets.get(one.name)) for one in pool.laws)
    return replace(pool, laws=laws)


def changed_model(pool: PooledFlights, changes: Mapping[str, Array]) -> Model:
    """The pool's model with these effects changed, within what they can be."""
    laws = {one.name: one for one in pool.laws}
    effects = {e.name: e for e in pool.model.effects}
    for name, theta in changes.items():
        one = laws[name]
        effects[name] = ModelEffect(find(name), one.reference + np.clip(theta, *one.range_of(one.bent)))
    return replace(pool.model, effects=tuple(effects[n] for n in sorted(effects)))


def _offsets(mine: PooledFlights, found: Mapping[str, Column], changes: Mapping[str, Array]) -> dict[str, Array]:
    """What each change adds (K, 6) besides its derivatives times its size, on top of the larger ones; all from what
    these effects are on healthy flights.
    """  # noqa: D205
    there = {n: np.zeros_like(theta) for n, theta in changes.items()}
    healthy = left_by(mine.data, changed_model(mine, there))

    def added(some: Mapping[str, Array]) -> Array:
        return healthy - left_by(mine.data, changed_model(mine, {**there, **some}))

    alone = {n: float(np.linalg.norm(added({n: theta}))) for n, theta in changes.items()}
    out: dict[str, Array] = {}
    larger: dict[str, Array] = {}
    before = np.zeros_like(mine.left)
    for name in sorted(changes, key=lambda n: -alone[n]):
        larger[name] = changes[name]
        after = added(larger)
        out[name] = after - before - found[name].jacobian @ changes[name]
        before = after
    return out


def _with(one: LinearisedEffect, new: Column, rows: Mask, offset: Array | None) -> LinearisedEffect:
    """The law with new derivatives on these rows; with an `offset` it is one that has changed by `new.theta`.

    What it is in all flights has the same derivatives there: lines from two points, one against the other, would be a
    lag.
    """
    line, bent, added = one.line.jacobian.copy(), one.bent.jacobian.copy(), one.bent.offset.copy()
    line[rows] = bent[rows] = new.jacobian
    added[rows] = new.offset if offset is None else offset
    straight = one.bent is one.line and not np.any(added)
    first = replace(one.line, jacobian=line)
    changed = first if straight else replace(one.bent, jacobian=bent, offset=added, theta=new.theta)
    return replace(one, line=first, bent=changed)
