"""Rotor commands of a log as speeds: what an autopilot sent, through the curve that the model file has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wrenchgap.flight.command_units import ROTOR_WORDS
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import ActuatorSeries, Array, Flight
from wrenchgap.plant.model import Model


def as_speeds(found: Flight, model: Model) -> Flight:
    """The flight with rotor commands in rad/s, where the model's [command] says how, and a note that says so.

    A flight whose commands are speeds already, or a model without [command] or rotors, is left as it is. A normalised
    wrench beside converted rotor commands is left out: the rotors say the same in newtons. Raises LogError where log
    and model file are of different units.
    """
    sent, curve = found.actuators, model.command
    if sent is None or sent.unit == "rad/s" or curve is None or not model.vehicle.has_rotors:
        return found
    if sent.unit != curve.unit:
        raise LogError(
            f"{found.path.name}: the rotor commands of {sent.topic} are {ROTOR_WORDS[sent.unit]}, and [command] of "
            f"{model.name} is for {ROTOR_WORDS[curve.unit]}; set its unit and curve, or map another topic with --topic "
            "rotor_speed=/your/topic"
        )
    _, rotors = model.vehicle.geometry()
    if sent.rotor_speed.shape[1] != len(rotors):
        raise LogError(
            f"{found.path.name}: {sent.topic} has {sent.rotor_speed.shape[1]} rotor commands, {model.vehicle.name} has "
            f"{len(rotors)} rotors; map the columns with --topic rotor_speed={sent.topic}[...] or use another model"
        )
    battery = found.battery
    voltage = None if battery is None else np.asarray(np.interp(sent.time, battery.time, battery.voltage))
    speeds = curve.speeds(sent.rotor_speed, voltage, model.vehicle)
    wrenches = {
        role: None
        for role in ("commanded", "desired")
        if (series := getattr(found, role)) is not None and series.unit == "normalised"
    }
    converted: ActuatorSeries = replace(sent, rotor_speed=speeds, unit="rad/s")
    notes = (*found.notes, *_notes(found, sent, model, voltage))
    return replace(found, actuators=converted, notes=notes, **wrenches)  # type: ignore[arg-type]


def _notes(found: Flight, sent: ActuatorSeries, model: Model, voltage: Array | None) -> list[str]:
    """What was made of the commands, and by which curve."""
    curve = model.command
    assert curve is not None
    origin = f" ({curve.source})" if curve.source else ""
    notes = [
        f"{found.name}: rotor commands of {sent.topic} are {ROTOR_WORDS[sent.unit]}; {curve.gives} by [command] of "
        f"{model.name}{origin}."
    ]
    if curve.uses_voltage and voltage is None:
        notes.append(f"{found.name}: no battery voltage in the log; the curve is taken at its nominal voltage.")
    if (share := curve.share_outside(sent.rotor_speed)) > 0.001:
        notes.append(
            f"{found.name}: {100.0 * share:.1f} % of the rotor commands lie outside the bench table: its ends are held."
        )
    return notes
