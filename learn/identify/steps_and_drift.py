"""How one number goes over the flights: steady, in steps, or drifting.

Three descriptions of n values y_i, flight after flight, are weighed by the Bayesian information criterion

    n log(max(RSS, sum_i e_i^2) / n) + k log n,        k = 1 constant, 2 a line, 1 + 2 K for K steps

with e_i the standard error of each value by itself: no description is praised for going closer than that. Where the
steps are is found by dynamic programming over all segmentations (ruptures: Truong, Oudre and Vayatis, Signal
Processing 167, 2020). A step is believed where the means of the two segments beside it differ by more than the scatter
within all segments allows,

    t = (m_2 - m_1) / (s sqrt(1/n_1 + 1/n_2)),        s^2 = max(RSS / (n - K - 1), mean e_i^2),

on n - K - 1 degrees of freedom. Because its place was sought, p is multiplied by the number of places (Bonferroni), and
by the number of parameters that are looked at together; steps count below `COURSE.significant`. A slope likewise,
with n - 2 degrees of freedom. A segment has two flights at least: one flight by itself is an outlier, no step.

What neither steps nor drifts may come and go. Flights lie apart by the generalised test of Rosner (Technometrics 25,
1983) for up to (n - 1) / 2 outliers, which takes the farthest one away and tests it against the others, their standard
deviation at least the rms error, then the next; the last that is significant counts, and all before it. For few flights
its probability of a false alarm is up to twice its level, so half the level is taken. And flights differ where their
standard deviation is twice the rms error or more, and chance makes it so large below `COURSE.significant`, by
chi^2 = (n - 1) s^2 / mean e_i^2: in groups as large as each other none lies apart.
"""

from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
from scipy.special import chdtrc, stdtr, stdtrit

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.extras import needed_for
from wrenchgap.flight.flight import Array, Indices


@dataclass(frozen=True)
class CourseThresholds:
    """When a step or a drift over flights is believed."""

    fewest: int = 4
    """Flights below which nothing can be said about steps and drifts."""
    most: int = 500
    """Flights at most: the search takes the square of their number, 20 s for a parameter of so many."""
    significant: float = 0.01
    """Probability, corrected for all that was looked at, below which a step or a drift is believed."""
    differing: float = 2.0
    """Scatter over the error of a flight from which on flights differ: errors of short flights are known to a half."""


COURSE = CourseThresholds()


class Verdict(StrEnum):
    """What became of a parameter over the flights."""

    STEADY = "steady"
    STEPS = "steps"
    DRIFT = "drift"
    SCATTERED = "scattered"  # neither, but flights lie apart, or differ by more than their errors
    FEW = "few"  # flights: nothing can be said
    OPEN = "open"  # the flights do not show the parameter


@dataclass(frozen=True)
class Step:
    """A step from one flight to the next: `flight` is the index of the first after it; levels before and after.

    `low` and `high` are the 95 % interval of its `size`; `t` is against the scatter within the segments, `p` the
    probability of one as large anywhere without any, corrected for what was looked at.
    """

    flight: int
    before: float
    after: float
    low: float
    high: float
    t: float
    p: float

    @property
    def size(self) -> float:
        """By how much the level changed."""
        return self.after - self.before


@dataclass(frozen=True)
class Drift:
    """A straight line over the flights: change from one flight to the next with its 95 % interval, t and p."""

    slope: float
    low: float
    high: float
    t: float
    p: float


@dataclass(frozen=True)
class Course:
    """A number over n flights: `level` (n,) of the description that was chosen, `scatter` about it, one sigma.

    `drift` is there wherever a line through all flights is significant, also where steps describe them better. `apart`
    are the flights (indices) that lie outside the scatter of the others, of what neither steps nor drifts.
    """

    verdict: Verdict
    level: Array
    scatter: float
    steps: tuple[Step, ...] = ()
    drift: Drift | None = None
    apart: tuple[int, ...] = ()


def course(values: Array, errors: Array, looks: int = 1) -> Course:
    """What (n,) values with standard errors (n,) did over the flights; `looks` parameters are looked at together.

    Raises UsageError for more than `COURSE.most` flights.
    """
    count = len(values)
    if count > COURSE.most:
        raise UsageError(f"trend: got {count} flights, expected {COURSE.most} at most; give those of one season")
    constant = np.full(count, values.mean())
    if count < COURSE.fewest:
        return Course(Verdict.FEW, constant, float(values.std(ddof=1)) if count > 1 else float("nan"))
    own = float(np.sum(errors**2))

    def criterion(level: Array, parameters: int) -> float:
        left = max(float(np.sum((values - level) ** 2)), own, 1e-300)
        return float(count * np.log(left / count) + parameters * np.log(count))

    found = [(criterion(constant, 1), _without_order(values, errors, looks))]
    line = _line(values, errors, looks)
    if line is not None:
        found.append((criterion(line.level, 2), line))
    for level, steps in _segmentations(values, errors, looks):
        scatter, drift = _scatter(values, level, len(steps) + 1, 0.0), None if line is None else line.drift
        chosen = Course(Verdict.STEPS, level, scatter, steps, drift)
        found.append((criterion(level, 1 + 2 * len(steps)), chosen))
    return min(found, key=lambda one: one[0])[1]


