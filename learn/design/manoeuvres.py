"""Manoeuvres from which a flight is designed, and the limits that they keep.

A manoeuvre fills `length` seconds, begins and ends at rest at home, and is scaled by its vigour (0 to 1) and turned by
an azimuth. What it is good for follows from what excites each effect (docs/effects/README.md): yaw and tilt turn E
against B, several azimuths show which arm is meant, rates and broadband motion show lags and inertia, speed shows drag,
a height scan shows the ground.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.arguments import check_types
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.controller import pushes_along_z_only
from wrenchgap.plant.effects.com_offset import span
from wrenchgap.plant.state import Commands
from wrenchgap.plant.trajectory.maneuvers import SHAKEN, Move, Shake, Shift, Swing, Tilt, Turn, Vector
from wrenchgap.plant.trajectory.shapes import QUINTIC_PEAK
from wrenchgap.plant.vehicle import GRAVITY, Vehicle


@dataclass(frozen=True)
class ManoeuvreSettings:
    """What a manoeuvre may ask for."""

    clearance: float = 0.05
    """Least distance of any part from the floor, the ceiling and the walls [m]."""
    home_height: float = 1.6
    """Height at which flights start, where the room allows it [m]."""
    acceleration: float = 4.0
    """Largest acceleration that a manoeuvre asks for [m/s^2]."""
    rounds: float = 2.5
    """Least number of oscillations that fill a manoeuvre."""
    at_limit: float = 1e-3
    """Largest share of commands in which an actuator may be at its limit."""
    largest_error: tuple[float, float] = (0.25, np.radians(15.0))
    """Largest tracking error of a flight that counts as flown: position [m], attitude [rad]."""


MANOEUVRES = ManoeuvreSettings()


TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Limits:
    """What a flight must keep: `room`, tilt [rad] of body z, and speed [m/s].

    The free room (x, y, z) [m] is around home with its floor at z = 0; every part of the vehicle must stay in it.
    """

    room: Vector = (4.0, 4.0, 3.0)
    tilt: float = float(np.radians(60.0))
    speed: float = 2.0

    def __post_init__(self) -> None:
        check_types(type(self), vars(self))
        if min(self.room) <= 0 or not np.all(np.isfinite(self.room)):
            raise UsageError(f"room: got {self.room}, expected three positive lengths in metres")
        if not 0.0 < self.tilt <= np.pi:
            tilt = np.degrees(self.tilt)
            raise UsageError(f"largest tilt: got {tilt:g} deg, expected more than 0 and at most 180 deg")
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
    return span(vehicle) + (0.0 if vehicle.rotors is None else float(vehicle.rotors.radius.max()))


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
    margin = size + MANOEUVRES.clearance + 0.1
    x, y = (0.5 * side - margin for side in limits.room[:2])
    tilts = not pushes_along_z_only(vehicle)
    lowest = MANOEUVRES.clearance + 0.1 + size * float(np.sin(min(inside.tilt, 0.5 * np.pi)))
    highest = limits.room[2] - margin
    if min(x, y) < 0 or highest < lowest:
        raise UsageError(
            f"room: {vehicle.name} reaches {size:.2f} m from its middle; a room of "
            f"{' x '.join(f'{side:g}' for side in limits.room)} m leaves no place to tilt; give a larger --room or a "
            "smaller --max-tilt"
        )
    height = round(float(np.clip(min(MANOEUVRES.home_height, 0.5 * limits.room[2]), lowest, highest)), 2)
    steepest = np.inf if tilts else GRAVITY * float(np.tan(0.8 * inside.tilt))
    acceleration = min(MANOEUVRES.acceleration, steepest)
    down, up = height - (MANOEUVRES.clearance + 0.1), highest - height
    return Space((0.0, 0.0, height), x, y, down, up, 0.98 * inside.tilt, inside.speed, acceleration, tilts)


@dataclass(frozen=True)
class Task:
    """What a manoeuvre is to fill: `length` [s] of a space, with a vigour (0 to 1), turned by an azimuth [rad]."""

    length: float
    room: Space
    vigour: float
    azimuth: float

    def tilt(self, start: float, length: float, azimuth: float = 0.0, sweep: float = 0.0) -> Tilt:
        """A tilt that is held, as far as vigour and space allow, `azimuth` from the task's."""
        angle = self.vigour * self.room.tilt
        return Tilt(start, length, angle, self.azimuth + azimuth, _ramp(angle, length), sweep)

    def swing(self, by: Array, phase: float = 0.0, fade: float = 2.0) -> list[Swing] | None:
        """An oscillation along `by` (3,) [m], at most by that much, as fast as speed and acceleration allow.

        Smaller where it would not come round `MANOEUVRES.rounds` times.
        """
        fastest, hardest = 0.9 * self.vigour * self.room.speed, 0.8 * self.vigour * self.room.acceleration
        far, slowest = float(np.linalg.norm(by)), self.length / MANOEUVRES.rounds / TURN
        size = min(far, fastest * slowest, hardest * slowest**2)
        if size < 0.05:
            return None
        period = TURN * max(size / fastest, np.sqrt(size / hardest))
        x, y, z = (float(v) for v in size / far * by)
        return [Swing(0.0, self.length, (x, y, z), float(period), phase, min(fade, self.length / 3.0))]

    def shake(
        self, size: float, angle_deg: float, low: float, high: float, axes: tuple[str, ...] = (), ramp: float = 1.0
    ) -> Shake:
        """Broadband motion of `axes` (default all) from `low` to `high` [Hz]; `size` [m], `angle_deg` at full vigour.

        Another azimuth means other phases.
        """
        known = axes or (SHAKEN if self.room.tilts else ("x", "y", "z", "yaw"))
        size, angle = self.vigour * size, self.vigour * np.radians(angle_deg)
        seed = round(float(np.degrees(self.azimuth))) % 360
        return Shake(0.0, self.length, size, angle, low, high, known, ramp, seed)


