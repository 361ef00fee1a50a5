"""State and inputs of the plant, for N samples at once (a simulation step is N = 1).

Every array has the sample axis first. O is the body origin; wrenches in this module are about O, in B, force first.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from plant.vehicle import Vehicle

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Commands:
    """What the flight controller sends: `wrench_B` (N, 6), and where the vehicle has rotors `tilt` (N, A) [rad] and
    `rotor_speed` (N, R) [rad/s].
    """  # noqa: D205

    wrench_B: Array
    tilt: Array | None = None
    rotor_speed: Array | None = None


@dataclass(frozen=True)
class State:
    """Motion of the body origin O: `time` (N,) [s], `position_E` (N, 3), `quat_EB` (N, 4), `velocity_E` (N, 3) and
    `omega_B` (N, 3); `voltage` (N,) [V] or None where unknown.
    """  # noqa: D205

    time: Array
    position_E: Array
    quat_EB: Array
    velocity_E: Array
    omega_B: Array
    voltage: Array | None = None


@dataclass(frozen=True)
class Rates:
    """How fast the actuators move: `tilt` (N, A) [rad/s], `tilt_dot` (N, A) [rad/s^2], `rotor_dot` (N, R) [rad/s^2]."""

    tilt: Array
    tilt_dot: Array
    rotor_dot: Array


@dataclass(frozen=True)
class Actuation:
    """What the rotors of a vehicle do: `tilt` (N, A), `rotor_speed` (N, R), `thrust` (N, R) [N] along the normals.

    `rates` is None where nobody asked how fast the actuators move; they then count as at rest.
    """

    vehicle: Vehicle
    tilt: Array
    rotor_speed: Array
    thrust: Array
    rates: Rates | None = None

    @property
    def tilt_rate(self) -> Array:
        """dalpha/dt (N, A) [rad/s]."""
        return np.zeros_like(self.tilt) if self.rates is None else self.rates.tilt

    @property
    def tilt_acceleration(self) -> Array:
        """d2alpha/dt2 (N, A) [rad/s^2]."""
        return np.zeros_like(self.tilt) if self.rates is None else self.rates.tilt_dot

    @property
    def rotor_acceleration(self) -> Array:
        """dOmega/dt (N, R) [rad/s^2]."""
        return np.zeros_like(self.rotor_speed) if self.rates is None else self.rates.rotor_dot

    @cached_property
    def arm_normal_B(self) -> Array:
        """Unit thrust directions of the arms (N, A, 3): cos(alpha) n_0 + sin(alpha) a x n_0."""
        arms, _ = self.vehicle.geometry()
        return np.asarray(np.cos(self.tilt)[..., None] * arms.normal_B + np.sin(self.tilt)[..., None] * arms.lateral_B)

    @cached_property
    def normal_B(self) -> Array:
        """Unit thrust directions of the rotors (N, R, 3)."""
        _, rotors = self.vehicle.geometry()
        return np.asarray(self.arm_normal_B[:, rotors.arm])

    @cached_property
    def hub_B(self) -> Array:
        """Positions of the rotors (N, R, 3) from O [m]."""
        arms, rotors = self.vehicle.geometry()
        return np.asarray(arms.position_B[rotors.arm] + rotors.offset[:, None] * self.normal_B)

    def with_thrust(self, thrust: Array) -> Actuation:
        """The same rotors with other thrusts (N, R)."""
        made = Actuation(self.vehicle, self.tilt, self.rotor_speed, thrust, self.rates)
        for name in ("arm_normal_B", "normal_B", "hub_B"):
            if name in self.__dict__:
                made.__dict__[name] = self.__dict__[name]
        return made


@dataclass(frozen=True)
class Motion:
    """What an ideal IMU at O would feel: `omega_B` (N, 3), `omega_dot_B` (N, 3), `specific_force_B` (N, 3)."""

    omega_B: Array
    omega_dot_B: Array
    specific_force_B: Array
