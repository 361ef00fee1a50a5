"""What was there in a flight, in the catalogue's words."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from wrenchgap.plant.effects import family

Names = frozenset[str]

AIRS = ("rotor_drag", "body_drag", "wind", "axial_inflow", "rotational_drag")
"""Names of what turbulence does to a vehicle; true of a flight in gusts."""

BIASES = ("constant_wrench", "accelerometer_bias")
"""Names of what an accelerometer's bias looks like; a set of names may have one of these besides. None of them may be
firm, but `accelerometer_bias` where the IMU is a cheap one: that has one."""
BIASED = {"good": (), "cheap": ("accelerometer_bias",)}
"""Names of what every IMU of a grade has."""


@dataclass(frozen=True)
class Told:
    """What was there. `answers[i]`: sets of names that say what hidden effect i is; none: no name does.

    `anyway` are names that are true of the vehicle and its air whatever was hidden; `near` those that are not wrong.
    `amplitudes[i]`: size of effect i over its standard deviation in a regression with the true laws (`oracle`), None
    where nobody computed it.
    """

    answers: tuple[tuple[Names, ...], ...]
    anyway: Names
    near: Names
    amplitudes: tuple[float, ...] | None


def families(names: Iterable[str]) -> Names:
    """Forms of one effect are one name."""
    return frozenset(family(name) for name in names)
