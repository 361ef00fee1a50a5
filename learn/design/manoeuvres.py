"""Manoeuvres from which a flight is designed, and the limits that they keep.

A manoeuvre fills `length` seconds, begins and ends at rest at home, and is scaled by its vigour (0 to 1) and turned by
an azimuth. What it is good for follows from what excites each effect (docs/effects/README.md): yaw and tilt turn E
against B, several azimuths show which arm is meant, rates and broadband motion show lags and inertia, speed shows drag,
a height scan shows the ground.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.controller import pushes_along_z_only
from wrenchgap.plant.effects.com_offset import span
from wrenchgap.plant.moves import SHAKEN, Move, Shake, Shift, Swing, Tilt, Turn, Vector
from wrenchgap.plant.state import Commands
from wrenchgap.plant.vehicle import GRAVITY, Vehicle

CLEARANCE = 0.05
"""Least distance of any part from the floor, the ceiling and the walls [m]."""
HOME_HEIGHT = 1.6
"""Height at which flights start, where the room allows it [m]."""
ACCELERATION = 4.0
"""Largest acceleration that a manoeuvre asks for [m/s^2]."""
TURN = 2.0 * np.pi
ROUNDS = 2.5
"""Least number of oscillations that fill a manoeuvre."""
QUINTIC_ACCELERATION = 10.0 / np.sqrt(3.0)
"""Peak second derivative of a unit quintic of unit length."""
AT_LIMIT = 1e-3
"""Largest share of commands in which an actuator may be at its limit."""
LARGEST_ERROR = (0.25, np.radians(15.0))
"""Largest tracking error of a flight that counts as flown: position [m], attitude [rad]."""


@dataclass(frozen=True)
class Limits:
    """What a flight must keep: the free `room` (x, y, z) [m] around home with its floor at z = 0, in which every part
    of the vehicle must stay, the tilt [rad] of body z, and the speed [m/s].
    """  # noqa: D205

    room: Vector = (4.0, 4.0, 3.0)
    tilt: float = float(np.radians(60.0))
    speed: float = 2.0

    def __post_init__(self) -> None:
        if min(self.room) <= 0 or not np.all(np.isfinite(self.room)):
            raise UsageError(f"room: got {self.room}, expected three positive lengths in metres")
        if not 0.0 < self.tilt <= np.pi:
            raise UsageError(
                f"largest tilt: got {np.degrees(self.tilt):g} deg, expected more than 0 and at most 180 deg"
            )
        if not (np.isfinite(self.speed) and self.speed > 0):
            raise UsageError(f"largest speed: got {self.speed:g} m/s, expected a positive number")

    def tightened(self) -> Limits:
        """Limits for a reference, so that a flight along it keeps these."""
        return replace(self, tilt=0.94 * self.tilt, speed=0.94 * self.speed)


def usual(vehicle: Vehicle) -> Limits:
    """Limits where none are given: 60 deg of tilt for vehicles that push in every direction, 30 deg for others."""
    return Limits(tilt=float(np.radians(30.0 if pushes_along_z_only(vehicle) else 60.0)))


def extent(vehicle: Vehicle) -> float:
    """From the body origin to the tip of the farthest rotor [m]."""
    radius = 0.0 if vehicle.rotors is None else float(vehicle.rotors.radius.max())
    return span(vehicle) + radius


@dataclass(frozen=True)
class Space:
    """How far manoeuvres may go: `x`, `y` from home, `down` and `up` of home [m], tilt [rad], speed, acceleration."""

    home: Vector
    x: float
    y: float
    down: float
    up: float
    tilt: float
    speed: float
    acceleration: float
    tilts: bool


def space(vehicle: Vehicle, limits: Limits) -> Space:
    """The space that the limits leave; UsageError where the vehicle does not fit in."""
    size, inside = extent(vehicle), limits.tightened()
    margin = size + CLEARANCE + 0.1
    x, y = (0.5 * side - margin for side in limits.room[:2])
    tilts = not pushes_along_z_only(vehicle)
    lowest = CLEARANCE + 0.1 + size * float(np.sin(min(inside.tilt, 0.5 * np.pi)))
    highest = limits.room[2] - margin
    if min(x, y) < 0 or highest < lowest:
        raise UsageError(
            f"room: {vehicle.name} reaches {size:.2f} m from its middle; a room of "
            f"{' x '.join(f'{side:g}' for side in limits.room)} m leaves no place to tilt; give a larger --room or a "
            "smaller --max-tilt"
        )
    height = float(np.clip(min(HOME_HEIGHT, 0.5 * limits.room[2]), lowest, highest))
    height = round(height, 2)
    acceleration = ACCELERATION if tilts else min(ACCELERATION, GRAVITY * float(np.tan(0.8 * inside.tilt)))
    level = CLEARANCE + 0.1
    return Space(
        (0.0, 0.0, height),
        x,
        y,
        height - level,
        highest - height,
        0.98 * inside.tilt,
        inside.speed,
        acceleration,
        tilts,
    )


Manoeuvre = Callable[[float, Space, float, float], list[Move] | None]
"""(length [s], space, vigour, azimuth [rad]) -> moves that start at zero, or None where it cannot be flown."""

SEEDED = ("slow shake", "fast shake", "yaw shake")
"""Manoeuvres whose azimuth only means other phases."""
_FREE: dict[str, tuple[Manoeuvre, str]] = {}
_ANY: dict[str, tuple[Manoeuvre, str]] = {}


def _manoeuvre(name: str, words: str, tilts: bool = False) -> Callable[[Manoeuvre], Manoeuvre]:
    def register(made: Manoeuvre) -> Manoeuvre:
        (_FREE if tilts else _ANY)[name] = (made, words)
        return made

    return register


def available(room: Space) -> dict[str, tuple[Manoeuvre, str]]:
    """The manoeuvres for a vehicle, by name, each with what it is."""
    return {**_ANY, **_FREE} if room.tilts else dict(_ANY)


def _ramp(angle: float, length: float, acceleration: float = 1.6) -> float:
    """Time of a quintic slope to `angle` with this peak acceleration [rad/s^2], at most a third of `length`."""
    return float(min(np.sqrt(QUINTIC_ACCELERATION * angle / acceleration), length / 3.0))


def _tilt(start: float, length: float, angle: float, azimuth: float, sweep: float = 0.0) -> Tilt:
    return Tilt(start, length, angle, azimuth, _ramp(angle, length), sweep)


def _swing(length: float, room: Space, vigour: float, by: Array, phase: float = 0.0, fade: float = 2.0) -> Swing | None:
    """An oscillation along `by` (3,) [m], at most by that much, as fast as speed and acceleration allow.

    Smaller where it would not come round `ROUNDS` times.
    """
    fastest, hardest, slowest = 0.9 * vigour * room.speed, 0.8 * vigour * room.acceleration, length / ROUNDS / TURN
    far = float(np.linalg.norm(by))
    size = min(far, fastest * slowest, hardest * slowest**2)
    if size < 0.05:
        return None
    period = TURN * max(size / fastest, np.sqrt(size / hardest))
    x, y, z = (float(v) for v in size / far * by)
    return Swing(0.0, length, (x, y, z), float(period), phase, min(fade, length / 3.0))


@_manoeuvre("hover", "stand still")
def _hover(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    return []


@_manoeuvre("turn", "a full turn of yaw while level")
def _turn(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    return [Turn(0.0, length, 2.0 * np.pi)]


@_manoeuvre("rush", "to and fro at speed")
def _rush(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    towards = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    reach = min(room.x / max(abs(towards[0]), 1e-9), room.y / max(abs(towards[1]), 1e-9))
    swing = _swing(length, room, vigour, reach * towards)
    return None if swing is None else [swing]


@_manoeuvre("circle", "a circle at speed")
def _circle(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    radius = 0.9 * min(room.x, room.y)
    axes = (np.array([radius, 0.0, 0.0]), np.array([0.0, radius, 0.0]))
    phases = (0.0, 0.5 * np.pi)
    swings = [_swing(length, room, vigour, by, phase, 4.0) for by, phase in zip(axes, phases, strict=True)]
    return None if any(s is None for s in swings) else [s for s in swings if s is not None]


@_manoeuvre("circle and turn", "a circle at speed with a full turn of yaw")
def _circle_turn(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    circle = _circle(length, room, vigour, azimuth)
    return None if circle is None else [*circle, Turn(0.0, length, 2.0 * np.pi)]


@_manoeuvre("heave", "up and down, thrust above and below the weight")
def _heave(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    swing = _swing(length, room, vigour, np.array([0.0, 0.0, min(0.5, room.down, room.up)]))
    return None if swing is None else [swing]


@_manoeuvre("height scan", "down to the floor and back")
def _scan(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    depth = (0.8 + 0.2 * vigour) * room.down
    ramp = max(1.875 * depth / (0.9 * vigour * room.speed), 0.35 * length)
    if depth < 0.2 or ramp > 0.5 * length:
        return None
    return [Shift(0.0, length, (0.0, 0.0, -depth), ramp)]


@_manoeuvre("slow shake", "all axes at once, 0.1 to 1.4 Hz")
def _shake(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    size = vigour * min(0.1, 0.5 * room.x, 0.5 * room.y)
    axes = SHAKEN if room.tilts else ("x", "y", "z", "yaw")
    return [Shake(0.0, length, size, vigour * np.radians(8.0), 0.1, 1.4, axes, min(2.0, length / 4.0), _seed(azimuth))]


@_manoeuvre("fast shake", "all axes at once, 1 to 4 Hz")
def _fast_shake(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    axes = SHAKEN if room.tilts else ("x", "y", "z", "yaw")
    return [Shake(0.0, length, vigour * 0.02, vigour * np.radians(3.0), 1.0, 4.0, axes, 1.0, _seed(azimuth))]


@_manoeuvre("yaw shake", "yaw alone, 0.3 to 2.5 Hz")
def _yaw_shake(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    return [Shake(0.0, length, 0.0, vigour * np.radians(15.0), 0.3, 2.5, ("yaw",), 1.0, _seed(azimuth))]


@_manoeuvre("lean", "a tilt that is held", tilts=True)
def _lean(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    return [_tilt(0.0, length, vigour * room.tilt, azimuth)]


@_manoeuvre("lean both ways", "tilts to opposite sides", tilts=True)
def _both(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    half, angle = 0.5 * length, vigour * room.tilt
    return [_tilt(0.0, half, angle, azimuth), _tilt(half, half, angle, azimuth + np.pi)]


@_manoeuvre("lean all round", "a tilt whose azimuth goes once round while the heading stays", tilts=True)
def _all_round(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    return [_tilt(0.0, length, vigour * room.tilt, azimuth, 2.0 * np.pi)]


@_manoeuvre("lean and turn", "a full turn of yaw while tilted", tilts=True)
def _lean_turn(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    tilt = _tilt(0.0, length, vigour * room.tilt, azimuth)
    return [tilt, Turn(0.5 * tilt.ramp, length - tilt.ramp, 2.0 * np.pi)]


@_manoeuvre("tilt steps", "quick tilts in four directions", tilts=True)
def _steps(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    each, angle = length / 4.0, min(0.5 * room.tilt, np.radians(25.0)) * vigour
    ramp = _ramp(angle, each, 8.0)
    return [Tilt(k * each, each, angle, azimuth + 0.5 * np.pi * k, ramp) for k in range(4)]


@_manoeuvre("lean and shake", "all axes at once, 0.3 to 3 Hz, while tilted", tilts=True)
def _lean_shake(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    shake = Shake(0.0, length, vigour * 0.03, vigour * np.radians(4.0), 0.3, 3.0, SHAKEN, 1.0, _seed(azimuth))
    angle = max(vigour * room.tilt - np.radians(6.0), np.radians(5.0))
    return [_tilt(0.0, length, angle, azimuth), shake]


@_manoeuvre("lean and rush", "to and fro at speed while tilted", tilts=True)
def _lean_rush(length: float, room: Space, vigour: float, azimuth: float) -> list[Move] | None:
    rush = _rush(length, room, vigour, azimuth)
    return None if rush is None else [*rush, _tilt(0.0, length, vigour * room.tilt, azimuth)]


def _seed(azimuth: float) -> int:
    """Another azimuth means other phases."""
    return round(float(np.degrees(azimuth))) % 360


def violations(
    vehicle: Vehicle,
    limits: Limits,
    position_E: Array,
    quat_EB: Array,
    velocity_E: Array,
    commands: Commands,
    dt: float,
    use: float = 1.0,
) -> list[str]:
    """What a motion (N samples) or its commands (M samples, `dt` [s] apart) do beyond the limits, in words.

    Actuators may go to the share `use` of what they can.
    """
    size = extent(vehicle)
    tilt = so3.tilt_angle(quat_EB)
    found = []
    for axis, name in enumerate("xy"):
        reach = float(np.abs(position_E[:, axis]).max()) + size
        if reach > 0.5 * limits.room[axis]:
            found.append(f"reaches {reach:.2f} m along {name}, the room ends at {0.5 * limits.room[axis]:g} m")
    low = float((position_E[:, 2] - size * np.sin(np.minimum(tilt, 0.5 * np.pi))).min())
    high = float(position_E[:, 2].max()) + size
    if low < CLEARANCE:
        found.append(f"comes within {low:.2f} m of the floor")
    if high > limits.room[2]:
        found.append(f"reaches a height of {high:.2f} m, the room ends at {limits.room[2]:g} m")
    speed = float(np.linalg.norm(velocity_E, axis=1).max())
    if tilt.max() > limits.tilt:
        found.append(f"tilts by {np.degrees(tilt.max()):.0f} deg, allowed are {np.degrees(limits.tilt):.0f} deg")
    if speed > limits.speed:
        found.append(f"flies at {speed:.2f} m/s, allowed are {limits.speed:g} m/s")
    return found + saturation(vehicle, commands, dt, use)


def saturation(vehicle: Vehicle, commands: Commands, dt: float, use: float = 1.0) -> list[str]:
    """Actuators that are at their limits (times `use`) in more than `AT_LIMIT` of the commands, in words."""
    if not vehicle.has_rotors or commands.rotor_speed is None or commands.tilt is None:
        return []
    arms, rotors = vehicle.geometry()
    speed, tilt = commands.rotor_speed, commands.tilt
    rate = np.abs(np.diff(tilt, axis=0)) / dt
    at = {
        "a rotor's largest speed": np.any(speed >= 0.999 * use * rotors.speed_max, axis=1),
        "a rotor's smallest speed": np.any(speed <= rotors.speed_min / use + 1e-9, axis=1),
        "an arm's largest tilt rate": np.any(rate >= 0.999 * use * arms.tilt_rate_max, axis=1),
        "an arm's range": np.any(arms.tilts & ((tilt >= use * arms.tilt_max) | (tilt <= use * arms.tilt_min)), axis=1),
    }
    shares = {what: float(np.mean(hit)) for what, hit in at.items()}
    return [f"is at {what} in {100 * s:.1f} % of the commands" for what, s in shares.items() if s > AT_LIMIT]