def _without_order(values: Array, errors: Array, looks: int) -> Course:
    """Steady about the mean, or scattered: whatever the order of the flights is."""
    level, own, free = np.full(len(values), values.mean()), float(np.sqrt(np.mean(errors**2))), len(values) - 1
    scatter, apart = _scatter(values, level, 1, 0.0), _apart(values, own, 0.5 * COURSE.significant / looks)
    chance = looks * float(chdtrc(free, free * (scatter / max(own, 1e-300)) ** 2)) if own > 0.0 else 1.0
    differ = scatter >= COURSE.differing * own and chance < COURSE.significant
    return Course(Verdict.SCATTERED if apart or differ else Verdict.STEADY, level, scatter, apart=apart)


def _apart(values: Array, own: float, level: float) -> tuple[int, ...]:
    """Indices of the flights outside the scatter of the others, at least `own`, at a `level` of significance."""
    rest, removed, count = list(range(len(values))), [], 0
    for _ in range((len(values) - 1) // 2):
        x, n = values[rest], len(rest)
        away, spread = np.abs(x - x.mean()), max(float(x.std(ddof=1)), own)
        t = float(stdtrit(n - 2, 1.0 - level / (2 * n)))
        farthest = int(np.argmax(away))
        removed.append(rest.pop(farthest))
        if away[farthest] > spread * t * (n - 1) / np.sqrt((n - 2 + t**2) * n):
            count = len(removed)
    return tuple(sorted(removed[:count]))


def _scatter(values: Array, level: Array, levels: int, own: float) -> float:
    """Standard deviation about the level, at least what each value is uncertain by itself."""
    return float(np.sqrt(max(np.sum((values - level) ** 2) / max(len(values) - levels, 1), own**2)))


def _line(values: Array, errors: Array, looks: int) -> Course | None:
    """A drift, where it is significant."""
    count = len(values)
    centred = np.arange(count) - 0.5 * (count - 1)
    slope = float(centred @ values / (centred @ centred))
    level = values.mean() + slope * centred
    free = count - 2
    error = _scatter(values, level, 2, float(np.sqrt(np.mean(errors**2)))) / float(np.sqrt(centred @ centred))
    t, p, half = _test(slope, error, free, looks)
    if p >= COURSE.significant:
        return None
    drift = Drift(slope, slope - half, slope + half, t, p)
    return Course(Verdict.DRIFT, level, _scatter(values, level, 2, 0.0), drift=drift)


def _segmentations(
    values: Array, errors: Array, looks: int, shortest: int = 2, most: int = 8
) -> list[tuple[Array, tuple[Step, ...]]]:
    """The best segmentations with one step, two, ... of which every step is significant: levels (n,) and steps.

    A segment has the `shortest` number of flights at least; at `most` so many steps are looked for.
    """
    with needed_for("steps of a trend"):
        import ruptures

    count = len(values)
    places = count - 2 * shortest + 1
    size = max(float(np.std(values)), 1e-300)
    search = ruptures.Dynp(model="l2", min_size=shortest, jump=1).fit((values / size)[:, None])
    out = []
    for number in range(1, min(most, count // shortest - 1) + 1):
        ends = search.predict(n_bkps=number)
        parts = np.split(np.arange(count), ends[:-1])
        level = np.concatenate([np.full(len(part), values[part].mean()) for part in parts])
        scatter = _scatter(values, level, number + 1, float(np.sqrt(np.mean(errors**2))))
        steps = [
            _step(values, before, after, scatter, count - number - 1, looks * places)
            for before, after in pairwise(parts)
        ]
        if all(step.p < COURSE.significant for step in steps):
            out.append((level, tuple(steps)))
    return out


def _step(values: Array, first: Indices, second: Indices, scatter: float, free: int, looks: int) -> Step:
    """The step between two segments, given by the indices of their flights."""
    low, high = float(values[first].mean()), float(values[second].mean())
    error = scatter * float(np.sqrt(1.0 / len(first) + 1.0 / len(second)))
    t, p, half = _test(high - low, error, free, looks)
    return Step(int(second[0]), low, high, high - low - half, high - low + half, t, p)


def _test(size: float, error: float, free: int, looks: int, interval: float = 0.95) -> tuple[float, float, float]:
    """Student's t of a size, its two-sided probability for so many looks, half the width of its `interval`."""
    t = size / max(error, 1e-300)
    p = min(1.0, 2.0 * float(stdtr(free, -abs(t))) * looks)
    return t, p, float(stdtrit(free, 0.5 * (1.0 + interval))) * error
