"""Everything linearised anew on the suspect flights, beside changes that are large.

Where drag has grown five times, the wind of the day pushes five times as much, and a rotor that is lost turns the
vehicle about a centre of mass that lies elsewhere: what else there may be is multiplied by what has changed.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.learn.changed.linearised_effects import LinearisedEffect, beyond, linearised
from wrenchgap.learn.changed.pooled_flights import PooledFlights
from wrenchgap.learn.identify.least_squares import left_by
from wrenchgap.learn.parallel import each
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model
from wrenchgap.plant.wrench_model import ModelEffect


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
        effects[name] = ModelEffect(find(name), one.reference + np.clip(theta, *beyond(one.bent)))
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


def _with(one: LinearisedEffect, new: Column, rows: NDArray[np.bool_], offset: Array | None) -> LinearisedEffect:
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
