"""Opening logs for a model: flights, their contiguous stretches on one clock, and records ready to be compared."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from wrenchgap import flight
from wrenchgap.flight.errors import FitError, LogError
from wrenchgap.flight.flight import Flight, Samples
from wrenchgap.learn.data.measurement import CUTOFF_HZ, Record, low_pass, prepare
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import GRAVITY, Vehicle

Loader = Callable[..., Flight]
GROUNDED = 0.3
"""Share of the weight below which the commanded force cannot be what carries the vehicle."""
MINIMUM_FLIGHT = 2.0
"""Shortest stretch in the air that is worth keeping [s]."""


@dataclass(frozen=True)
class OpenFlight:
    """A flight, its stretches on one clock, the records made of them, and notes that a user should read."""

    flight: Flight
    samples: tuple[Samples, ...]
    records: tuple[Record, ...]
    notes: tuple[str, ...]


def open_flight(
    path: str | Path,
    model: Model,
    *,
    topics: Mapping[str, str] | None = None,
    cutoff_hz: float = CUTOFF_HZ,
    between: tuple[float, float] | None = None,
    shifts: Mapping[str, float] | None = None,
    load: Loader = flight.load,
) -> OpenFlight:
    """Read one log for a model, or what lies `between` two of its times [s]; `load` reads as `flight.load` does.

    Topics are those of the model file where the log has them, overridden by `topics`. Commands may be wrenches,
    actuators or both; motion may come from an IMU or, failing that, from the odometry. `shifts` move stamps
    (`flight.shifted`).
    """
    found = flight.shifted(load(path, topics, preferred=model.topics), shifts or {})
    return opened(found, model, cutoff_hz=cutoff_hz, between=between)


def opened(
    found: Flight,
    model: Model,
    *,
    cutoff_hz: float = CUTOFF_HZ,
    rate_hz: float | None = None,
    between: tuple[float, float] | None = None,
) -> OpenFlight:
    """A flight in memory as `open_flight` gives it; `rate_hz` is that of the records (default as `prepare`)."""
    required = tuple(r for r in ("commanded", "actuators") if getattr(found, r) is not None)[:1]
    if not required:
        raise LogError(
            f"{found.path.name}: no topic plays the role 'commanded' or 'actuators', so there is nothing to compare "
            "the measurement with; map one with --topic commanded=/your/topic"
        )
    resampled = flight.resample(found, require=(*required, *(("imu",) if found.imu is not None else ())))
    records: list[Record] = []
    short: list[str] = []
    grounded = 0.0
    for samples in _within(resampled.samples, between, found):
        try:
            whole = prepare(samples, model.vehicle, cutoff_hz=cutoff_hz, rate_hz=rate_hz)
            flown = airborne(samples, whole, model.vehicle)
            grounded += (len(samples) - sum(len(part) for part in flown)) * samples.dt
            if len(flown) == 1 and flown[0] is samples:
                records.append(whole)
                continue
            long = [part for part in flown if len(part) * part.dt >= MINIMUM_FLIGHT]
            records += [prepare(part, model.vehicle, cutoff_hz=cutoff_hz, rate_hz=rate_hz) for part in long]
        except FitError as error:
            if len(samples) * samples.dt >= 12.0 / cutoff_hz:
                raise
            short.append(str(error))
    if not records:
        raise LogError(short[0] if short else _never_flew(found, model))
    sources = {r.source for r in records}
    notes = [*found.notes, *resampled.notes, *short]
    if grounded > 0.0:
        notes.append(
            f"{found.name}: for {grounded:.1f} s the commanded force is below {100 * GROUNDED:.0f} % of the weight (on "
            "the ground, held or falling): left out."
        )
    if "allocated" in sources:
        notes.append(f"{found.name}: no actuator commands in the log; allocated from the commanded wrench.")
    if "none" in sources:
        notes.append(f"{found.name}: the model has no rotors; the commanded wrench is the nominal model.")
    return OpenFlight(found, resampled.samples, tuple(records), tuple(dict.fromkeys(notes)))


def airborne(samples: Samples, record: Record, vehicle: Vehicle) -> list[Samples]:
    """The contiguous parts of a stretch in which the commanded force, low-passed, could carry the vehicle."""
    force = np.linalg.norm(low_pass(record.commands.wrench_B[:, :3], samples.dt, 1.0), axis=1)
    flying = force > GROUNDED * vehicle.body.mass * GRAVITY
    if flying.all():
        return [samples]
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flying, [False])).astype(int)))
    return [_part(samples, slice(start, stop)) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def _within(stretches: Sequence[Samples], between: tuple[float, float] | None, found: Flight) -> list[Samples]:
    """The parts of the stretches between two times [s]; a LogError where nothing of the flight lies there."""
    if between is None:
        return list(stretches)
    kept = []
    for samples in stretches:
        first, last = np.searchsorted(samples.time, between)
        if (last - first) * samples.dt >= MINIMUM_FLIGHT:
            kept.append(_part(samples, slice(int(first), int(last))))
    if not kept:
        begin, end = stretches[0].time[0], stretches[-1].time[-1]
        raise LogError(
            f"{found.path.name}: less than {MINIMUM_FLIGHT:g} s of flight between {between[0]:g} and {between[1]:g} s; "
            f"the flight lasts from {begin:.1f} to {end:.1f} s"
        )
    return kept


def _part(samples: Samples, rows: slice) -> Samples:
    """Some consecutive samples of a stretch."""
    every = {f.name: getattr(samples, f.name) for f in fields(Samples)}
    arrays: dict[str, Any] = {name: value[rows] for name, value in every.items() if isinstance(value, np.ndarray)}
    return replace(samples, **arrays)


def _never_flew(found: Flight, model: Model) -> str:
    return (
        f"{found.path.name}: the commanded force never reaches {100 * GROUNDED:.0f} % of {model.vehicle.name}'s weight "
        f"({model.vehicle.body.mass * GRAVITY:.3g} N) for {MINIMUM_FLIGHT:g} s; is this the right model, and is the "
        "wrench in newtons?"
    )


def distinct(flights: Sequence[OpenFlight]) -> list[OpenFlight]:
    """The same flights with names that differ: two logs may be called alike in two folders."""
    seen: dict[str, int] = {}
    out = []
    for item in flights:
        name = item.flight.name
        seen[name] = seen.get(name, 0) + 1
        if seen[name] > 1:
            name = f"{name} ({seen[name]})"
            records = tuple(replace(r, flight=name) for r in item.records)
            item = replace(item, flight=replace(item.flight, name=name), records=records)
        out.append(item)
    return out


def open_flights(
    paths: Sequence[str | Path],
    model: Model,
    *,
    topics: Mapping[str, str] | None = None,
    cutoff_hz: float = CUTOFF_HZ,
    between: tuple[float, float] | None = None,
    shifts: Mapping[str, float] | None = None,
    load: Loader = flight.load,
) -> list[OpenFlight]:
    """`open_flight` for several logs, in order, with names that differ; the same log twice is an error."""
    opened: list[OpenFlight] = []
    for path in paths:
        one = open_flight(path, model, topics=topics, cutoff_hz=cutoff_hz, between=between, shifts=shifts, load=load)
        for other in opened:
            if other.flight.content_hash == one.flight.content_hash:
                raise LogError(f"{path}: is the same flight as {other.flight.path}; name each flight once")
        opened.append(one)
    return distinct(opened)
