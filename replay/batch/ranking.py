"""Fleets ranked from the evidence that a batch has kept, vehicle by vehicle."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.learn.posterior.evidence import Evidence, unpacked
from wrenchgap.learn.posterior.fleet import Ranking, ranking
from wrenchgap.replay.batch.store import Store

SETTLED = 0.1
"""Change of a value between two passes, in typical sizes, below which another pass would change nothing."""


@dataclass(frozen=True)
class FleetRanking:
    """One vehicle: its ranking, or why there is none."""

    vehicle: str
    ranking: Ranking | None
    reason: str = ""


def rankings(store: Store, keys: Sequence[str], number: int) -> list[FleetRanking]:
    """Of every vehicle with a row among `keys`, in the order of their names. Evidence is merged in the order of the
    logs' names, whichever was done first. Raises UsageError for evidence that is damaged.
    """  # noqa: D205
    wanted = set(keys)
    rows = [r for r in store.rows(number, ("key", "log", "status")) if r["key"] in wanted and r["status"] == "ok"]
    out = []
    for vehicle in sorted({r["vehicle"] for r in rows}):
        own = [r["key"] for r in rows if r["vehicle"] == vehicle]

        def read(own: Sequence[str] = own) -> Iterator[Evidence]:
            return (_unpacked(content, where) for where, content in store.evidence(own, number))

        try:
            out.append(FleetRanking(vehicle, ranking(read)))
        except FitError as error:
            out.append(FleetRanking(vehicle, None, str(error)))
    return out


def _unpacked(content: bytes | None, where: str) -> Evidence:
    try:
        return unpacked(content, where)
    except FitError as error:
        raise UsageError(str(error)) from None


def points_of(found: Sequence[FleetRanking]) -> dict[str, dict[str, list[float]]]:
    """Values at which the next pass linearises candidates, by vehicle."""
    return {f.vehicle: {k: list(v) for k, v in f.ranking.points.items()} for f in found if f.ranking is not None}


def moved(found: Sequence[FleetRanking]) -> bool:
    """Whether a member of a set that counts was found elsewhere than it was linearised."""
    for one in found:
        if one.ranking is None:
            continue
        for key in {k for s in one.ranking.sets if s.weight > 0.01 for k in s.keys}:
            line = one.ranking.columns[key]
            now = np.array(one.ranking.points[key])
            if np.max(np.abs(now - line.origin - line.theta) / line.scale) > SETTLED:
                return True
    return False
