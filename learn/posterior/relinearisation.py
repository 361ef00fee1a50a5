"""Sets linearised anew where they fit best together, and everything else beside them.

Columns are linearised each by itself. A lag beside another lag, a centre of mass beside a weak rotor, are not quite
what they are alone: sets that come close get a few Gauss-Newton steps with derivatives of the whole set. What is not
in a set and is no straight line is linearised beside the set from next to nothing, and the search goes on from there.
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.identify.bias_and_trim import trim_of
from wrenchgap.learn.identify.least_squares import Problem
from wrenchgap.learn.parallel import each
from wrenchgap.learn.posterior.columns import Column, next_to_nothing
from wrenchgap.learn.posterior.score import Keys, Scorer
from wrenchgap.learn.posterior.scored_sets import ScoredSet, scored_set
from wrenchgap.learn.posterior.single_effects import ModelResidual
from wrenchgap.learn.posterior.spectrum import Spectrum
from wrenchgap.plant.effects import find


def spectrum_of(ground: ModelResidual, columns: Sequence[Column], factors: Array | None = None) -> Spectrum:
    """Of these columns; blocks of time weighed by `factors` (blocks,)."""
    spectrum = Spectrum(ground.data, ground.left, columns, trim_of(ground.model), ground.known, ground.settings)
    if factors is not None:
        spectrum.down_weight(factors)
    return spectrum


def relinearised_set(
    ground: ModelResidual,
    columns: Sequence[Column],
    theta: Sequence[Array],
    reference: Array,
    factors: Array,
) -> ScoredSet | None:
    """The set of these columns, scored with derivatives where it fits best, beginning at `theta`; None where the model
    refuses it there. Against the noise's `reference`, blocks weighed by `factors`.
    """  # noqa: D205
    keys: Keys = tuple(c.key for c in columns)
    with threadpool_limits(1, user_api="blas"):
        try:
            begin = dict(zip(keys, theta, strict=True))
            scorer = joint_optimum(ground, columns, begin, reference, factors)
            return scored_set(scorer, keys)
        except (ModelError, np.linalg.LinAlgError):  # an inertia that no body has, say
            return None


def joint_optimum(
    ground: ModelResidual,
    columns: Sequence[Column],
    theta: Mapping[str, Array],
    reference: Array,
    factors: Array,
    least: float = 0.2,
    steps: int = 8,
) -> Scorer:
    """The scorer of a set linearised where the set is likeliest, beginning at `theta` by column; against the noise's
    `reference`, blocks weighed by `factors`.

    Gauss-Newton steps, each halved until the set is likelier there: far from where lags were linearised, whole steps go
    from one bad place to the next. The search ends where straight lines promise less than `least` [log odds], a tenth
    of what tells two sets apart. A step that brings what was promised keeps its derivatives. Where no step is likelier,
    or there were so many `steps`, the set is scored where it is, and not where straight lines would have it.
    """  # noqa: D205
    keys = tuple(theta)

    def around(lines: Sequence[Column], at: Mapping[str, Array], *, anew: bool) -> tuple[Sequence[Column], Scorer]:
        derived = [replace(c, jacobian=line.jacobian) for c, line in zip(columns, lines, strict=True)]
        moved = joint_columns(ground, derived, [at[k] for k in keys], anew=anew)
        return moved, Scorer(spectrum_of(ground, moved, factors), reference)

    lines, scorer = around(columns, theta, anew=True)
    here = scorer.held(keys, theta)
    for _ in range(steps):
        best = scorer(keys)
        promised = best.log_probability - here.log_probability
        if promised < least:
            return scorer
        for share in 0.5 ** np.arange(5):
            trial = {k: theta[k] + share * (best.theta[k] - theta[k]) for k in keys}
            try:
                moved, other = around(lines, trial, anew=False)
            except (ModelError, np.linalg.LinAlgError):
                continue
            there = other.held(keys, trial)
            gain = there.log_probability - here.log_probability
            if gain > 0.0:
                break
        else:
            break
        theta = trial
        if abs(gain - promised) > 0.1 * promised:
            moved, other = around(moved, theta, anew=True)
            there = other.held(keys, theta)
        lines, scorer, here = moved, other, there
    scorer.known[here.keys] = here
    return scorer


def joint_columns(
    ground: ModelResidual, columns: Sequence[Column], theta: Sequence[Array], *, anew: bool = True
) -> list[Column]:
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
    curved = int(np.argmax([np.linalg.norm(o) for o in own]))
    own[curved] = own[curved] + rest
    return [
        replace(c, theta=values[part], jacobian=derivative[:, :, part], offset=offset)
        for c, part, offset in zip(columns, parts, own, strict=True)
    ]


def column_beside(ground: ModelResidual, columns: Sequence[Column], theta: Sequence[Array], other: Column) -> Column:
    """Another candidate, linearised where it was, but beside these members at their values: a thrust curve beside
    motors that lag changes what comes late.
    """  # noqa: D205
    problem = Problem(ground.data, ground.model, tuple(n for c in (*columns, other) for n in c.names))
    members = sum(len(c.theta) for c in columns)
    own = slice(members, members + len(other.theta))
    x = np.zeros(problem.low.size)
    x[:members] = np.concatenate([np.zeros(0), *(c.origin + v for c, v in zip(columns, theta, strict=True))])
    x[own] = other.origin
    x = np.clip(x, problem.low, problem.high)
    without = problem.at(x)
    x[own] = np.clip(other.origin + other.theta, problem.low[own], problem.high[own])
    point = problem.at(x)
    derivative = problem.jacobian(point, first=members)[:, :, own]
    return replace(other, jacobian=derivative, offset=without.residual - point.residual - derivative @ other.theta)


def relinearised_sets(
    on: ModelResidual,
    linear: Scorer,
    sets: Sequence[tuple[Keys, Sequence[Array]]],
    jobs: int,
) -> dict[Keys, ScoredSet | None]:
    """`relinearised_set` of these sets with the values at which they begin, by `jobs` processes."""
    bare = {c: linear.spectrum.columns[c].without_samples() for c in dict.fromkeys(c for k, _ in sets for c in k)}
    by_name = {" | ".join(keys): ([bare[c] for c in keys], theta) for keys, theta in sets}
    reference, factors = linear.reference, linear.spectrum.factors

    def work(name: str) -> ScoredSet | None:
        return relinearised_set(on, *by_name[name], reference, factors)

    return dict(zip([k for k, _ in sets], each(work, list(by_name), jobs, (on.data.root, on.model)), strict=True))


def lines_beside(on: ModelResidual, linear: Scorer, centre: ScoredSet, jobs: int) -> Scorer:
    """Straight lines beside a set, at the same noise: its members where they fit best together, everything else that is
    no straight line from next to nothing. Where it was fitted alone it fitted what the set is: of an inertia beside a
    centre of mass, or of a lag, the line that was taken there says nothing of a little of it.
    """  # noqa: D205
    on.data.forget()
    columns, vehicle = linear.spectrum.columns, on.model.vehicle
    bare = {k: c.without_samples() for k, c in columns.items()}
    members = [bare[k] for k in centre.keys]
    theta = [centre.scored.theta[k] for k in centre.keys]
    moved = {c.key: c.spilled() for c in joint_columns(on, members, theta)} if members else {}
    late = bool(lags_and_delays(centre.keys))  # behind which everything is another line

    def work(key: str) -> Column | None:
        try:
            return column_beside(on, members, theta, next_to_nothing(bare[key], vehicle))
        except (ModelError, np.linalg.LinAlgError):  # an inertia that no body has, say
            return None

    others = [k for k, c in bare.items() if k not in centre.keys and (late or np.any(c.offset))]
    moved |= {c.key: c.spilled() for c in each(work, others, jobs, (on.data.root, on.model)) if c is not None}
    on.data.forget()
    lines = [moved.get(k, c) for k, c in columns.items()]
    return Scorer(spectrum_of(on, lines, linear.spectrum.factors), linear.reference)


def without_doubtful(heavy: ScoredSet, share: float = 0.25) -> list[Keys]:
    """A set without each of the members that it hardly needs, as far as straight lines can tell: their evidence is less
    than the least for a name, and more than this share of it; of several lags and delays, without each.
    """  # noqa: D205
    columns = {" + ".join(p.names): p for p in heavy.parts}
    least, late = SIGNIFICANCE.least_evidence, lags_and_delays(heavy.keys)
    several = late if len(late) > 1 else []
    doubted = [k for k in heavy.keys if share * least < columns[k].evidence <= least or k in several]
    return [rest for gone in doubted if (rest := tuple(k for k in heavy.keys if k != gone))]


def lags_and_delays(columns: Iterable[str]) -> list[str]:
    """Lags and delays: far from straight lines, so that they are tried in each other's place."""
    return [k for k in columns if all(find(n).place == "commands" for n in k.split(" + "))]