def _ramp(angle: float, length: float, acceleration: float = 1.6) -> float:
    """Time of a quintic slope to `angle` with this peak acceleration [rad/s^2], at most a third of `length`."""
    return float(min(np.sqrt(QUINTIC_PEAK * angle / acceleration), length / 3.0))


def _rush(task: Task) -> Sequence[Move] | None:
    towards = np.array([np.cos(task.azimuth), np.sin(task.azimuth), 0.0])
    reach = min(task.room.x / max(abs(towards[0]), 1e-9), task.room.y / max(abs(towards[1]), 1e-9))
    return task.swing(reach * towards)


def _circle(task: Task) -> Sequence[Move] | None:
    across, along, _ = 0.9 * min(task.room.x, task.room.y) * np.eye(3)
    x, y = task.swing(across, 0.0, 4.0), task.swing(along, 0.5 * np.pi, 4.0)
    return None if x is None or y is None else [*x, *y]


def _with(moves: Sequence[Move] | None, *more: Move) -> Sequence[Move] | None:
    return None if moves is None else [*moves, *more]


def _scan(task: Task) -> Sequence[Move] | None:
    depth = (0.8 + 0.2 * task.vigour) * task.room.down
    ramp = max(1.875 * depth / (0.9 * task.vigour * task.room.speed), 0.35 * task.length)
    if depth < 0.2 or ramp > 0.5 * task.length:
        return None
    return [Shift(0.0, task.length, (0.0, 0.0, -depth), ramp)]


def _lean_turn(task: Task) -> Sequence[Move]:
    tilt = task.tilt(0.0, task.length)
    return [tilt, Turn(0.5 * tilt.ramp, task.length - tilt.ramp, TURN)]


def _steps(task: Task) -> Sequence[Move]:
    each, angle = task.length / 4.0, min(0.5 * task.room.tilt, np.radians(25.0)) * task.vigour
    ramp = _ramp(angle, each, 8.0)
    return [Tilt(k * each, each, angle, task.azimuth + 0.5 * np.pi * k, ramp) for k in range(4)]


def _lean_shake(task: Task) -> Sequence[Move]:
    angle = max(task.vigour * task.room.tilt - np.radians(6.0), np.radians(5.0))
    tilt = Tilt(0.0, task.length, angle, task.azimuth, _ramp(angle, task.length), 0.0)
    return [tilt, task.shake(0.03, 4.0, 0.3, 3.0)]


SEEDED = ("slow shake", "fast shake", "yaw shake")
"""Manoeuvres whose azimuth only means other phases."""
Manoeuvre = Callable[[Task], Sequence[Move] | None]
"""Moves that start at zero, or None where it cannot be flown."""
_ANY: dict[str, Manoeuvre] = {
    "hover": lambda task: [],
    "turn": lambda task: [Turn(0.0, task.length, TURN)],  # yaw, while level
    "rush": _rush,  # to and fro at speed
    "circle": _circle,  # at speed
    "circle and turn": lambda task: _with(_circle(task), Turn(0.0, task.length, TURN)),
    # up and down, thrust above and below the weight
    "heave": lambda task: task.swing(np.array([0.0, 0.0, min(0.5, task.room.down, task.room.up)])),
    "height scan": _scan,  # down to the floor and back
    "slow shake": lambda task: [
        task.shake(min(0.1, 0.5 * task.room.x, 0.5 * task.room.y), 8.0, 0.1, 1.4, ramp=min(2.0, task.length / 4.0))
    ],
    "fast shake": lambda task: [task.shake(0.02, 3.0, 1.0, 4.0)],
    "yaw shake": lambda task: [task.shake(0.0, 15.0, 0.3, 2.5, ("yaw",))],
}
_FREE: dict[str, Manoeuvre] = {  # for vehicles that tilt as they like
    "lean": lambda task: [task.tilt(0.0, task.length)],  # a tilt that is held
    # tilts to opposite sides
    "lean both ways": lambda task: [task.tilt(k * 0.5 * task.length, 0.5 * task.length, k * np.pi) for k in (0, 1)],
    # a tilt whose azimuth goes once round while the heading stays
    "lean all round": lambda task: [task.tilt(0.0, task.length, sweep=TURN)],
    "lean and turn": _lean_turn,  # a full turn of yaw while tilted
    "tilt steps": _steps,  # quick, in four directions
    "lean and shake": _lean_shake,
    "lean and rush": lambda task: _with(_rush(task), task.tilt(0.0, task.length)),
}


def available(room: Space) -> dict[str, Manoeuvre]:
    """The manoeuvres for a vehicle, by name."""
    return {**_ANY, **_FREE} if room.tilts else dict(_ANY)


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
    if low < MANOEUVRES.clearance:
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
    """Actuators that are at their limits (times `use`) in more than `MANOEUVRES.at_limit` of the commands, in words."""
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
    return [f"is at {what} in {100 * s:.1f} % of the commands" for what, s in shares.items() if s > MANOEUVRES.at_limit]
