"""Trajectories as sums of maneuvers (moves): tilt, turn, shift, swing, shake, each over its own interval.

    p_D(t)  = home + sum of shifts, swings and shakes                                  in E
    R_ED(t) = R_z(psi + phi) R_y(s) R_z(-phi) R_e

psi is the yaw of all turns, s the tilt, phi the azimuth towards which body z leans (seen in the frame that turns with
the yaw), R_e = R_z R_y R_x the deflection of the shakes. Every move begins and ends at rest and, but for a turn, where
it began; so any sequence of moves is a smooth flight with consistent derivatives, from which one can also take a move
away. For rotations R = R_1 R_2 with rates in their own frames,

    omega = R_2^T omega_1 + omega_2,    omega_dot = R_2^T omega_dot_1 - omega_2 x (R_2^T omega_1) + omega_dot_2.

A vehicle that pushes along body z only takes its attitude from the thrust (`plant.trajectory.Flat`): its moves may
not tilt. `plant.trajectory.file` reads and writes these trajectories.
"""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.trajectory.reference import (
    Profile,
    Reference,
    Rotation,
    Trajectory,
    bump,
    composed,
    cosine,
    euler_attitude,
    product,
    quintic,
    scaled,
    sine,
)
from wrenchgap.plant.trajectory.shapes import Flat, Multisine

Vector = tuple[float, float, float]

SHAKEN = ("x", "y", "z", "roll", "pitch", "yaw")
"""Axes of a shake, in the order of `Multisine`."""
SHORTEST = 0.1
"""Of moves, ramps, fades and periods [s]: no vehicle follows faster ones, and `replay.readiness` samples them."""
HIGHEST_HZ = 20.0
"""Of a shake: no attitude loop follows faster ones, and each harmonic takes memory and time."""
_Y, _Z = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Move:
    """A maneuver with `start` and `duration` [s]. A subclass names its `kind` and checks its values."""

    kind: ClassVar[str]
    twice: ClassVar[str] = ""
    """The length [s] that comes twice within the duration, at the beginning and at the end."""

    start: float
    duration: float

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name != "axes" and not np.all(np.isfinite(np.asarray(value, dtype=float))):
                raise UsageError(f"{self.kind}: {item.name} is {value}, expected finite numbers")
        if self.start < 0 or self.duration < SHORTEST:
            raise UsageError(
                f"{self.kind}: starts at {self.start:g} s and lasts {self.duration:g} s; a move starts at 0 s or later "
                f"and lasts {SHORTEST:g} s or longer"
            )
        if self.twice and not SHORTEST <= getattr(self, self.twice) <= 0.5 * self.duration + 1e-9:
            raise UsageError(
                f"{self.kind}: {self.twice} is {getattr(self, self.twice):g} s; it comes twice within "
                f"{self.duration:g} s, so expected {SHORTEST:g} to {0.5 * self.duration:g} s"
            )

    @property
    def stop(self) -> float:
        """End of the move [s]."""
        return self.start + self.duration


@dataclass(frozen=True)
class Tilt(Move):
    """Body z leans by `angle` [rad] towards `azimuth` [rad]: up within `ramp` [s], held, and back within `ramp`.

    Azimuth 0 is forward, 90 deg left, in the frame that turns with the yaw. While it is held, the azimuth moves on by
    `sweep` [rad]; the heading stays.
    """

    kind, twice = "tilt", "ramp"

    angle: float
    azimuth: float = 0.0
    ramp: float = 2.0
    sweep: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 < self.angle <= np.pi:
            raise UsageError(f"tilt: angle is {np.degrees(self.angle):g} deg, expected more than 0 and at most 180 deg")

    def lean(self, time: Array) -> Profile:
        """The tilt s."""
        return scaled(bump(time, self.start, self.stop, self.ramp), self.angle)

    def direction(self, time: Array) -> Profile:
        """The azimuth phi while the tilt lasts, zero else: there it jumps, and the tilt is zero."""
        held = max(self.duration - 2.0 * self.ramp, 1e-6)
        value, rate, change = scaled(quintic(time, self.start + self.ramp, held), self.sweep)
        inside = (time >= self.start) & (time <= self.stop)
        return inside * (self.azimuth + value), inside * rate, inside * change


