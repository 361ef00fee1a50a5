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

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array, Mask
from wrenchgap.learn.changed.priors import ROTOR_THRUST, change_prior, damaged, without_drag_torque
from wrenchgap.learn.data.candidates import Lack, Untried
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.identify.fit import fit
from wrenchgap.learn.identify.least_squares import Point, Problem
from wrenchgap.learn.parallel import each
from wrenchgap.learn.posterior.columns import LEAST_SIZE, Column
from wrenchgap.learn.posterior.columns import linearised as column_at
from wrenchgap.plant.effects import find, is_air
from wrenchgap.plant.model import Model

ABSOLUTE = 0.3
"""Share of typical sizes up to which an effect that healthy flights do not show is taken to be in all flights."""

BEYOND = 2.0
"""Range of changes over that of a model's parameters: a battery that slid out of its place by a sixth of the arm."""


@dataclass(frozen=True)
class LinearisedEffect:
    """One effect over all flights.

    `line` is what it adds, on all rows, to the model as given, its parameters counted from those that the model has;
    `bent` what a change adds to it, counted from `reference` (P,), what it is in healthy flights. The two differ for
    lags, which are far from straight lines. `torque` (K, 6, R) is what the drag torque of each rotor adds, where a
    change of the effect takes that too (`learn.changed.priors.damaged`). With `regained` a change that can only lose
    is a gain: the healthy flights are the ones that lack something.
    """

    name: str
    reference: Array
    line: Column
    bent: Column
    torque: Array | None = None
    regained: bool = False

    def change(self, rows: Mask) -> Column:
        """Its change on some `rows` (K,), with the prior of changes."""
        prior = change_prior(self.name)
        line = self.bent if self.torque is None else damaged(self.bent, self.torque)
        size = prior.share * line.scale
        low, high = self.range_of(line)
        low, high = np.maximum(low, -prior.far * line.scale), np.minimum(high, prior.far * line.scale)
        return replace(
            line,
            offset=line.offset * rows[:, None],
            jacobian=line.jacobian * rows[:, None, None],
            low=low,
            high=high,
            scale=size,
            price=prior.price,
        )

    def range_of(self, line: Column) -> tuple[Array, Array]:
        """How far its parameters can change (P,), down and up, on this one of its lines."""
        low, high = beyond(line)
        none = np.zeros_like(low)
        if self.regained:
            return none, -low
        return low, none if change_prior(self.name).loses else high

    def rows(self, kept: Mask) -> LinearisedEffect:
        """The law on some of its rows (K,)."""
        line, bent = (replace(c, offset=c.offset[kept], jacobian=c.jacobian[kept]) for c in (self.line, self.bent))
        return replace(self, line=line, bent=bent, torque=None if self.torque is None else self.torque[kept])

    @property
    def common(self) -> Column:
        """What is in all flights alike: nothing that this comparison is about."""
        line = self.line
        jacobian, scale = line.jacobian, ABSOLUTE * line.scale
        if np.abs(line.offset).max() > 1e-3 * max(float(np.abs(jacobian * line.scale).max()), 1e-30):
            jacobian = np.concatenate((jacobian, line.offset[:, :, None]), axis=2)
            scale = np.append(scale, 1.0)
        return replace(line, jacobian=jacobian, scale=scale, low=-1e3 * scale, high=1e3 * scale)


def beyond(line: Column) -> tuple[Array, Array]:
    """How far parameters can change (P,), down and up: `BEYOND` times as far as a model file may be wrong, to sides on
    which it is a size that stops them and no sign.
    """  # noqa: D205
    low, high = line.origin + line.low, line.origin + line.high
    either = (low < 0.0) & (high > 0.0)
    low, high = (np.where(either, BEYOND * x, x) for x in (low, high))
    return low - line.origin, high - line.origin


def linearised_effects(
    healthy: Dataset, model: Model, names: Sequence[str], jobs: int = 1
) -> tuple[dict[str, LinearisedEffect], tuple[Untried, ...]]:
    """The laws of these effects over healthy flights; those that have no line."""
    alone = [n for n in names if not is_air(n) or any(find(e.name).aerodynamic for e in model.effects)]

    def attempt(name: str) -> LinearisedEffect | str:
        try:
            return linearised_effect(healthy, model, name)
        except (ModelError, np.linalg.LinAlgError) as error:  # an inertia that no body has, say
            return str(error).removeprefix(f"effect {name}: ")

    found: dict[str, LinearisedEffect] = {}
    failed = [Untried(n, Lack.AIR) for n in names if n not in alone]
    for name, one in zip(alone, each(attempt, alone, jobs, (healthy, model)), strict=True):
        if isinstance(one, str):
            failed.append(Untried(name, Lack.FIT, one))
        else:
            found[name] = one
    return found, tuple(failed)


