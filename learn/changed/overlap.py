"""Where flights do not overlap: what suspect flights did that no healthy one did cannot be compared."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.changed.pooled_flights import PooledFlights
from wrenchgap.learn.diagnose.quantities import quantities

COMPARED = ("thrust", "tilt", "speed", "height", "rate")
SLACK = {"thrust": 0.15, "tilt": 5.0, "speed": 0.3, "height": 0.3, "rate": 0.3}
"""How far beyond the healthy flights a quantity may go without a word: of thrust as a share of it, else in its unit
(deg, m/s, m, rad/s)."""
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
        if q.name not in COMPARED:
            continue
        healthy, suspect = q.values[~rows], q.values[rows]
        slack = SLACK[q.name] * (float(np.median(healthy)) if q.name == "thrust" else 1.0)
        low, high = float(np.min(healthy)) - slack, float(np.max(healthy)) + slack
        outside = float(np.mean((suspect < low) | (suspect > high)))
        if outside > OUTSIDE:
            found.append(NotCompared(q.name, q.unit, _range(healthy), _range(suspect), outside))
    return tuple(found)


def _range(values: Array) -> tuple[float, float]:
    low, high = np.percentile(values, (5.0, 95.0))
    return float(low), float(high)
