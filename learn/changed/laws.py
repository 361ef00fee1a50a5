"""Effects as straight lines over several flights: what each adds where it is in all of them, or in some only.

    common    f(h + theta) - f(0)      the same in all flights: absolute, and no news
    change    f(h + d) - f(h)          on the rows of suspect flights only

h is what the effect is taken to be in the healthy flights: what the model has, zero where it lacks the effect, and of
lags, which are far from straight lines, what fits all flights.
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
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.plant.air import is_air
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model

ABSOLUTE = 0.3
"""Share of typical sizes up to which an effect that healthy flights do not show is taken to be in all flights."""


@dataclass(frozen=True)
class Law:
    """One effect over all flights. `reference` (P,) is what it is taken to be in healthy flights, `line` what it adds
    beyond that on all rows.
    """  # noqa: D205

    name: str
    reference: Array
    line: Column

    def change(self, rows: NDArray[np.bool_]) -> Column:
        """Its change on some `rows` (K,), with the prior of changes."""
        prior, line = change_prior(self.name), self.line
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
    data: Dataset, model: Model, names: Sequence[str], jobs: int = 1
) -> tuple[tuple[Law, ...], tuple[Untried, ...]]:
    """The laws of these effects, and those that no line could be had of."""
    alone = [n for n in names if not is_air(n) or any(find(e.name).aerodynamic for e in model.effects)]

    def attempt(name: str) -> Law | str:
        try:
            return law(data, model, name)
        except (ModelError, np.linalg.LinAlgError) as error:  # an inertia that no body has, say
            return str(error).removeprefix(f"effect {name}: ")

    found: list[Law] = []
    failed = [Untried(n, Lack.AIR) for n in names if n not in alone]
    for name, one in zip(alone, each(attempt, alone, jobs, (data, model)), strict=True):
        if isinstance(one, str):
            failed.append(Untried(name, Lack.FIT, one))
        elif np.any(one.line.jacobian):
            found.append(one)
    return tuple(found), tuple(failed)


def law(data: Dataset, model: Model, name: str) -> Law:
    """Of one effect, linearised at what it is in healthy flights, or at its typical size where that says nothing."""
    parameters = find(name).parameters(model.vehicle)
    own = {e.name: e.theta for e in model.effects}
    reference = own.get(name, np.zeros(len(parameters)))
    if any(p.start != 0.0 for p in parameters):
        reference = fit(data, model, (name,)).theta
    start = np.array([0.0 if r > 0.25 * p.scale or p.start == 0.0 else p.scale for r, p in zip(reference, parameters, strict=True)])
    line = linearised(data, model, name, reference, start)
    blind = ~np.any(line.jacobian, axis=(0, 1))
    if blind.any():  # the place of a mass shows once there is a mass
        start = np.array([p.scale if p.low >= 0.0 else 0.0 for p in parameters])
        line = linearised(data, model, name, reference, start)
    return Law(name, reference, line)


def again(data: Dataset, model: Model, one: Law, theta: Array) -> Law:
    """The same law, linearised where it has changed by `theta` (P,)."""
    return replace(one, line=linearised(data, model, one.name, one.reference, theta))


def linearised(data: Dataset, model: Model, name: str, reference: Array, theta: Array) -> Column:
    """What the effect adds beyond `reference` (P,), with derivatives at `reference` + `theta`."""
    problem = Problem(data, model, (name,))
    size, part = problem.size, slice(0, problem.size)

    def point(values: Array) -> Array:
        x = np.zeros(problem.low.size)
        x[part] = np.clip(values, problem.low[part], problem.high[part])
        return x

    there = problem.at(point(reference + theta))
    derivative = problem.jacobian(there)[:, :, part]
    offset = problem.at(point(reference)).residual - there.residual - derivative @ theta
    return Column(
        (name,),
        reference,
        theta,
        offset,
        derivative,
        problem.low[part] - reference,
        problem.high[part] - reference,
        problem.scale[:size].copy(),
        problem.sparse[part],
        find(name).accuracy,
    )