@dataclass(frozen=True)
class Turn(Move):
    """The yaw turns by `angle` [rad] (positive: to the left) within the duration, and stays there."""

    kind = "turn"

    angle: float

    def yaw(self, time: Array) -> Profile:
        """The yaw that this turn adds."""
        return scaled(quintic(time, self.start, self.duration), self.angle)


@dataclass(frozen=True)
class Shift(Move):
    """Goes `by` (3,) [m] in E within `ramp` [s], stays, and comes back within `ramp`."""

    kind, twice = "shift", "ramp"

    by: Vector
    ramp: float = 2.0

    def position(self, time: Array) -> Profile:
        """Displacement (N, 3) in E."""
        return scaled(bump(time, self.start, self.stop, self.ramp), np.array(self.by))


@dataclass(frozen=True)
class Swing(Move):
    """Oscillates by +-`by` (3,) [m] in E with `period` [s]: by w(t) sin(2 pi t / period + phase), phase in rad.

    w fades in and out within `fade` [s]. Two swings with phases a quarter apart make a circle.
    """

    kind, twice = "swing", "fade"

    by: Vector
    period: float
    phase: float = 0.0
    fade: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.period < SHORTEST:
            raise UsageError(f"swing: period is {self.period:g} s, expected {SHORTEST:g} s or longer")

    def position(self, time: Array) -> Profile:
        """Displacement (N, 3) in E."""
        rate = 2.0 * np.pi / self.period
        angle = (rate * (time - self.start), np.full_like(time, rate), np.zeros_like(time))
        s, c = sine(angle, 1.0), cosine(angle, 1.0)
        value, slope, change = (np.cos(self.phase) * a + np.sin(self.phase) * b for a, b in zip(s, c, strict=True))
        window = bump(time, self.start, self.stop, self.fade)
        return scaled(product(window, (value, slope, change)), np.array(self.by))


@dataclass(frozen=True)
class Shake(Move):
    """A multisine on some axes (`plant.trajectory.Multisine`): harmonics between `low_hz` and `high_hz`.

    Deflections up to `size` [m] on x, y, z of E and up to `angle` [rad] on roll, pitch, yaw; flat in velocity.
    """

    kind, twice = "shake", "fade"

    size: float
    angle: float
    low_hz: float
    high_hz: float
    axes: tuple[str, ...] = SHAKEN
    fade: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        unknown = [a for a in self.axes if a not in SHAKEN]
        if unknown:
            raise UsageError(f"shake: no axis is called {unknown[0]!r}; available: {', '.join(SHAKEN)}")
        if not 0.0 < self.low_hz < self.high_hz <= HIGHEST_HZ:
            raise UsageError(
                f"shake: the band is {self.low_hz:g} to {self.high_hz:g} Hz; expected low_hz above 0 and below "
                f"high_hz, and that {HIGHEST_HZ:g} Hz at most"
            )
        if self.seed < 0 or self.size < 0 or not 0.0 <= self.angle < 0.5 * np.pi:
            raise UsageError("shake: size and seed must not be negative, and the angle lie between 0 and 90 deg")
        self._multisine()

    def _multisine(self) -> Multisine:
        band = (self.low_hz, self.high_hz)
        return _multisine(self.duration, self.size, self.angle, band, fade=self.fade, seed=self.seed)

    @property
    def harmonics(self) -> int:
        """How many there are, of all axes."""
        return self._multisine().harmonics

    def deflection(self, time: Array) -> Profile:
        """x, y, z [m], roll, pitch, yaw [rad] (N, 6)."""
        local = time - self.start
        inside = np.flatnonzero((local >= 0.0) & (local <= self.duration))
        value, rate, change = (np.zeros((len(time), len(SHAKEN))) for _ in range(3))
        for out, found in zip((value, rate, change), self._multisine().at(local[inside]), strict=True):
            out[inside] = found * np.isin(SHAKEN, self.axes)
        return value, rate, change


