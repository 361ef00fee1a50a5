"""The vehicle: arms that may tilt, rotors on them, mass properties, limits.

Geometry of one arm, in B, origin at the body origin O (L = arm length, g = azimuth; docs/notation.md):

    p_arm   hub point                         (L cos g, L sin g, 0) for a planar star
    a       tilt axis, unit, outward          (cos g, sin g, 0)
    n_0     thrust direction at zero tilt     e_z
    n(alpha) = cos(alpha) n_0 + sin(alpha) (a x n_0)          right-handed tilt about a

A rotor on arm i sits at `p_arm + offset n(alpha)` and makes the thrust `T = c_f Omega^2` along n and the drag torque
`-spin kappa T n` (spin +1: turns counter-clockwise about n, so its drag torque points along -n).
"""

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import GRAVITY as GRAVITY
from wrenchgap.flight.flight import Array, Indices, Mask

PART = re.compile(r"(arm|rotor)_(\d+)")
"""The name of an arm or a rotor in parameters of effects and in JSON keys, in the order of the model file."""


@dataclass(frozen=True)
class Body:
    """A rigid body: `mass` [kg], `inertia` (3, 3) [kg m^2] about its centre of mass, `com_B` (3,) [m] from O."""

    mass: float
    inertia: Array
    com_B: Array

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mass) and self.mass > 0):
            raise ModelError(f"vehicle.mass: got {self.mass}, expected a positive number of kilograms")
        eigenvalues = np.linalg.eigvalsh(self.inertia)
        if not np.allclose(self.inertia, self.inertia.T) or eigenvalues[0] <= 0:
            raise ModelError(f"vehicle.inertia: {self.inertia.tolist()} is not symmetric positive definite [kg m^2]")


@dataclass(frozen=True, eq=False)
class Arms:
    """The A arms of a vehicle, in B.

    Attributes
    ----------
    position_B : (A, 3)
        Hub points from O [m].
    axis_B, normal_B : (A, 3)
        Unit tilt axes, and unit thrust directions at zero tilt.
    tilts : (A,)
        Whether an arm can tilt.
    tilt_min, tilt_max, tilt_rate_max : (A,)
        Limits of the tilt angle [rad] and of its rate [rad/s].
    """

    position_B: Array
    axis_B: Array
    normal_B: Array
    tilts: Mask
    tilt_min: Array
    tilt_max: Array
    tilt_rate_max: Array

    def __len__(self) -> int:
        return len(self.position_B)

    @cached_property
    def lateral_B(self) -> Array:
        """Direction (A, 3) in which the thrust turns as an arm tilts: a x n_0."""
        return np.cross(self.axis_B, self.normal_B)


@dataclass(frozen=True, eq=False)
class Rotors:
    """The R rotors of a vehicle.

    Attributes
    ----------
    arm : (R,)
        Index of the arm that carries the rotor.
    offset : (R,)
        Place along the thrust direction, from the hub point of the arm [m].
    spin : (R,)
        +1 for a rotor that turns counter-clockwise about its thrust direction, else -1.
    c_f, kappa, radius : (R,)
        Thrust coefficient [N s^2], drag torque per thrust [m], radius [m].
    speed_min, speed_max : (R,)
        Limits of the speed [rad/s].
    """

    arm: Indices
    offset: Array
    spin: Array
    c_f: Array
    kappa: Array
    radius: Array
    speed_min: Array
    speed_max: Array

    def __len__(self) -> int:
        return len(self.arm)


@dataclass(frozen=True, eq=False)
class Tolerances:
    """Standard deviations of the numbers of a vehicle; None where the model file gives none.

    `mass` [kg]; `inertia` (3, 3) [kg m^2], entry by entry; `com` and `imu_position` (3,) [m]; `thrust`, of all rotors
    together and relative to it; `thrust_axis` [rad], of each rotor by itself.
    """

    mass: float | None = None
    inertia: Array | None = None
    com: Array | None = None
    imu_position: Array | None = None
    thrust: float | None = None
    thrust_axis: float | None = None


@dataclass(frozen=True, eq=False)
class Vehicle:
    """The nominal vehicle.

    Attributes
    ----------
    body
        Mass properties.
    arms, rotors
        None for a vehicle of which only the wrench is known.
    imu_position_B : (3,)
        Place of the accelerometer, from O [m].
    arm_names, rotor_names : (A,), (R,)
        The user's names, "" for one without; empty where none has a name.
    tolerances
        Of mass properties and of the place of the IMU.
    """

    name: str
    body: Body
    arms: Arms | None
    rotors: Rotors | None
    imu_position_B: Array
    arm_names: tuple[str, ...] = ()
    rotor_names: tuple[str, ...] = ()
    tolerances: Tolerances = Tolerances()

    @property
    def has_rotors(self) -> bool:
        """Whether thrusts can be computed, i.e. the geometry is known."""
        return self.rotors is not None

    def geometry(self) -> tuple[Arms, Rotors]:
        """Arms and rotors; raises ModelError where the model file gives none."""
        if self.arms is None or self.rotors is None:
            raise ModelError(
                f"{self.name}: this needs arms and rotors, and the model file has none; add [[vehicle.arms]]"
            )
        return self.arms, self.rotors

    def arm_name(self, arm: int) -> str:
        """The user's name of an arm, by its index; without one the name that parameters have."""
        return self.named("arm", arm) or f"arm_{arm}"

    def rotor_name(self, rotor: int) -> str:
        """The user's name of a rotor, by its index; M1, M2, ... as autopilots count where the model names none."""
        return self.named("rotor", rotor) or (f"rotor_{rotor}" if any(self.rotor_names) else f"M{rotor + 1}")

    def named(self, kind: Literal["arm", "rotor"], index: int) -> str:
        """The user's own name of an arm or a rotor, "" where the model file has none."""
        names = self.arm_names if kind == "arm" else self.rotor_names
        return names[index] if index < len(names) else ""

    def called(self, parameter: str) -> str:
        """A parameter in words: the name of the arm or rotor that it belongs to, else the parameter itself."""
        found = PART.fullmatch(parameter)
        if found is None:
            return parameter
        return self.arm_name(int(found[2])) if found[1] == "arm" else self.rotor_name(int(found[2]))
