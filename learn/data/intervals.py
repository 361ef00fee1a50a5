"""Which times of a flight are asked for: one interval, or several that add up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import Flight, Gap, Samples

Interval = tuple[float, float]
Between = Interval | Sequence[Interval] | None
"""Times [s] of the flight's own clock; None is all of it."""
MINIMUM_FLIGHT = 2.0
"""Shortest stretch that is worth keeping [s]."""


def intervals(between: Between) -> tuple[Interval, ...]:
    """Intervals in order of time, those that touch as one; none where all of the flight is asked for."""
    if between is None or len(between) == 0:
        return ()
    single = isinstance(between[0], int | float | np.number)
    every: list[Interval] = [tuple(between)] if single else list(between)  # type: ignore[list-item,arg-type]
    joined: list[Interval] = []
    for start, stop in sorted((float(a), float(b)) for a, b in every):
        if joined and start <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(joined[-1][1], stop))
        else:
            joined.append((start, stop))
    return tuple(joined)


def outside(between: Between) -> tuple[Gap, ...]:
    """The times that are not asked for."""
    asked = intervals(between)
    if not asked:
        return ()
    edges = [-np.inf, *(t for interval in asked for t in interval), np.inf]
    return tuple(Gap(float(a), float(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b > a)


def within(stretches: Sequence[Samples], between: Between, found: Flight) -> list[Samples]:
    """The parts of the stretches that are asked for; a LogError where nothing of the flight lies there."""
    asked = intervals(between)
    if not asked:
        return list(stretches)
    kept = []
    for samples in stretches:
        for interval in asked:
            first, last = np.searchsorted(samples.time, interval)
            if (last - first) * samples.dt >= MINIMUM_FLIGHT:
                kept.append(part(samples, slice(int(first), int(last))))
    if not kept:
        begin, end = stretches[0].time[0], stretches[-1].time[-1]
        listed = " and ".join(f"{a:g} and {b:g} s" for a, b in asked)
        raise LogError(
            f"{found.path.name}: less than {MINIMUM_FLIGHT:g} s of flight between {listed}; the flight lasts from "
            f"{begin:.1f} to {end:.1f} s"
        )
    return kept


def part(samples: Samples, rows: slice) -> Samples:
    """Some consecutive samples of a stretch."""
    arrays: dict[str, Any] = {k: v[rows] for k, v in vars(samples).items() if isinstance(v, np.ndarray)}
    return replace(samples, **arrays)
