"""What a user is told of phases: the times that are left out, checks, and a log without any flight."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from wrenchgap.flight.check import UNPOWERED, Check, TimeLeftOut
from wrenchgap.flight.flight import Gap
from wrenchgap.learn.data.between import MINIMUM_FLIGHT, Between, outside
from wrenchgap.learn.data.phases.phase import Phase
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import GRAVITY

EDGE = 0.3
"""Time [s] that is not worth a word."""


def times_left_out(
    flight: str, between: Between, holes: Iterable[Gap], phases: Sequence[Phase], span: tuple[float, float]
) -> list[TimeLeftOut]:
    """Every time that is not used, with its reason; `holes` are those between the parts that are, `span` is the log.

    In a hole lie phases, and pieces of flight too short to be of use. What begins or ends with the log is open there.
    """
    told = [TimeLeftOut(flight, gap.start, gap.stop, "not asked for (--between)") for gap in outside(between)]
    for hole in holes:
        at = max(hole.start, span[0])
        for phase in phases:
            if not phase.left_out or phase.stop < hole.start or phase.start > hole.stop:
                continue
            told += _short(flight, hole, at, phase.start, span)
            start, stop = max(phase.start, hole.start), min(phase.stop, hole.stop)
            told.append(TimeLeftOut(flight, *_open(start, stop, hole, span), f"{phase.name}: {phase.why}"))
            at = max(at, stop)
        told += _short(flight, hole, at, min(hole.stop, span[1]), span)
    return told


def _short(flight: str, hole: Gap, start: float, stop: float, span: tuple[float, float]) -> list[TimeLeftOut]:
    if stop - start < EDGE:
        return []
    return [TimeLeftOut(flight, *_open(start, stop, hole, span), f"less than {MINIMUM_FLIGHT:g} s of flight")]


def _open(start: float, stop: float, hole: Gap, span: tuple[float, float]) -> tuple[float, float]:
    """The times with the hole's end in place of the log's."""
    return (
        hole.start if start < span[0] + EDGE else start,
        hole.stop if stop > span[1] - EDGE else stop,
    )


def of_phases(phases: Sequence[Phase]) -> tuple[Check, ...]:
    """What is worth a warning: crashes and impacts, and limits that a vehicle is at all the time."""
    found = []
    for name in ("crash", "impact"):
        events = [p for p in phases if p.name == name]
        if events:
            first = events[0]
            more = f", and {len(events) - 1} time(s) more" if len(events) > 1 else ""
            kept = ": left out" if first.left_out else ": kept (--keep)"
            words = f"{first.start:.2f} to {first.stop:.2f} s{more}: {first.why}{kept}."
            found.append(Check("crash", "warn", f"{name.capitalize()} at {words}"))
    limited = [p for p in phases if p.name == "saturation" and (p.left_out or "too low" in p.why)]
    if limited:
        seconds = sum(p.stop - p.start for p in limited)
        kept = "left out" if limited[0].left_out else "kept"
        found.append(Check("saturation", "warn", f"{seconds:.1f} s saturated: {limited[0].why}; {kept}."))
    return tuple(found)


def never_flew(
    name: str, phases: Sequence[Phase], model: Model, notes: Sequence[object] = (), *, of_rotors: bool = False
) -> str:
    """The one line for a log in which nothing of `MINIMUM_FLIGHT` is left; `notes` are those of its reader, `of_rotors`
    says that the wrench is that of the logged rotor speeds.
    """  # noqa: D205
    unpowered = next((str(note) for note in notes if str(note).endswith(UNPOWERED)), None)
    if unpowered is not None:
        return f"{name}: {unpowered.removesuffix('.')}; give another log"
    weight = f"{model.vehicle.body.mass * GRAVITY:.3g} N"
    seconds: dict[str, float] = {}
    for phase in phases:
        if phase.left_out:
            seconds[phase.name] = seconds.get(phase.name, 0.0) + phase.stop - phase.start
    if not seconds:
        return f"{name}: no stretch of {MINIMUM_FLIGHT:g} s of flight in the log"
    listed = ", ".join(f"{which} {length:.1f} s" for which, length in seconds.items())
    most = max(seconds, key=lambda which: seconds[which])
    why = f"{name}: no {MINIMUM_FLIGHT:g} s of flight ({listed})"
    if most in ("ground", "held"):
        unit = "rotor speeds in rad/s" if of_rotors else "wrench in newtons"
        return f"{why}: the rotors never carry {model.vehicle.name}'s weight ({weight}); right model, {unit}?"
    return f"{why}; keep a phase with --keep {most}"
