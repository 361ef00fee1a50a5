"""What healthy flights show of all effects at once, as a model: where changes are linearised.

What changes is multiplied by what is always there: a mass that was added, by the thrust that is lost in all flights; a
centre of mass, by motors that follow late. Straight lines taken about the model as given lack these products, which
stand above the sensors' noise where either is large, and other effects make up for them. So what is common to the
healthy flights is put into the model, and everything is linearised anew about that, `ROUNDS` times.

Healthy flights that are not: each is judged against the others, as if it were the suspect one (`outlier_flights`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.learn.changed.linearised_effects import LinearisedEffect, linearised_effects
from wrenchgap.learn.changed.pooled_flights import PooledFlights, calibrated, within_bounds
from wrenchgap.learn.changed.search import worth_a_name
from wrenchgap.learn.changed.spectrum import answered
from wrenchgap.learn.data.candidates import Untried
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import means_by
from wrenchgap.learn.identify.bias_and_trim import typical_trim
from wrenchgap.learn.identify.least_squares import left_by
from wrenchgap.learn.posterior.score import Scored, Scorer
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model
from wrenchgap.plant.wrench_model import ModelEffect

ROUNDS = 2
"""Of new derivatives about what healthy flights show."""
SHOWS = 0.1
"""Share of what is left on an axis (rms) from which on what an effect adds there is put into the model."""
GAIN = 3.0
"""Log likelihood that a model gains over the one before if another round is worth it, everything common and by flight
being free in both; one that loses as much is not taken. Straight lines about a lag that all flights have are no better
for healthy flights than its own line is, and for suspect flights, where it may have changed, they are.
"""
FEWEST = 3
"""Healthy flights below which none can be said to be odd: of two that differ, either may be."""
OUTLIER_ODDS = 4.0
"""Log odds that something changed, the likeliest change by itself against none, from which on a flight is odd."""


@dataclass(frozen=True)
class HealthyModel:
    """What healthy flights show in common, as a `model`; the `laws` of effects about it; those that have none."""

    model: Model
    laws: dict[str, LinearisedEffect]
    failed: tuple[Untried, ...]


def healthy_model(healthy: Dataset, given: Model, names: Sequence[str], jobs: int = 1) -> HealthyModel:
    """What healthy flights show of the effects `names`; where only means are compared, the model as given."""
    here = HealthyModel(given, *linearised_effects(healthy, given, names, jobs))
    if answered(healthy):
        return here
    pool, theta, worth = _solved(healthy, here)
    for _ in range(ROUNDS):
        try:
            model = replace(here.model, effects=_effects(pool, theta))
            better = HealthyModel(model, *linearised_effects(healthy, model, names, jobs))
            pool, theta, now = _solved(healthy, better)
        except (ModelError, np.linalg.LinAlgError):  # an inertia that no body has, say
            break
        if len(better.laws) < len(here.laws) or now < worth - GAIN:
            break
        gained, here, worth = now - worth, better, now
        if gained < GAIN:
            break
    return here


def _solved(healthy: Dataset, about: HealthyModel) -> tuple[PooledFlights, Array, float]:
    """The healthy flights by themselves about a model: all that is common and by flight, within the bounds of physics;
    the log likelihood.
    """  # noqa: D205
    left = left_by(healthy, about.model)
    pool = PooledFlights(
        healthy, about.model, left, tuple(about.laws.values()), typical_trim(about.model), {}, {}, left
    )
    pool = calibrated(pool, range(len(pool.names)))
    spectrum = pool.spectrum()
    low, high = spectrum.low[spectrum.always].copy(), spectrum.high[spectrum.always].copy()
    for one, *own in zip(pool.shared_laws, pool.common_values(low), pool.common_values(high), strict=True):
        own[0][: len(one.reference)], own[1][: len(one.reference)] = one.line.low, one.line.high  # views
    theta, _, remains = within_bounds(spectrum, low, high)
    variance = np.maximum(remains, spectrum.sensor)
    likelihood = -0.5 * float(np.sum(spectrum.count * (np.log(variance) + remains / variance)))
    return pool, theta, likelihood


def _effects(pool: PooledFlights, theta: Array) -> tuple[ModelEffect, ...]:
    """Those of the model, at their new values, and those that show on some axis beside what is left of all."""
    found = {e.name: e for e in pool.model.effects}
    left = pool.unexplained(theta)
    least = SHOWS * np.sqrt(np.mean((left - means_by(pool.data.flight, left)[pool.data.flight]) ** 2, axis=0))
    for one in pool.shared_laws:
        values = pool.shared_values(theta, one.name)
        adds = np.sqrt(np.mean((one.line.jacobian @ values) ** 2, axis=0))
        if one.name in found or np.any(adds > np.maximum(least, 1e-12)):
            inside = np.clip(values, one.line.low, one.line.high)
            found[one.name] = ModelEffect(find(one.name), one.line.origin + inside)
    return tuple(found[n] for n in sorted(found))


@dataclass(frozen=True)
class OutlierFlight:
    """A flight that was given as healthy and differs from the others: the change that says most of it, its log odds."""

    flight: str
    effect: str
    odds: float


def outlier_flights(pool: PooledFlights, healthy: Sequence[int]) -> tuple[tuple[int, OutlierFlight], ...]:
    """The oddest of the healthy flights, and of what remains the oddest again, as long as there is one."""
    left = list(healthy)
    found: list[tuple[int, OutlierFlight]] = []
    while len(left) >= FEWEST:
        judged = [(f, _against(pool, f, [g for g in left if g != f])) for f in left]
        flight, odd = max(judged, key=lambda pair: pair[1].odds)
        if odd.odds < OUTLIER_ODDS:
            break
        found.append((flight, odd))
        left.remove(flight)
    return tuple(found)


def _against(pool: PooledFlights, flight: int, others: Sequence[int]) -> OutlierFlight:
    """One flight as the suspect of some others; changes one by one, those that are large enough for a name."""
    both = sorted((flight, *others))
    alone = calibrated(pool.only(both), [both.index(f) for f in others])
    mine = both.index(flight)
    rows = alone.rows([mine])
    spectrum = alone.spectrum(tuple(one.change(rows) for one in alone.laws), [mine])
    scorer = Scorer(spectrum, spectrum.saturated()[0])
    nothing = scorer(()).log_probability
    singles: list[Scored] = [scorer((key,)) for key in spectrum.columns]
    singles = [s for s in singles if worth_a_name(scorer, s.keys[0])]
    if not singles:
        return OutlierFlight(pool.names[flight], "", -np.inf)
    best = max(singles, key=lambda s: s.log_probability)
    return OutlierFlight(pool.names[flight], best.keys[0], best.log_probability - nothing)
