"""Candidates as straight lines: what each adds to the prediction, linearised where it fits best alone.

At the sizes that occur, effects are nearly linear in their parameters and nearly add up, so that the prediction of a
set is the sum of its columns, and thousands of sets cost what one fit costs (`learn.posterior.scored_sets`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.flight import Array, Mask
from wrenchgap.flight.memory import let_go, on_disk
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.identify.fit import MANY, Fit
from wrenchgap.learn.identify.least_squares import Point, Problem
from wrenchgap.plant.effects import Parameter, family, find
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import Vehicle

LEAST_SIZE = 0.25
"""A fitted value, in typical sizes, below which an effect that starts away from zero is linearised at its typical
size: a derivative at no lag at all says nothing of lags."""


@dataclass(frozen=True)
class Column:
    """One candidate: `offset` (K, 6) + `jacobian` (K, 6, P) theta is what it adds to the prediction.

    `names` are the effect and those that come with it (air that moves, with a drag). Parameters count from `origin`
    (P,), the values that the model has, zero where it lacks the effect; `theta` (P,) is where it was linearised; `low`,
    `high`, `scale` and `sparse` (P,) are those of its parameters (`plant.effects.Parameter`); `accuracy` is the share
    to which the least known of its laws is; `price` are log odds against the candidate besides those of any effect, and
    `per_place` of its parameters belong to one place of a sparse effect.
    """

    names: tuple[str, ...]
    origin: Array
    theta: Array
    offset: Array
    jacobian: Array
    low: Array
    high: Array
    scale: Array
    sparse: Mask
    accuracy: float
    price: float = 0.0
    per_place: int = 1

    @classmethod
    def straight(cls, names: tuple[str, ...], jacobian: Array, scale: Array, far: float) -> Column:
        """What is exactly linear, of sizes `scale` (P,) and up to `far` times those, counted from zero."""
        zero, flat, most = np.zeros(len(scale)), np.zeros(len(scale), dtype=bool), far * scale
        return cls(names, zero, zero, np.zeros(jacobian.shape[:2]), jacobian, -most, most, scale, flat, 0.0)

    @property
    def key(self) -> str:
        """What the candidate is called in a set."""
        return " + ".join(self.names)

    def without_samples(self) -> Column:
        """The same without its samples: of `offset` the norms by axis (1, 6)."""
        norms = np.linalg.norm(self.offset, axis=0)[None]
        let_go(self.offset)
        return replace(self, offset=norms, jacobian=np.empty((0, *self.jacobian.shape[1:])))

    def spilled(self) -> Column:
        """The same in an array of its own, which waits on disk where there are `MANY` samples."""
        whole = on_disk(np.concatenate((self.jacobian, self.offset[:, :, None]), axis=2), MANY)
        return replace(self, offset=whole[:, :, -1], jacobian=whole[:, :, :-1])


def linearised(problem: Problem, origin: Array, before: Array, point: Point, derivative: Array | None = None) -> Column:
    """The column of a problem's effects, linearised at a point: `before` (K, 6) is left where their parameters are
    `origin` (P,); `derivative` (K, 6, P + ...) is the problem's there, where it is known.
    """  # noqa: D205
    part = slice(0, problem.size)
    derivative = (problem.jacobian(point) if derivative is None else derivative)[:, :, part]
    theta = point.x[part] - origin
    return Column(
        problem.names,
        origin,
        theta,
        before - point.residual - derivative @ theta,
        derivative,
        problem.low[part] - origin,
        problem.high[part] - origin,
        problem.scale[part],
        problem.sparse[part],
        max(find(n).accuracy for n in problem.names),
    )


def given_values(model: Model, names: Sequence[str]) -> Array:
    """Parameters (P,) of these effects as the model has them, zero where it lacks an effect."""
    return np.concatenate([model.theta(n) for n in names])


def by_effect(values: Array, names: Sequence[str], vehicle: Vehicle) -> dict[str, Array]:
    """Parameters of these effects, which stand one after the other, by name."""
    ends = np.cumsum([len(find(n).parameters(vehicle)) for n in names])
    return dict(zip(names, np.split(values, ends[:-1]), strict=True))


def next_to_nothing(column: Column, vehicle: Vehicle) -> Column:
    """The column to be linearised where there is none of it, or as little as a derivative says something of."""
    x = column.origin.copy()
    away_from_zero([p for n in column.names for p in find(n).parameters(vehicle)], x)
    return replace(column, theta=x - column.origin)


def away_from_zero(parameters: Sequence[Parameter], x: Array) -> list[int]:
    """Parameters of which a derivative at these values says nothing; they are moved to their typical sizes."""
    dull = [k for k, p in enumerate(parameters) if p.start != 0.0 and x[k] < LEAST_SIZE * p.scale]
    for k in dull:
        x[k] = min(parameters[k].scale, parameters[k].high)
    return dull


def column(data: Dataset, model: Model, left: Array, fitted: Fit, names: tuple[str, ...]) -> Column:
    """The column of `names` from their fit; `left` (K, 6) is what the model leaves without them."""
    problem = Problem(data, model, names)
    x = np.zeros(problem.low.size)
    x[: problem.size] = fitted.theta
    derivative = None if away_from_zero([p for _, p in problem.parameters], x) else fitted.jacobian
    return linearised(problem, given_values(model, names), left, problem.at(x), derivative)


def compatible(keys: tuple[str, ...], columns: dict[str, Column]) -> bool:
    """Whether these may stand in one set: one form of a family, and nothing beside an effect that it is a part of."""
    names = [n for key in keys for n in columns[key].names]
    shared = [family(n) for n in names]
    parts = {p for n in names for p in find(n).parts}
    return len(set(shared)) == len(shared) and not parts & set(names)


def compatible_with(key: str, others: tuple[str, ...], columns: dict[str, Column]) -> tuple[str, ...]:
    """Those of others that may stand in one set with a candidate."""
    return tuple(k for k in others if compatible((key, k), columns))


def confused(key: str, columns: dict[str, Column]) -> list[str]:
    """Candidates of one effect that is known to look like one of a candidate's, or they like it."""
    names = columns[key].names
    alike = {n for own in names for n in find(own).confused_with}
    single = [k for k, c in columns.items() if c.names == (k,) and k not in names]
    return [k for k in single if k in alike or not set(names).isdisjoint(find(k).confused_with)]


def complexity(names: tuple[str, ...]) -> int:
    """How many effects of one kind each these are: what stands for several together counts as those."""
    return sum(max(1, len(find(n).parts) - 1) for n in names)
