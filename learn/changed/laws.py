"""Effects as straight lines over several flights: what each adds where it is in all of them, or in some only.

    common    f(theta) - f(given)      the same in all flights: absolute, and no news
    change    f(h + d) - f(h)          on the rows of suspect flights only

h is what the effect is taken to be in the healthy flights: what the model has, zero where it lacks the effect, and of
lags, which are far from straight lines, what fits the healthy flights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.learn.changed.priors import change_prior
from wrenchgap.learn.data.applicable import Lack, Untried
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.identify.fit import fit
from wrenchgap.learn.identify.least_squares import Problem
from wrenchgap.learn.parallel import each
from wrenchgap.learn.posterior.columns import DULL, Column
from wrenchgap.plant.air import is_air
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model

ABSOLUTE = 0.3
"""Share of typical sizes up to which an effect that healthy flights do not show is taken to be in all flights."""


@dataclass(frozen=True)
class Law:
    """One effect over all flights.

    `line` is what it adds, on all rows, to the model as given, its parameters counted from those that the model has;
    `bent` what a change adds to it, counted from `reference` (P,), what it is in healthy flights. The two differ for
    lags, which are far from straight lines.
    """

    name: str
    reference: Array
    line: Column
    bent: Column

    def change(self, rows: NDArray[np.bool_]) -> Column:
        """Its change on some `rows` (K,), with the prior of changes."""
        prior, line = change_prior(self.name), self.bent
        size = prior.share * line.scale
        low, high = np.maximum(line.low, -prior.far * line.scale), np.minimum(line.high, prior.far * line.scale)
        return replace(
            line,
            offset=line.offset * rows[:, None],
            jacobian=line.jacobian * rows[:, None, None],
            low=low,
            high=np.zeros_like(high) if prior.loses else high,
            scale=size,
        )

    def rows(self, kept: NDArray[np.bool_]) -> Law:
        """The law on some of its rows (K,)."""
        line, bent = (replace(c, offset=c.offset[kept], jacobian=c.jacobian[kept]) for c in (self.line, self.bent))
        return replace(self, line=line, bent=bent)

    @property
    def common(self) -> Column:
        """What is in all flights alike: nothing that this comparison is about."""
        line = self.line
        jacobian, scale = line.jacobian, ABSOLUTE * line.scale
        if np.abs(line.offset).max() > 1e-3 * max(float(np.abs(jacobian * line.scale).max()), 1e-30):
            jacobian = np.concatenate((jacobian, line.offset[:, :, None]), axis=2)
            scale = np.append(scale, 1.0)
        return replace(line, jacobian=jacobian, scale=scale, low=-1e3 * scale, high=1e3 * scale)


def laws(
    data: Dataset, model: Model, names: Sequence[str], healthy: Dataset, jobs: int = 1
) -> tuple[tuple[Law, ...], tuple[Untried, ...]]:
    """The laws of these effects over all flights, `healthy` being those of them that are; those that have no line."""
    alone = [n for n in names if not is_air(n) or any(find(e.name).aerodynamic for e in model.effects)]

    def attempt(name: str) -> Law | str:
        try:
            return law(data, model, name, healthy)
        except (ModelError, np.linalg.LinAlgError) as error:  # an inertia that no body has, say
            return str(error).removeprefix(f"effect {name}: ")

    found: list[Law] = []
    failed = [Untried(n, Lack.AIR) for n in names if n not in alone]
    for name, one in zip(alone, each(attempt, alone, jobs, (data, model, healthy)), strict=True):
        if isinstance(one, str):
            failed.append(Untried(name, Lack.FIT, one))
        elif np.any(one.line.jacobian):
            found.append(one)
    return tuple(found), tuple(failed)


def law(data: Dataset, model: Model, name: str, healthy: Dataset) -> Law:
    """Of one effect, linearised at what it is in healthy flights, or at its typical size where that says nothing."""
    parameters = find(name).parameters(model.vehicle)
    origin = {e.name: e.theta for e in model.effects}.get(name, np.zeros(len(parameters)))
    if not any(p.start != 0.0 for p in parameters):
        line = linearised(data, model, name, origin, origin)
        blind = ~np.any(line.jacobian, axis=(0, 1))
        if blind.any():  # the place of a mass shows once there is a mass
            there = np.array([p.scale if p.low >= 0.0 else 0.0 for p in parameters])
            line = linearised(data, model, name, origin, np.maximum(origin, there))
        return Law(name, origin, line, line)
    reference = fit(healthy, model, (name,)).theta
    dull = [r < DULL * p.scale for r, p in zip(reference, parameters, strict=True)]
    there = np.where(dull, [p.scale for p in parameters], reference)
    return Law(
        name,
        reference,
        linearised(data, model, name, origin, there),
        linearised(data, model, name, reference, there),
    )


def again(data: Dataset, model: Model, one: Law, theta: Array) -> Law:
    """The same law, linearised where it has changed by `theta` (P,)."""
    return replace(one, bent=linearised(data, model, one.name, one.reference, one.reference + theta))


def linearised(data: Dataset, model: Model, name: str, origin: Array, there: Array) -> Column:
    """What the effect adds to what it does at `origin` (P,), with the derivatives that it has at `there` (P,)."""
    problem = Problem(data, model, (name,))
    size, part = problem.size, slice(0, problem.size)
    there = np.clip(there, problem.low[part], problem.high[part])

    def point(values: Array) -> Array:
        x = np.zeros(problem.low.size)
        x[part] = values
        return x

    at = problem.at(point(there))
    derivative = problem.jacobian(at)[:, :, part]
    straight = np.array_equal(origin, there)
    before = at.residual if straight else problem.at(point(origin)).residual
    return Column(
        (name,),
        origin,
        there - origin,
        before - at.residual - derivative @ (there - origin),
        derivative,
        problem.low[part] - origin,
        problem.high[part] - origin,
        problem.scale[:size].copy(),
        problem.sparse[part],
        find(name).accuracy,
    )
