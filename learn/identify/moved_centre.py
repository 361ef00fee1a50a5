"""What changes the thrust of all rotors, told from rotors that get weak one by one: a centre of mass that moves."""

from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.plant.vehicle import Vehicle


@dataclass(frozen=True)
class MovedCentre:
    """A centre of mass that moves by (`x`, `y`) [m] from flight `first` to flight `last`, those farthest apart, and the
    `share` that it has in the squares of what the thrusts of rotors change by, each against all.
    """  # noqa: D205

    x: float
    y: float
    first: int
    last: int
    share: float


def all_alike(thrusts: Array) -> bool:
    """Whether relative thrusts (n, R) change by what all rotors have in common, and not one by one.

    That is all of the squares where all change alike, and 1 / R of them where one rotor of R is weak: half-way counts.
    """
    change = thrusts - thrusts.mean(axis=0)
    rotors, common = thrusts.shape[1], change.mean(axis=1)
    return bool(rotors * np.sum(common**2) > 0.5 * (1.0 + 1.0 / rotors) * np.sum(change**2))


def moved_centre(thrusts: Array, vehicle: Vehicle) -> MovedCentre | None:
    """The centre of mass that relative thrusts (n, R) of rotors move like; None where single rotors do better.

    In hover every rotor has the same thrust T, and one that gives 1 + d_r of it makes the torque of a centre of mass at
    -mean(d_r x_r). Beside what all rotors change by, d_r of a moved centre is a plane over their places; of one weak
    rotor of R the plane has 2 / (R - 1) of the squares. Source: the balance of moments of a hover.
    """
    arms, rotors = vehicle.geometry()
    place = arms.position_B[rotors.arm, :2] - arms.position_B[rotors.arm, :2].mean(axis=0)
    together = (thrusts - thrusts.mean(axis=0)).mean(axis=1, keepdims=True)
    change = thrusts - thrusts.mean(axis=0) - together
    plane = change @ place @ np.linalg.pinv(place)
    share = float(np.sum(plane**2) / max(np.sum(change**2), 1e-30))
    if share < 0.5 * (1.0 + 2.0 / (len(place) - 1)) or np.sum(plane**2) < len(place) * np.sum(together**2):
        return None
    centres = -change @ place / len(place)
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)
    first, last = sorted(int(k) for k in np.unravel_index(np.argmax(apart), apart.shape))
    x, y = centres[last] - centres[first]
    return MovedCentre(float(x), float(y), first, last, share)
