"""A designed flight: its segments, what it should separate, and how it went on the plant."""

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from wrenchgap.flight.result import Result
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.design.manoeuvres import SEEDED, Limits
from wrenchgap.learn.design.separability import Separability
from wrenchgap.plant.model import Model
from wrenchgap.plant.trajectory.file import ANGLES, TrajectoryFile
from wrenchgap.plant.trajectory.maneuvers import Move, Moves
from wrenchgap.plant.wrench_model import ModelEffect


@dataclass(frozen=True)
class Segment:
    """One manoeuvre of a flight."""

    name: str
    vigour: float
    azimuth: float = 0.0

    def __str__(self) -> str:
        turned = self.azimuth and self.name not in SEEDED
        return f"{self.name} towards {np.degrees(self.azimuth):.0f} deg" if turned else self.name


@dataclass(frozen=True)
class Flown:
    """A flight on the plant with `truth` hidden: what it measured, and how it went.

    `separation` by imitator: that of the two fits on this flight. `tilt_max` [rad], `speed_max` [m/s], `rotor_max`
    (share of the largest rotor speed; 0 without rotors), errors [m], [rad] are the largest of the flight.
    """

    truth: str
    separation: dict[str, float]
    tilt_max: float
    speed_max: float
    rotor_max: float
    position_error: float
    attitude_error: float


@dataclass(frozen=True, repr=False)
class Design(Result):
    """A designed flight: `expected` on it, `before` on the given log (or a hover as long), `flown` on the plant."""

    effects: tuple[ModelEffect, ...]
    file: TrajectoryFile
    segments: tuple[Segment, ...]
    limits: Limits
    before: Separability
    baseline: str
    expected: Separability
    flown: tuple[Flown, ...]
    tried: int
    model: Model
    flights: tuple[OpenFlight, ...] = ()

    @property
    def trajectory(self) -> Moves:
        """The reference."""
        return self.file.trajectory

    def simulated(self, truth: str, imitator: str) -> float:
        """The separation of a direction on the plant."""
        return next((f.separation[imitator] for f in self.flown if f.truth == truth), float("nan"))

    @cached_property
    def separable(self) -> bool:
        """Whether every direction that counts is told apart, as expected and on the plant."""
        return not self.alike

    @cached_property
    def alike(self) -> tuple[tuple[str, str], ...]:
        """Pairs of effects that the flight does not tell apart, as expected or on the plant."""
        least = SIGNIFICANCE.indistinct
        told = [d.told and self.simulated(d.truth, d.imitator) >= least for d in self.expected.counting]
        pairs = [tuple(sorted((d.truth, d.imitator), key=self.expected.names.index)) for d in self.expected.counting]
        return tuple(dict.fromkeys((one, other) for (one, other), apart in zip(pairs, told, strict=True) if not apart))


def rounded(move: Move) -> Move:
    """A move with numbers that a person would write: milliseconds, millimetres, hundredths of a degree."""
    values: dict[str, object] = {}
    for item in fields(move):
        value = getattr(move, item.name)
        if item.name in ANGLES:
            degrees = round(float(np.degrees(value)), 2)
            values[item.name] = float(np.radians(degrees % 360.0 if item.name == "azimuth" else degrees))
        elif isinstance(value, float):
            values[item.name] = round(value, 4)
        elif item.name == "by":
            values[item.name] = tuple(round(float(v), 4) for v in value)
    return replace(move, **values)  # type: ignore[arg-type]
