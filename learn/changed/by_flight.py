"""One flight at a time: signed means of what the model leaves, and values of effects on that flight alone."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.changed.pooled_flights import PooledFlights
from wrenchgap.learn.changed.search import Weighed
from wrenchgap.learn.changed.spectrum import answered
from wrenchgap.learn.data.errors import means_by
from wrenchgap.learn.diagnose.quantities import quantities
from wrenchgap.learn.posterior.kernels import bounded
from wrenchgap.learn.posterior.spectrum import transformed


@dataclass(frozen=True)
class FlightRow:
    """One flight: `role` "healthy", "odd" or "suspect"; `mean` and `rms` (6,) of what the given model leaves, NaN on
    axes that were not measured; `values` of the effects that changed, by (effect, parameter), on this flight alone.
    """  # noqa: D205

    flight: str
    role: str
    mean: Array
    rms: Array
    values: dict[tuple[str, str], float]


def rows_by_flight(
    pool: PooledFlights, roles: Sequence[str], values: Sequence[dict[tuple[str, str], float]]
) -> list[FlightRow]:
    """A row for each flight of the pool."""
    left = np.where(pool.data.measured_axes, pool.given, np.nan)
    means, squares = (means_by(pool.data.flight, x) for x in (left, left**2))
    return [FlightRow(*row) for row in zip(pool.names, roles, means, np.sqrt(squares), values, strict=True)]


def values_by_flight(found: Weighed, names: Sequence[str], scale: Array) -> Array:
    """Parameters (F, P) of these effects by flight: what all flights share, and what each is off from that by itself.

    `scale` (P,) are the prior's sizes of the latter; no trim is granted. What the model as given has of an effect
    counts.
    """
    pool, scorer = found.pool, found.scorer
    best = scorer(tuple(sorted(names)))
    space, always = scorer.spectrum, -best.weights[scorer.spectrum.always]
    lines = [next(one.line for one in pool.laws if one.name == n) for n in names]
    stack = np.concatenate(((pool.left - pool.shared(always))[:, :, None], *(c.jacobian for c in lines)), axis=2)
    stack = pool.data.unanswered(stack)[:, space.axes]
    coefficients, _, _ = transformed(pool.data.records, stack, pool.settings.block)
    coefficients[np.ix_(space.within, np.isin(space.axes, answered(pool.data)))] = 0.0
    weight = (scorer.count / np.maximum(space.count, 1.0) / best.variance)[space.band]
    low, high = (np.concatenate([getattr(c, side) for c in lines]) for side in ("low", "high"))
    low, high = np.minimum(low, -np.abs(high)), np.maximum(high, np.abs(low))
    out = []
    flight = pool.data.flight[space.starts][space.block]
    for f in range(len(pool.names)):
        mine = flight == f
        x = coefficients[mine] * np.sqrt(weight[mine])[:, :, None]
        flat = x.reshape(-1, x.shape[2])
        whole = flat.T @ flat
        out.append(bounded(whole[1:, 1:], whole[1:, 0], low, high, scale))
    return np.asarray(np.array(out) + shared(found, names))


def shared(found: Weighed, names: Sequence[str]) -> Array:
    """Parameters (P,) of these effects that all flights share; what the model as given has counts."""
    pool, scorer = found.pool, found.scorer
    always = -scorer(tuple(sorted(names))).weights[scorer.spectrum.always]
    origins = {one.name: one.line.origin for one in pool.laws}
    return np.concatenate([origins[n] + pool.shared_values(always, n) for n in names])


SLACK = {"thrust": 0.15, "tilt": 5.0, "speed": 0.3, "height": 0.3, "rate": 0.3, "voltage": 0.03}
"""How far beyond the healthy flights a quantity may go without a word: thrust and voltage as a share of it (thrust goes
with about the square of the voltage), else in its unit (deg, m/s, m, rad/s)."""
OUTSIDE = 0.2
"""Share of the suspect flights' time outside what healthy flights did that is worth a word."""


@dataclass(frozen=True)
class NotCompared:
    """A quantity in which the flights do not overlap: ranges (5th to 95th percentile) of both sides, and the share of
    the suspect flights' time outside those of the healthy ones.
    """  # noqa: D205

    quantity: str
    unit: str
    healthy: tuple[float, float]
    suspect: tuple[float, float]
    outside: float

    @property
    def reason(self) -> str:
        """In one sentence."""
        (a, b), (c, d) = self.healthy, self.suspect
        return (
            f"{100 * self.outside:.0f} % of the suspect flights' time is outside what healthy flights did: "
            f"{c:.3g} to {d:.3g} {self.unit}, healthy {a:.3g} to {b:.3g} {self.unit}; a change that acts only there "
            "cannot be told from what was always so"
        )


def not_compared(pool: PooledFlights, suspects: Collection[int]) -> tuple[NotCompared, ...]:
    """Quantities in which suspect flights went where healthy ones did not."""
    known, _ = quantities(pool.data)
    rows = pool.rows(suspects)
    found = []
    for q in known:
        if q.name not in SLACK:
            continue
        healthy, suspect = q.values[~rows], q.values[rows]
        slack = SLACK[q.name] * (float(np.median(healthy)) if q.name in ("thrust", "voltage") else 1.0)
        low, high = float(np.min(healthy)) - slack, float(np.max(healthy)) + slack
        outside = float(np.mean((suspect < low) | (suspect > high)))
        if outside > OUTSIDE:
            found.append(NotCompared(q.name, q.unit, _range(healthy), _range(suspect), outside))
    return tuple(found)


def _range(values: Array) -> tuple[float, float]:
    low, high = np.percentile(values, (5.0, 95.0))
    return float(low), float(high)
