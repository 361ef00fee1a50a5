"""Opening logs for a model: flights, their contiguous stretches on one clock, and records ready to be compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import flight
from flight.errors import FitError, LogError
from flight.flight import Flight, Samples
from learn.measurement import CUTOFF_HZ, Record, prepare
from plant.model import Model


@dataclass(frozen=True)
class OpenFlight:
    """A flight, its stretches on one clock, the records made of them, and notes that a user should read."""

    flight: Flight
    samples: tuple[Samples, ...]
    records: tuple[Record, ...]
    notes: tuple[str, ...]


def open_flight(
    path: str | Path, model: Model, *, topics: Mapping[str, str] | None = None, cutoff_hz: float = CUTOFF_HZ
) -> OpenFlight:
    """Read one log for a model.

    Topics are those of the model file where the log has them, overridden by `topics`. Commands may be wrenches,
    actuators or both; motion may come from an IMU or, failing that, from the odometry.
    """
    return opened(flight.load(path, topics, preferred=model.topics), model, cutoff_hz=cutoff_hz)


def opened(found: Flight, model: Model, *, cutoff_hz: float = CUTOFF_HZ, rate_hz: float | None = None) -> OpenFlight:
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
    for samples in resampled.samples:
        try:
            records.append(prepare(samples, model.vehicle, cutoff_hz=cutoff_hz, rate_hz=rate_hz))
        except FitError as error:
            if len(samples) * samples.dt >= 12.0 / cutoff_hz:
                raise
            short.append(str(error))
    if not records:
        raise LogError(short[0])
    sources = {r.source for r in records}
    notes = [*found.notes, *resampled.notes, *short]
    if "allocated" in sources:
        notes.append(f"{found.name}: no actuator commands in the log; allocated from the commanded wrench.")
    if "none" in sources:
        notes.append(f"{found.name}: the model has no rotors; the commanded wrench is the nominal model.")
    return OpenFlight(found, resampled.samples, tuple(records), tuple(dict.fromkeys(notes)))


def open_flights(
    paths: Sequence[str | Path],
    model: Model,
    *,
    topics: Mapping[str, str] | None = None,
    cutoff_hz: float = CUTOFF_HZ,
) -> list[OpenFlight]:
    """`open_flight` for several logs, in order; the same log twice is an error."""
    opened: list[OpenFlight] = []
    for path in paths:
        one = open_flight(path, model, topics=topics, cutoff_hz=cutoff_hz)
        for other in opened:
            if other.flight.content_hash == one.flight.content_hash:
                raise LogError(f"{path}: is the same flight as {other.flight.path}; name each flight once")
        opened.append(one)
    return opened
