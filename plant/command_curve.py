"""From motor commands of an autopilot to thrust: a curve over the command, and the effect of the battery.

With u = (command - range_0) / (range_1 - range_0), or the command as it is logged in a bench table, rotor r makes

    T = f(u) (V / V_0)^k   [N]        or turns with        Omega = g(u) (V / V_0)^k   [rad/s]

f and g are a polynomial or a bench table, k = 0 where nothing is said of the battery. All other code sees the speed

    Omega_r = sqrt(T / c_f,r),

at which the nominal rotor (`plant.actuation`) makes that thrust: where no speed is known it is a name for the thrust.
A model factor is a polynomial, T = T_max [f u^2 + (1 - f) u].
Sources: that form is PX4's THR_MDL_FAC and ArduPilot's MOT_THST_EXPO (both projects' parameter references); thrust
with the power of voltage: a motor's speed in proportion to voltage at a given duty, and thrust to its square.
"""

import shlex
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from wrenchgap.flight.check import UNPOWERED
from wrenchgap.flight.command_units import ROTOR_WORDS
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.plant.vehicle import Vehicle

CommandUnit = Literal["normalised", "pwm"]
"""A share of full throttle, or a pulse width [us]."""
Gives = Literal["thrust", "speed"]


@dataclass(frozen=True, eq=False)
class Polynomial:
    """c_0 + c_1 u + c_2 u^2 + ..., `coefficients` from the constant on, in N or rad/s."""

    coefficients: Array

    def __call__(self, u: Array, voltage: Array | None) -> Array:
        """Values (N, R) at u (N, R)."""
        return np.asarray(np.polynomial.polynomial.polyval(u, self.coefficients))


@dataclass(frozen=True, eq=False)
class Bench:
    """Measured points: `command` (K,) in the log's unit, `value` (K,) in N or rad/s, `voltage` (K,) [V] or None.

    Linear between commands, and between the voltages at which curves were measured; held at both ends.
    """

    command: Array
    value: Array
    voltage: Array | None = None

    def __call__(self, command: Array, voltage: Array | None) -> Array:
        """Values (N, R) at commands (N, R) and voltages (N,), or at the mean voltage of the bench."""
        if self.voltage is None:
            return _interpolated(command, self.command, self.value)
        levels = np.unique(self.voltage)
        groups = self.voltage == levels[:, None]
        curves = np.stack([_interpolated(command, self.command[mine], self.value[mine]) for mine in groups])
        at = np.full(len(command), levels.mean()) if voltage is None else np.clip(voltage, levels[0], levels[-1])
        upper = np.clip(np.searchsorted(levels, at), 1, len(levels) - 1) if len(levels) > 1 else np.zeros(len(at), int)
        lower = np.maximum(upper - 1, 0)
        step = np.maximum(levels[upper] - levels[lower], 1e-12)
        share = ((at - levels[lower]) / step)[:, None] if len(levels) > 1 else np.zeros((len(at), 1))
        rows = np.arange(len(at))
        return np.asarray((1.0 - share) * curves[lower, rows] + share * curves[upper, rows])


def _interpolated(at: Array, knots: Array, values: Array) -> Array:
    order = np.argsort(knots)
    return np.interp(at, knots[order], values[order])


