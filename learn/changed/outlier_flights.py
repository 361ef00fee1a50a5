"""Healthy flights that are not: each against the others, as if it were the suspect one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.learn.changed.pooled_flights import PooledFlights, calibrated
from wrenchgap.learn.changed.search import ChangeScorer, worth_a_name
from wrenchgap.learn.posterior.score import Scored

FEWEST = 3
"""Healthy flights below which none can be said to be odd: of two that differ, either may be."""
OUTLIER_ODDS = 4.0
"""Log odds that something changed, the likeliest change by itself against none, from which on a flight is odd."""


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
    scorer = ChangeScorer(spectrum, spectrum.saturated()[0])
    nothing = scorer(()).log_probability
    singles: list[Scored] = [scorer((key,)) for key in spectrum.columns]
    singles = [s for s in singles if worth_a_name(scorer, s.keys[0])]
    if not singles:
        return OutlierFlight(pool.names[flight], "", -np.inf)
    best = max(singles, key=lambda s: s.log_probability)
    return OutlierFlight(pool.names[flight], best.keys[0], best.log_probability - nothing)
