"""A set of effects linearised where it fits best together.

Columns are linearised each by itself; a lag beside another lag, a centre of mass beside a weak rotor, are not quite
what they are alone. Contenders get one or two Gauss-Newton steps with derivatives of the whole set.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.learn.identify.bias_and_trim import trim_of
from wrenchgap.learn.identify.least_squares import Problem
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.score import Keys, Scorer
from wrenchgap.learn.posterior.sets import Contender, contender
from wrenchgap.learn.posterior.spectrum import Spectrum
from wrenchgap.learn.posterior.table import Ground

STEPS = 5
MOVED = 0.1
"""Change of a parameter in one step, in typical sizes, that calls for another."""
CHORD = 0.5
"""Change up to which the next step keeps the derivatives of the last."""


@dataclass(frozen=True)
class Noise:
    """What sets are scored against: the `reference` of `learn.posterior.score.Scorer`, the `factors` of blocks."""

    reference: Array
    factors: Array


def spectrum_of(ground: Ground, columns: Sequence[Column]) -> Spectrum:
    """Of these columns."""
    return Spectrum(ground.data, ground.left, columns, trim_of(ground.model), ground.known)


def linearised_together(
    ground: Ground,
    columns: Sequence[Column],
    theta: Sequence[Array],
    noise: Noise,
    rests: Mapping[Keys, Array] | None = None,
    bends: Mapping[str, Array] | None = None,
) -> Contender | None:
    """The set of these columns, scored with derivatives where it fits best, beginning at `theta`. None where the
    model refuses it there. `rests` and `bends` as in `learn.posterior.sets.contender`.
    """  # noqa: D205
    with threadpool_limits(1, user_api="blas"):
        try:
            scorer, keys = _improved(ground, columns, theta, noise)
            return contender(scorer, keys, rests, bends)
        except (ModelError, np.linalg.LinAlgError):  # an inertia that no body has, say
            return None


def _improved(ground: Ground, columns: Sequence[Column], theta: Sequence[Array], noise: Noise) -> tuple[Scorer, Keys]:
    keys: Keys = tuple(c.key for c in columns)
    largest = np.inf
    for _ in range(STEPS):
        columns = together(ground, columns, theta, anew=largest > CHORD)
        spectrum = spectrum_of(ground, columns)
        spectrum.calm(noise.factors)
        scorer = Scorer(spectrum, noise.reference)
        found = [scorer(keys).theta[k] for k in keys]
        largest = max(np.max(np.abs(a - b) / c.scale) for a, b, c in zip(found, theta, columns, strict=True))
        theta = found
        if largest < MOVED:
            break
    return scorer, keys


def together(ground: Ground, columns: Sequence[Column], theta: Sequence[Array], *, anew: bool = True) -> list[Column]:
    """Columns of the members at their values in the set. Every member has the offset that makes it what it would be
    alone; what their sum is off by goes to the most curved of them. Not `anew`, they keep their derivatives.
    """  # noqa: D205
    problem = Problem(ground.data, ground.model, tuple(n for c in columns for n in c.names))
    values = np.concatenate(theta)
    origin = np.concatenate([c.origin for c in columns])
    ends = np.cumsum([0, *(len(c.theta) for c in columns)])
    parts = [slice(first, last) for first, last in itertools.pairwise(ends)]

    def added(members: slice) -> Array:
        """What these members alone take off (K, 6)."""
        x = np.zeros(problem.low.size)
        x[: len(values)] = origin
        x[members] += values[members]
        return ground.left - problem.at(np.clip(x, problem.low, problem.high)).residual

    x = np.zeros(problem.low.size)
    x[: len(values)] = values + origin
    point = problem.at(np.clip(x, problem.low, problem.high))
    if anew:
        derivative = problem.jacobian(point)[:, :, : len(values)]
    else:
        derivative = np.concatenate([c.jacobian for c in columns], axis=2)
    bends = [bool(np.any(c.offset)) for c in columns]
    own = [
        added(part) - derivative[:, :, part] @ values[part] if bent else np.zeros_like(point.residual)
        for part, bent in zip(parts, bends, strict=True)
    ]
    rest = ground.left - point.residual - derivative @ values - sum(own)
    curved = int(np.argmax([np.linalg.norm(c.offset) for c in columns]))
    own[curved] = own[curved] + rest
    return [
        replace(c, theta=values[part], jacobian=derivative[:, :, part], offset=offset)
        for c, part, offset in zip(columns, parts, own, strict=True)
    ]


def alongside(ground: Ground, columns: Sequence[Column], theta: Sequence[Array], other: Column) -> Column:
    """Another candidate, linearised where it was, but beside these members at their values: a thrust curve beside
    motors that lag changes what comes late.
    """  # noqa: D205
    problem = Problem(ground.data, ground.model, tuple(n for c in (*columns, other) for n in c.names))
    members = sum(len(c.theta) for c in columns)
    own = slice(members, members + len(other.theta))
    x = np.zeros(problem.low.size)
    x[:members] = np.concatenate([c.origin + values for c, values in zip(columns, theta, strict=True)])
    x[own] = other.origin
    x = np.clip(x, problem.low, problem.high)
    without = problem.at(x)
    x[own] = np.clip(other.origin + other.theta, problem.low[own], problem.high[own])
    point = problem.at(x)
    derivative = problem.jacobian(point, first=members)[:, :, own]
    return replace(other, jacobian=derivative, offset=without.residual - point.residual - derivative @ other.theta)
