"""What healthy flights show of all effects at once, as a model: where changes are linearised.

What changes is multiplied by what is always there: a mass that was added, by the thrust that is lost in all flights; a
centre of mass, by motors that follow late. Straight lines taken about the model as given lack these products, which
stand above the sensors' noise where either is large, and other effects make up for them. So what is common to the
healthy flights is put into the model, and everything is linearised anew about that, `ROUNDS` times.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.learn.changed.linearised_effects import LinearisedEffect, linearised_effects
from wrenchgap.learn.changed.pooled_flights import PooledFlights, calibrated, within_bounds
from wrenchgap.learn.changed.scatter import means_by_flight
from wrenchgap.learn.changed.spectrum import answered
from wrenchgap.learn.data.candidates import Untried
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.identify.bias_and_trim import typical_trim
from wrenchgap.learn.identify.least_squares import left_by
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
    at = pool.common_at(low)
    for one, column in zip(pool.shared_laws, pool.common, strict=True):
        size = len(one.reference)
        low[at : at + size], high[at : at + size] = one.line.low, one.line.high
        at += column.jacobian.shape[2]
    theta, _, remains = within_bounds(spectrum, low, high)
    variance = np.maximum(remains, spectrum.sensor)
    likelihood = -0.5 * float(np.sum(spectrum.count * (np.log(variance) + remains / variance)))
    return pool, theta, likelihood


def _effects(pool: PooledFlights, theta: Array) -> tuple[ModelEffect, ...]:
    """Those of the model, at their new values, and those that show on some axis beside what is left of all."""
    found = {e.name: e for e in pool.model.effects}
    left = pool.left - pool.shared(theta) - pool.apart(theta)
    least = SHOWS * np.sqrt(np.mean((left - means_by_flight(pool.data, left)[pool.data.flight]) ** 2, axis=0))
    for one in pool.shared_laws:
        values = pool.shared_values(theta, one.name)
        adds = np.sqrt(np.mean((one.line.jacobian @ values) ** 2, axis=0))
        if one.name in found or np.any(adds > np.maximum(least, 1e-12)):
            inside = np.clip(values, one.line.low, one.line.high)
            found[one.name] = ModelEffect(find(one.name), one.line.origin + inside)
    return tuple(found[n] for n in sorted(found))
