"""Moving a topic's stamps, when the user says so: never by itself, and always on record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Flight, Gap, Series

SHIFTABLE = ("imu", "odometry", "reference", "battery")
"""Roles whose stamps may be moved. Not the commands: a response that lags them is a candidate effect."""
LARGEST = 10.0
"""Largest shift [s]: beyond it, somebody mistook milliseconds for seconds."""


def shifted(flight: Flight, shifts: Mapping[str, float]) -> Flight:
    """The flight with the stamps of some topics moved by seconds (positive: later); named by role or topic.

    The shifts are kept in `Flight.shifts` and said in its notes. To undo that the odometry lags the IMU by 12 ms, move
    it by -0.012. Raises UsageError for a role or topic that this flight lacks, a role of commands, or a shift that is
    not a sensible number of seconds.
    """
    moved: dict[str, Series] = {}
    notes = []
    for name, seconds in shifts.items():
        role, series = _named(flight, name)
        if role not in SHIFTABLE:
            raise UsageError(
                f"--shift {name}: stamps of the {role} wrench or actuators are not moved, because a response that lags "
                f"them is an effect to be found (command_delay, servo_lag, motor_lag); can be moved: {_movable(flight)}"
            )
        if not abs(seconds) <= LARGEST:
            raise UsageError(f"--shift {name}={seconds:g}: expected seconds, at most {LARGEST:g}, e.g. -0.0123")
        if role in moved:
            raise UsageError(f"--shift {name}: {role} is shifted twice; say it once")
        gaps = tuple(Gap(gap.start + seconds, gap.stop + seconds) for gap in series.gaps)
        moved[role] = replace(series, time=series.time + seconds, gaps=gaps)
        notes.append(f"{flight.name}: stamps of {series.topic} ({role}) moved by {1e3 * seconds:+.4g} ms, as asked.")
    together = {role: shifts.get(role, shifts.get(series.topic, 0.0)) for role, series in moved.items()}
    return replace(
        flight,
        **moved,  # type: ignore[arg-type]
        checks=None if moved else flight.checks,
        shifts={**flight.shifts, **together},
        notes=(*flight.notes, *notes),
    )


def _named(flight: Flight, name: str) -> tuple[str, Series]:
    """The role and series that a role or a topic stands for."""
    played = flight.series()
    if name in played:
        return name, played[name]
    for role, series in played.items():
        if name in series.topic.split(" + "):
            return role, series
    raise UsageError(f"--shift {name}: {flight.path.name} has no such role or topic; can be moved: {_movable(flight)}")


def _movable(flight: Flight) -> str:
    return ", ".join(f"{r} ({s.topic})" for r, s in flight.series().items() if r in SHIFTABLE) or "none"