_multisine = lru_cache(maxsize=64)(Multisine)

KINDS: dict[str, type[Move]] = {cls.kind: cls for cls in (Tilt, Turn, Shift, Swing, Shake)}
"""Every kind of move by its name."""


@dataclass(frozen=True)
class Moves(Trajectory):
    """A flight of `duration` [s] that starts at `home` (3,) [m] with the moves given.

    `follows_thrust`: body z points along the thrust, as fixed rotors need it. Raises UsageError for a move that
    ends after the flight, tilts that overlap, and tilts where the attitude follows the thrust.
    """

    duration: float
    home: Vector
    moves: tuple[Move, ...] = ()
    follows_thrust: bool = False

    def __post_init__(self) -> None:
        for number, move in enumerate(self.moves):
            if move.stop > self.duration + 1e-9:
                raise UsageError(
                    f"moves[{number}] ({move.kind}): ends at {move.stop:g} s, after the flight of {self.duration:g} s"
                )
            tilting = isinstance(move, Tilt) or (isinstance(move, Shake) and {"roll", "pitch"} & set(move.axes))
            if self.follows_thrust and tilting:
                raise UsageError(
                    f"moves[{number}] ({move.kind}): the attitude follows the thrust and cannot be tilted; "
                    "leave the move (or its axes roll and pitch) out"
                )
        tilts = sorted((m for m in self.moves if isinstance(m, Tilt)), key=lambda m: m.start)
        for first, second in itertools.pairwise(tilts):
            if second.start < first.stop - 1e-9:
                raise UsageError(
                    f"two tilts overlap: one ends at {first.stop:g} s, the next starts at {second.start:g} s"
                )

    def at(self, time: Array) -> Reference:
        """The sum of the moves."""
        if self.follows_thrust:
            return Flat(replace(self, follows_thrust=False)).at(time)
        shaken = _sum((m.deflection(time) for m in self.moves if isinstance(m, Shake)), (len(time), 6))
        moved = _sum((m.position(time) for m in self.moves if isinstance(m, Shift | Swing)), (len(time), 3))
        p, v, a = (one + other[:, :3] for one, other in zip(moved, shaken, strict=True))
        angles = (part[:, 3:] for part in shaken)
        attitude = composed(self._attitude(time), euler_attitude(*angles))
        return Reference(time, p + np.array(self.home), v, a, *attitude)

    def _attitude(self, time: Array) -> Rotation:
        """R_z(psi + phi) R_y(s) R_z(-phi)."""
        psi = _sum((m.yaw(time) for m in self.moves if isinstance(m, Turn)), time.shape)
        s = _sum((m.lean(time) for m in self.moves if isinstance(m, Tilt)), time.shape)
        phi = _sum((m.direction(time) for m in self.moves if isinstance(m, Tilt)), time.shape)
        heading = (psi[0] + phi[0], psi[1] + phi[1], psi[2] + phi[2])
        back = (-phi[0], -phi[1], -phi[2])
        return composed(composed(axis_rotation(_Z, heading), axis_rotation(_Y, s)), axis_rotation(_Z, back))


def _sum(profiles: Iterable[Profile], shape: tuple[int, ...]) -> Profile:
    value, rate, change = (np.zeros(shape) for _ in range(3))
    for one in profiles:  # each is gone before the next is made
        for out, part in zip((value, rate, change), one, strict=True):
            out += part
    return value, rate, change


def axis_rotation(axis: Array, angle: Profile) -> Rotation:
    """Rotation about a fixed axis (3,) by a profile (N,) [rad]."""
    value, rate, change = scaled(angle, axis)
    return so3.exp(value), rate, change
