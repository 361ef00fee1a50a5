"""`trend` from the rows of `batch compare`: every flight was fitted by itself when its log was read."""

from __future__ import annotations

import json

from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.identify.trend import Trend, trend_of
from wrenchgap.plant.model import Model
from wrenchgap.replay.batch.store import Store
from wrenchgap.replay.present.trend import from_fit_json


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
