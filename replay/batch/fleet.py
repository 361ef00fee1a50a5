"""What the rows of a fleet say together: its ranking, vehicle by vehicle, and the trend over the flights of one."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.flight.formats.folders import natural
from wrenchgap.flight.repeats import SKETCH
from wrenchgap.learn.identify.trend import FlightValues, FollowedFlight, Trend, by_date, trend_of
from wrenchgap.learn.posterior.fleet_ranking import Ranking, ranking
from wrenchgap.learn.posterior.flight_evidence import Evidence, unpacked
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model
from wrenchgap.replay.batch.store import Store, from_fit_json

Followed = tuple[FollowedFlight, FlightValues]


@dataclass(frozen=True)
class FleetRanking:
    """One vehicle: its ranking, or why there is none; and logs of a flight that another log has, which count once."""

    vehicle: str
    ranking: Ranking | None
    reason: str = ""
    repeats: Mapping[str, str] = field(default_factory=dict)


def rankings(store: Store, keys: Sequence[str], number: int) -> list[FleetRanking]:
    """Of every vehicle with a row among `keys`, in the order of their names. Evidence is merged in the order of the
    logs' names, whichever was done first. Raises UsageError for evidence that is damaged.
    """  # noqa: D205
    wanted = set(keys)
    rows = [
        r for r in store.rows(number, ("key", "log", "status", "seconds")) if r["key"] in wanted and r["status"] == "ok"
    ]
    out = []
    for vehicle in sorted({r["vehicle"] for r in rows}):
        logs = {r["key"]: r["log"] for r in rows if r["vehicle"] == vehicle}
        length = {r["key"]: r["seconds"] or 0.0 for r in rows}
        longest_first = sorted(logs, key=lambda key: -length[key])
        signatures = (found.signature.tolist() for found in _read(store, longest_first, number))
        repeats = repeated(zip(map(logs.__getitem__, longest_first), signatures, strict=True))
        once = [key for key, log in logs.items() if log not in repeats]
        try:
            found = ranking(lambda once=once: _read(store, once, number))  # type: ignore[misc]
            out.append(FleetRanking(vehicle, found, repeats=repeats))
        except FitError as error:
            out.append(FleetRanking(vehicle, None, str(error), repeats))
    return out


def _read(store: Store, keys: Sequence[str], number: int) -> Iterator[Evidence]:
    for where, content in store.evidence(keys, number):
        try:
            yield unpacked(content, where)
        except FitError as error:
            raise UsageError(str(error)) from None


def repeated(logs: Iterable[tuple[str, Sequence[int]]]) -> dict[str, str]:
    """Logs that hold samples of a flight which a log before them holds: in another format, cut, or under other stamps.

    Each with that log; told by their `flight.repeats.signature`.
    """
    first: dict[int, str] = {}
    out = {}
    for log, hashes in logs:
        [(other, count)] = Counter(first[h] for h in hashes if h in first).most_common(1) or [("", 0)]
        if count >= SKETCH.fewest:
            out[log] = other
        else:
            first |= dict.fromkeys(hashes, log)
    return out


def moved(found: Sequence[FleetRanking], most: float = 0.1) -> bool:
    """Whether a member of a set that counts was found elsewhere than it was linearised: by `most` typical sizes."""
    for one in found:
        if one.ranking is None:
            continue
        for key in {k for s in one.ranking.sets if s.weight > 0.01 for k in s.keys}:
            line = one.ranking.columns[key]
            now = np.array(one.ranking.points[key])
            if np.max(np.abs(now - line.origin - line.theta) / line.scale) > most:
                return True
    return False


def _in_order(read: Sequence[tuple[str, Followed]]) -> tuple[list[Followed], tuple[str, ...]]:
    """Flights by log, each once: by date, where all clocks are calendars; else by the logs' names, numbers in them by
    size. And what there is to say of that: a clock that begins with the autopilot says nothing of the day.
    """  # noqa: D205
    longest_first = sorted(read, key=lambda row: row[1][0].span[0] - row[1][0].span[1])
    repeats = repeated((log, one.signature) for log, (one, _) in longest_first)
    said = [f"{log} is a flight that {other} has: left out." for log, other in repeats.items()]
    once = [(log, pair) for log, pair in read if log not in repeats]
    order = by_date([one.span for _, (one, _) in once])
    if order is None:
        said.append("Flights are in the order of their logs' names: by their clocks some have no date, or overlap.")
        order = sorted(range(len(once)), key=lambda k: [natural(Path(part)) for part in Path(once[k][0]).parts])
    return [once[k][1] for k in order], tuple(said)


def trend_of_rows(store: Store, model: Model, names: tuple[str, ...] = (), vehicle: str | None = None) -> Trend:
    """The trend over the flights of one vehicle, each once, in the order of date where all clocks are calendars,
    else of the logs' names.

    Raises UsageError where the rows are damaged or not those of `compare`, are of several vehicles and none is named,
    are of other effects, or of fewer than two flights.
    """  # noqa: D205
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
    try:
        read = [(r["log"], from_fit_json(r["fit"], f"{where}: `fit` of the row of {r['log']}")) for r in own]
    except UsageError as error:
        raise UsageError(f"{error}; to do that log again, run the same `wrenchgap batch` with --again") from None
    pairs, said = _in_order(read)
    if len(pairs) < 2:
        raise UsageError(
            f"{where}: all logs are of one flight, {pairs[0][0].flight.name}; expected two flights or more"
        )
    common = tuple(n for n in pairs[0][1].effects if all(n in values.effects for _, values in pairs))
    if any(values.effects != common for _, values in pairs) or (names and names != common):
        fitted = ", ".join(dict.fromkeys(n for _, values in pairs for n in values.effects))
        raise UsageError(
            f"{where}: not all flights were fitted with the same effects ({fitted}); run `batch compare` "
            "with --fit A,B into another folder"
        )
    count = sum(len(find(name).parameters(model.vehicle)) for name in common)
    for one, values in pairs:
        if not len(values.theta) == len(values.std) == count:
            raise UsageError(
                f"{where}: `fit` of {one.flight.name} has {len(values.theta)} values and {len(values.std)} standard "
                f"deviations, and {', '.join(common)} of {model.name} have {count}; name the model of the batch"
            )
    found = trend_of([one for one, _ in pairs], [values for _, values in pairs], model.without_tolerances)
    return replace(found, notes=said)