def over_both_sides(
    healthy: dict[str, LinearisedEffect],
    names: Sequence[str],
    suspect: Dataset,
    model: Model,
    axes: Mask,
    jobs: int = 1,
) -> tuple[LinearisedEffect, ...]:
    """Those of the `healthy` laws that are among `names`, over healthy flights and then the suspect ones, linearised
    where they are for the healthy ones, on the `axes` (6,) that all flights measured; without what adds nothing.
    """  # noqa: D205
    points = {
        n: (one.line.origin, one.line.theta, None if one.bent is one.line else (one.reference, one.bent.theta))
        for n, one in healthy.items()
        if n in names
    }

    def more(name: str) -> tuple[Column, Column, Array | None]:
        origin, theta, bent = points[name]
        line = linearised(suspect, model, name, origin, origin + theta)
        other = line if bent is None else linearised(suspect, model, name, bent[0], bent[0] + bent[1])
        return line, other, torque_of(suspect, model, name, line)

    found = []
    for name, parts in zip(points, each(more, list(points), jobs, (suspect, model)), strict=True):
        one = _stacked(healthy[name], *parts, axes)
        if np.any(one.line.jacobian):
            found.append(one)
    return tuple(found)


def _stacked(one: LinearisedEffect, line: Column, bent: Column, torque: Array | None, axes: Mask) -> LinearisedEffect:
    """A law with more rows at its end, and nothing on axes that one side did not measure."""

    def both(first: Array, second: Array) -> Array:
        out = np.concatenate((first, second))
        out[:, ~axes] = 0.0
        return out

    def longer(first: Column, second: Column) -> Column:
        return replace(first, offset=both(first.offset, second.offset), jacobian=both(first.jacobian, second.jacobian))

    whole = longer(one.line, line)
    turned = None if one.torque is None or torque is None else both(one.torque, torque)
    return replace(one, line=whole, bent=whole if one.bent is one.line else longer(one.bent, bent), torque=turned)


def torque_of(data: Dataset, model: Model, name: str, line: Column) -> Array | None:
    """What the drag torque of each rotor adds (K, 6, R), where a change of the effect, a `line`, takes that too."""
    if name != ROTOR_THRUST:
        return None
    lifting = linearised(replace(data), without_drag_torque(model), name, line.origin, line.origin + line.theta)
    return np.asarray(line.jacobian - lifting.jacobian)


def linearised_effect(data: Dataset, model: Model, name: str) -> LinearisedEffect:
    """Of one effect over healthy flights, linearised at what it is in them, or at its typical size where they say
    nothing.
    """  # noqa: D205
    parameters = find(name).parameters(model.vehicle)
    origin = model.theta(name)
    if not any(p.start != 0.0 for p in parameters):
        line = linearised(data, model, name, origin, origin)
        blind = ~np.any(line.jacobian, axis=(0, 1))
        if blind.any():  # the place of a mass shows once there is a mass
            there = np.array([p.scale if p.low >= 0.0 else 0.0 for p in parameters])
            line = linearised(data, model, name, origin, np.maximum(origin, there))
        return LinearisedEffect(name, origin, line, line, torque_of(data, model, name, line))
    reference = fit(data, model, (name,)).theta
    dull = [r < LEAST_SIZE * p.scale for r, p in zip(reference, parameters, strict=True)]
    there = np.where(dull, [p.scale for p in parameters], reference)
    line, bent = (linearised(data, model, name, zero, there) for zero in (origin, reference))
    return LinearisedEffect(name, reference, line, bent)


def relinearised_at(data: Dataset, model: Model, one: LinearisedEffect, theta: Array) -> LinearisedEffect:
    """The same law, linearised where it has changed by `theta` (P,)."""
    return replace(one, bent=linearised(data, model, one.name, one.reference, one.reference + theta))


def linearised(data: Dataset, model: Model, name: str, origin: Array, there: Array) -> Column:
    """What the effect adds to what it does at `origin` (P,), with the derivatives that it has at `there` (P,)."""
    problem = Problem(data, model, (name,))
    part = slice(0, problem.size)
    there = np.clip(there, problem.low[part], problem.high[part])

    def at(values: Array) -> Point:
        x = np.zeros(problem.low.size)
        x[part] = values
        return problem.at(x)

    point = at(there)
    before = point.residual if np.array_equal(origin, there) else at(origin).residual
    return column_at(problem, origin, before, point)
