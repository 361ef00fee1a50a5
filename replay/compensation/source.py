"""Which logged wrench is compensated, and when: the desired or the commanded one, at its own stamps, in the air."""

from collections.abc import Sequence
from typing import Literal, cast, get_args

import numpy as np

from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.flight.flight import AXES, Array, Flight, Gap, Indices, WrenchSeries
from wrenchgap.flight.stamps import interpolated
from wrenchgap.learn.data.measurement import from_actuators
from wrenchgap.plant.model import Model

Source = Literal["desired", "commanded"]


def source_by_name(source: str | None) -> Source | None:
    """The source by name; raises UsageError on another word."""
    if source is None or source in get_args(Source):
        return cast(Source | None, source)
    raise UsageError(f"--source {source}: expected {' or '.join(get_args(Source))}")


def logged_command(flight: Flight, model: Model) -> WrenchSeries | None:
    """The commanded wrench about the centre of mass, computed from the actuators where only they are logged.

    None where the log has neither, or only a desired wrench. Raises FitError where actuators are logged that do not fit
    the model.
    """
    if flight.commanded is not None:
        return flight.commanded
    actuators, vehicle = flight.actuators, model.vehicle
    if actuators is None or not vehicle.has_rotors or not actuators.rotor_speed.shape[1]:
        return None
    wrench = from_actuators(flight.name, vehicle, actuators.tilt, actuators.rotor_speed).wrench_B
    return WrenchSeries(actuators.topic, actuators.time, wrench, gaps=actuators.gaps)


def input_wrench(flight: Flight, logged: WrenchSeries | None, source: Source | None) -> tuple[WrenchSeries, Source]:
    """The series to compensate: by default the desired wrench where it is logged, else the command."""
    available: dict[Source, WrenchSeries | None] = {"desired": flight.desired, "commanded": logged}
    for name, series in available.items():
        if source in (None, name) and series is not None:
            return series, name
    have = ", ".join(name for name, series in available.items() if series is not None)
    if source is not None and have:
        raise LogError(
            f"{flight.path.name}: no topic plays the role '{source}'; use --source {have}, or map one with "
            f"--topic {source}=/your/topic"
        )
    played = ", ".join(flight.series()) or "none"
    raise LogError(
        f"{flight.path.name}: neither a desired or commanded wrench, nor actuators from which the model could compute "
        f"one; roles played: {played}. Map one with --topic commanded=/your/topic, or use a model with [[vehicle.arms]]"
    )


def without(series: WrenchSeries, left_out: Sequence[Gap]) -> WrenchSeries:
    """A series without what lies in some gaps, which become its own."""
    if not left_out:
        return series
    time = series.time
    kept = ~np.any([(time > gap.start) & (time < gap.stop) for gap in left_out], axis=0)
    gaps = sorted((*series.gaps, *left_out), key=lambda gap: gap.stop)
    return WrenchSeries(series.topic, time[kept], series.wrench_B[kept], gaps=tuple(gaps))


def starts(series: WrenchSeries) -> Indices:
    """Where a series begins, and where it goes on after a gap."""
    found = np.unique([0, *(int(np.searchsorted(series.time, gap.stop)) for gap in series.gaps)])
    return found[found < len(series.time)]


def at_stamps(time: Array, pieces: Sequence[tuple[Array, Array]]) -> Array:
    """Piecewise series (of wrenches where there is no piece), linear between samples, at `time` (K,); nan between."""
    out = np.full((len(time), pieces[0][1].shape[1] if pieces else len(AXES)), np.nan)
    for knots, values in pieces:
        if len(knots) == 0:
            continue
        inside = (time >= knots[0]) & (time <= knots[-1])
        asked = time[inside]
        out[inside] = interpolated(asked, knots, values)
    return out


def pieces(series: WrenchSeries) -> list[tuple[Array, Array]]:
    """Times and wrenches of a series, cut at its gaps."""
    cuts = starts(series)[1:]
    return list(zip(np.split(series.time, cuts), np.split(series.wrench_B, cuts), strict=True))