@dataclass(frozen=True, eq=False)
class CommandCurve:
    """The rotor commands of a vehicle's logs: their unit, and the curve to thrust or speed.

    `ends` are the commands at u = 0 and u = 1. `voltage` are V_0 [V] and k, None where the battery has no effect or is
    unknown. `source` says in words where the curve comes from. Voltages below `least_charge` V_0 are raised to it: no
    motor turns there, so they are no readings of a battery.
    """

    unit: CommandUnit
    gives: Gives
    law: Polynomial | Bench
    ends: tuple[float, float] = (0.0, 1.0)
    voltage: tuple[float, float] | None = None
    source: str = ""
    least_charge: float = 0.1

    def speeds(self, command: Array, voltage: Array | None, vehicle: Vehicle) -> Array:
        """Rotor speeds (N, R) [rad/s] of commands (N, R), at voltages (N,) [V] where they are known."""
        _, rotors = vehicle.geometry()
        low, high = self.ends
        at = command if isinstance(self.law, Bench) else np.maximum((command - low) / (high - low), 0.0)
        value = np.maximum(self.law(at, voltage), 0.0)
        if self.voltage is not None and voltage is not None:
            nominal, exponent = self.voltage
            value = value * (np.maximum(voltage / nominal, self.least_charge) ** exponent)[:, None]
        return value if self.gives == "speed" else np.asarray(np.sqrt(value / rotors.c_f))

    @property
    def span(self) -> tuple[float, float]:
        """The smallest and the largest command of the curve."""
        return (
            (float(self.law.command.min()), float(self.law.command.max())) if isinstance(self.law, Bench) else self.ends
        )

    def full_speed(self, voltage: float | None, vehicle: Vehicle) -> Array:
        """The rotor speeds (R,) [rad/s] of the largest command, at a voltage [V] where it is known."""
        _, rotors = vehicle.geometry()
        full = np.full((1, len(rotors)), self.span[1])
        return np.asarray(self.speeds(full, None if voltage is None else np.array([voltage]), vehicle)[0])

    @property
    def uses_voltage(self) -> bool:
        """Whether the voltage of the battery has an effect."""
        measured = isinstance(self.law, Bench) and self.law.voltage is not None and np.ptp(self.law.voltage) > 0.0
        return bool(measured) or (self.voltage is not None and self.voltage[1] != 0.0)

    def share_outside(self, command: Array) -> float:
        """Share of commands that lie outside a bench table, where its ends are held."""
        if not isinstance(self.law, Bench):
            return 0.0
        return float(np.mean((command < self.law.command.min()) | (command > self.law.command.max())))


def as_speeds(found: Flight, curve: CommandCurve | None, vehicle: Vehicle, model: str) -> Flight:
    """The flight with rotor commands in rad/s, where the `curve` of a `model` says how, and a note that says so.

    A flight whose commands are speeds already, or a model without [command] or rotors, is left as it is. A normalised
    wrench beside converted rotor commands is left out: the rotors say the same in newtons. Raises LogError where log
    and model file are of different units.
    """
    sent = found.actuators
    if sent is None or sent.unit == "rad/s" or curve is None or not vehicle.has_rotors:
        return found
    if sent.unit != curve.unit:
        if unpowered := next((str(note) for note in found.notes if str(note).endswith(UNPOWERED)), None):
            raise LogError(f"{found.path.name}: {unpowered}")
        raise LogError(
            f"{found.path.name}: the rotor commands of {sent.topic} are {ROTOR_WORDS[sent.unit]}, and [command] of "
            f"{model} is for {ROTOR_WORDS[curve.unit]}; is it the model of this vehicle? Else set its unit and curve, "
            "or map another topic with --topic rotor_speed=/your/topic"
        )
    _, rotors = vehicle.geometry()
    if sent.rotor_speed.shape[1] != len(rotors):
        raise LogError(
            f"{found.path.name}: {sent.topic} has {sent.rotor_speed.shape[1]} rotor commands, {vehicle.name} has "
            f"{len(rotors)} rotors; map the columns with --topic "
            f"{shlex.quote(f'rotor_speed={sent.topic}[...]')} or use another model"
        )
    battery = found.battery
    voltage = None if battery is None else np.asarray(np.interp(sent.time, battery.time, battery.voltage))
    speeds = curve.speeds(sent.rotor_speed, voltage, vehicle)
    origin = f" ({curve.source})" if curve.source else ""
    notes = [
        *found.notes,
        f"{found.name}: rotor commands of {sent.topic} are {ROTOR_WORDS[sent.unit]}; {curve.gives} by [command] of "
        f"{model}{origin}.",
    ]
    if curve.uses_voltage and voltage is None:
        notes.append(f"{found.name}: no battery voltage in the log; the curve is taken at its nominal voltage.")
    if (share := curve.share_outside(sent.rotor_speed)) > 0.001:
        notes.append(
            f"{found.name}: {100.0 * share:.1f} % of the rotor commands lie outside the bench table: its ends are held."
        )
    for role in ("commanded", "desired"):
        if (series := getattr(found, role)) is not None and series.unit == "normalised":
            found = replace(found, **{role: None})  # type: ignore[arg-type]
    return replace(found, actuators=replace(sent, rotor_speed=speeds, unit="rad/s"), notes=tuple(notes))
