"""Where the rotors are, and what share of the thrust each of them is commanded, as far as the log alone tells.

Rotors come from the model where one is given, else from the autopilot's parameters (`plant.drafts`). Thrust is that of
a command as the autopilot takes it, f u^2 + (1 - f) u, or the square of a speed; its size in newtons is not needed.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.autopilot import Autopilot
from wrenchgap.flight.errors import LogError, ModelError
from wrenchgap.flight.flight import ActuatorSeries, Array, Flight, Mask
from wrenchgap.flight.formats.standard_topics import are_pulses
from wrenchgap.learn.data.checks.frame import motors_of
from wrenchgap.plant.command_curve import as_speeds
from wrenchgap.plant.drafts import ardupilot, px4
from wrenchgap.plant.drafts.draft import Sourced
from wrenchgap.plant.model import Model


@dataclass(frozen=True)
class RotorPlace:
    """A rotor: its name, where it is from the centre of mass (x forward, y left; in distances of the farthest rotor).

    It turns counter-clockwise (`spin` 1) or clockwise (-1), seen from above. None where nothing tells.
    """

    name: str
    x: float | None = None
    y: float | None = None
    spin: int | None = None


@dataclass(frozen=True, eq=False)
class Thrusts:
    """Commanded thrusts: N times (N,) [s], shares (N, R) of full thrust, or relative ones where `limits` is None.

    `limits` are where (N, R) a command is at its smallest and at its largest value; None where these are not known.
    `curve` is f where thrust is taken as f u^2 + (1 - f) u of a command u, None where it is the square of a speed.
    """

    time: Array
    share: Array
    rotors: tuple[RotorPlace, ...]
    limits: tuple[Mask, Mask] | None = None
    curve: float | None = None


USUAL_PULSES = (1000.0, 2000.0)
"""Pulse widths [us] of no and of full throttle where no parameter tells them: those of all radio-control servos."""


def is_multirotor(autopilot: Autopilot | None) -> bool:
    """Whether rotors alone carry the vehicle, as far as its autopilot says; wings make lift that no command shows."""
    if autopilot is None:
        return True
    if autopilot.name == "ArduPilot":
        return not autopilot.firmware or "Copter" in autopilot.firmware
    return int(autopilot.parameters.get("CA_AIRFRAME", 0)) in px4.MULTIROTORS


def thrusts_of(flight: Flight, model: Model | None = None) -> Thrusts | None:
    """The commanded thrusts of a flight; None where its log has no command for each rotor."""
    sent = flight.actuators
    if sent is None or not sent.rotor_speed.shape[1]:
        return None
    rotors = rotors_of(flight, model)
    if model is not None and model.vehicle.has_rotors and model.vehicle.geometry()[1].c_f.size == len(rotors):
        try:
            known = as_speeds(flight, model.command, model.vehicle, model.name).actuators
        except LogError:
            known = None
        if known is not None and known.unit == "rad/s":
            most = model.vehicle.geometry()[1].speed_max
            low, high = (0.0, most) if sent.unit == "rad/s" or model.command is None else model.command.span
            commands = np.abs(sent.rotor_speed) if sent.unit == "rad/s" else sent.rotor_speed  # signs are of the spin
            ends = _at_ends((commands - low) / (high - low)) if np.isfinite(high).all() else None
            return Thrusts(known.time, model.vehicle.geometry()[1].c_f * known.rotor_speed**2, rotors, ends)
    if sent.unit == "rad/s":
        return Thrusts(sent.time, sent.rotor_speed**2, rotors)
    (low, high), factor, assumed = _curve(flight, sent)
    u = (sent.rotor_speed - low) / (high - low)
    limits = None if assumed else _at_ends(u)
    u = np.maximum(u, 0.0)  # below zero there is no thrust
    return Thrusts(sent.time, factor * u**2 + (1.0 - factor) * u, rotors, limits, factor)


def _at_ends(u: Array, margin: float = 0.01) -> tuple[Mask, Mask]:
    """Where commands from 0 to 1 are at the smallest, and at the largest: of the motors, whatever the battery gives.

    Within a `margin`: autopilots log single precision and whole microseconds, 0.001 of the range at best.
    """
    return u <= margin, u >= 1.0 - margin


def _curve(flight: Flight, sent: ActuatorSeries) -> tuple[tuple[float, float], float, bool]:
    """Ends of the commands, the factor of their curve, and whether the ends are assumed: no parameter tells them, or
    one is none that can be, as in a damaged log.
    """  # noqa: D205
    autopilot = flight.autopilot
    parameters = {} if autopilot is None else autopilot.parameters
    keys: Mapping[str, Sourced] = {}
    with suppress(ModelError):
        if autopilot is not None and autopilot.name == "ArduPilot" and sent.unit == "pwm":
            keys = ardupilot.command_of(parameters).keys
        elif parameters and sent.unit in ("pwm", "normalised"):
            keys = px4.command_of(parameters, sent.unit).keys
    if not keys and sent.unit == "normalised":
        return (0.0, 1.0), 1.0, bool(parameters)
    if not keys:
        return (USUAL_PULSES if are_pulses(sent.rotor_speed).all() else (0.0, 65535.0)), 1.0, True
    low, high = keys["range"].value if "range" in keys else (0.0, 1.0)
    assumed = not low < high or ("range" in keys and keys["range"].assumed)
    return (USUAL_PULSES if not low < high else (float(low), float(high))), float(keys["factor"].value), assumed


def rotors_of(flight: Flight, model: Model | None = None) -> tuple[RotorPlace, ...]:
    """The rotors that a log commands, by the model or by the autopilot's parameters; else their names alone."""
    assert flight.actuators is not None
    count = flight.actuators.rotor_speed.shape[1]
    unknown = tuple(RotorPlace(f"M{number + 1}") for number in range(count))
    if model is not None and model.vehicle.has_rotors:
        arms, rotors = model.vehicle.geometry()
        names = [model.vehicle.rotor_name(k) for k in range(len(rotors))]
        places = [tuple(map(float, arms.position_B[arm] - model.vehicle.body.com_B)) for arm in rotors.arm]
        known = list(zip(names, places, np.sign(rotors.spin).astype(int).tolist(), strict=True))
    else:
        known = [(r.name, r.position_B.value, 0 if r.spin.assumed else r.spin.value) for r in motors_of(flight)]
    reach = max((float(np.hypot(place[0], place[1])) for _, place, _ in known), default=0.0)
    if len(known) != count or not 0.0 < reach < np.inf:
        return unknown
    return tuple(RotorPlace(name, p[0] / reach, p[1] / reach, int(spin) or None) for name, p, spin in known)
