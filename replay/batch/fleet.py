"""What the rows of a fleet say together: its ranking, vehicle by vehicle, and the trend over the flights of one."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.learn.identify.trend import Trend, trend_of
from wrenchgap.learn.posterior.evidence import Evidence, unpacked
from wrenchgap.learn.posterior.fleet import Ranking, ranking
from wrenchgap.plant.model import Model
from wrenchgap.replay.batch.store import Store
from wrenchgap.replay.present.trend import from_fit_json

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
    logs' names, whichever was done first.
    """  # noqa: D205
    wanted = set(keys)
    rows = [r for r in store.rows(number, ("key", "log", "status")) if r["key"] in wanted and r["status"] == "ok"]
    out = []
    for vehicle in sorted({r["vehicle"] for r in rows}):
        own = [r["key"] for r in rows if r["vehicle"] == vehicle]

        def read(own: Sequence[str] = own) -> Iterator[Evidence]:
            return (unpacked(content) for content in store.evidence(own, number))

        try:
            out.append(FleetRanking(vehicle, ranking(read)))
        except FitError as error:
            out.append(FleetRanking(vehicle, None, str(error)))
    return out


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


def trend_of_rows(store: Store, model: Model, names: tuple[str, ...] = (), vehicle: str | None = None) -> Trend:
    """The trend over the flights of one vehicle, in the order of their clocks, then of the logs' names.

    Raises UsageError where the rows are not those of `compare`, are of several vehicles and none is named, are of
    other effects, or of fewer than two flights.
    """
    where = store.url
    if (command := store.identity()["command"]) != "compare":
        raise UsageError(f"{where}: holds rows of `batch {command}`; trend follows those of `batch compare`")
    rows = [r for r in store.rows() if r["status"] == "ok" and r["fit"]]
    vehicles = sorted({r["vehicle"] for r in rows})
    if vehicle is None and len(vehicles) > 1:
        raise UsageError(f"{where}: holds flights of several vehicles; name one with --vehicle: {', '.join(vehicles)}")
    own = [r for r in rows if vehicle is None or r["vehicle"] == vehicle]
    if len(own) < 2:
        listed = ", ".join(vehicles) or "none"
        raise UsageError(
            f"{where}: got {len(own)} flights of {vehicle or 'one vehicle'}, expected two or more; "
            f"vehicles there: {listed}"
        )
    own.sort(key=lambda r: (r["start_ns"], r["log"]))
    pairs = [from_fit_json(json.loads(r["fit"])) for r in own]
    common = tuple(n for n in pairs[0][1].effects if all(n in values.effects for _, values in pairs))
    if any(values.effects != common for _, values in pairs) or (names and names != common):
        fitted = ", ".join(dict.fromkeys(n for _, values in pairs for n in values.effects))
        raise UsageError(
            f"{where}: not all flights were fitted with the same effects ({fitted}); run `batch compare` "
            "with --fit A,B into another folder"
        )
    return trend_of([one for one, _ in pairs], [values for _, values in pairs], model.untold)
