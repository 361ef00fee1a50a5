"""What one flight says by itself, as a batch keeps it for `trend` (docs/batch.md)."""

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Flight
from wrenchgap.learn.identify.trend import FlightValues, FollowedFlight
from wrenchgap.plant.reader import Name, Names, NotNegative, Number, Positive, Table, Text, expected, quoted, read
from wrenchgap.replay.present.numbers import entries

OrNull = NotNegative | None
SixOrNull = Annotated[tuple[OrNull, OrNull, OrNull, OrNull, OrNull, OrNull], expected("six numbers or null")]
Time = Annotated[int, Field(strict=True, ge=-(2**63), lt=2**63), expected("a time in nanoseconds")]


class StoredFit(Table):
    """The keys, and what each may be; null is a number that is not known."""

    effects: Annotated[tuple[Name, ...], Field(min_length=1), expected("a list of effects")]
    theta: Annotated[tuple[Number, ...], expected("a list of finite numbers, of a size up to 1e12")]
    std: Annotated[tuple[OrNull, ...], expected("a list of numbers that are not negative, or null")]
    at_bound: Names
    left: SixOrNull
    name: Text
    file: Text
    sha256: Text
    start_ns: Time
    noise: SixOrNull
    cutoff_hz: Positive


def fit_json(found: FlightValues, one: FollowedFlight) -> dict[str, Any]:
    """The values of a flight, and what identifies it."""
    values = entries(found, "effects", "theta", "std", "at_bound", "left")
    about = {"name": one.flight.name, "file": one.flight.path.name, "sha256": one.flight.content_hash}
    return {**values, **about, "start_ns": one.flight.start_ns, "noise": one.noise, "cutoff_hz": one.cutoff_hz}


def from_fit_json(text: str, where: str) -> tuple[FollowedFlight, FlightValues]:
    """Back from `fit_json`; raises UsageError, which begins with `where`, for anything else."""
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{where}: is no JSON ({quoted(str(error))}); expected what `batch compare` wrote") from None
    body = read(StoredFit, values, where=where, error=UsageError)
    flight = Flight(body.name, Path(body.file), body.sha256, body.start_ns)
    theta, std, left, noise = (np.array(v, dtype=float) for v in (body.theta, body.std, body.left, body.noise))
    found = FlightValues(body.effects, theta, std, body.at_bound, left)
    return FollowedFlight(flight, (), noise, body.cutoff_hz), found
