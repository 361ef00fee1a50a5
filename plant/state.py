"""State and inputs of the plant, for N samples at once (a simulation step is N = 1).

Every array has the sample axis first. O is the body origin; wrenches in this module are about O, in B, force first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TypeVar

import numpy as np

from wrenchgap.flight.flight import Array, Indices
from wrenchgap.plant.vehicle import Vehicle

Index = slice | Indices
Arrays = TypeVar("Arrays")
"""A dataclass of arrays (N, ...) over the same samples; None where unknown."""


def rows(item: Arrays, index: Index) -> Arrays:
    """Some of the samples, in the order of `index`."""
    taken = {name: value[index] for name, value in vars(item).items() if isinstance(value, np.ndarray)}
    return replace(item, **taken)  # type: ignore[type-var]


def concatenated(parts: Sequence[Arrays]) -> Arrays:
    """The parts one after the other; None where one of them is None."""
    columns = {name: [getattr(part, name) for part in parts] for name in vars(parts[0])}
    contiguous = {n: None if any(v is None for v in c) else np.concatenate(c) for n, c in columns.items()}
    return replace(parts[0], **contiguous)  # type: ignore[type-var]


@dataclass(frozen=True)
class Commands:
    """Commands of the flight controller; tilt and speed are None for a vehicle without rotors.

    Attributes
    ----------
    wrench_B : (N, 6)
        About the centre of mass, in B [N, Nm].
    tilt : (N, A)
        Angles of the arms [rad].
    rotor_speed : (N, R)
        [rad/s].
    """

    wrench_B: Array
    tilt: Array | None = None
    rotor_speed: Array | None = None

    def take(self, index: Index) -> Commands:
        """Some of the samples, in the order of `index`."""
        return rows(self, index)


@dataclass(frozen=True)
class State:
    """Motion of the body origin O.

    Attributes
    ----------
    time : (N,)
        [s].
    position_E, velocity_E : (N, 3)
        Of O, in E [m], [m/s].
    quat_EB : (N, 4)
        Attitude, (w, x, y, z).
    omega_B : (N, 3)
        Angular velocity, in B [rad/s].
    voltage : (N,)
        Of the battery [V], None where unknown.
    specific_force_B : (N, 3)
        An accelerometer's reading as of O, in B [m/s^2]; None where unknown, as nearly everywhere: only a flight
        computer hands it to a compensator.
    """

    time: Array
    position_E: Array
    quat_EB: Array
    velocity_E: Array
    omega_B: Array
    voltage: Array | None = None
    specific_force_B: Array | None = None

    def take(self, index: Index) -> State:
        """Some of the samples, in the order of `index`."""
        return rows(self, index)


@dataclass(frozen=True)
class Rates:
    """Rates of the actuators: `tilt` (N, A) [rad/s], `tilt_dot` (N, A) [rad/s^2], `rotor_dot` (N, R) [rad/s^2]."""

    tilt: Array
    tilt_dot: Array
    rotor_dot: Array


@dataclass(frozen=True, eq=False)
class Posture:
    """Arrays that depend on the tilt angles (N, A) alone: computed once, and shared by every `Actuation` with them."""

    vehicle: Vehicle
    tilt: Array
    _held: dict[str, Array] = field(default_factory=dict, repr=False)

    def cached(self, name: str, make: Callable[[], Array]) -> Array:
        """The array of this name, computed once; for effects, too, that derive one from the angles alone."""
        if name not in self._held:
            self._held[name] = make()
        return self._held[name]

    def forget(self) -> None:
        """Free the memory; an array that is used again is computed again."""
        self._held.clear()

    @property
    def turn(self) -> Array:
        """Cosines, then sines of the angles (N, 2A)."""
        return self.cached("turn", lambda: np.hstack((np.cos(self.tilt), np.sin(self.tilt))))

    @property
    def arm_normal_B(self) -> Array:
        """Unit thrust directions of the arms (N, A, 3): cos(alpha) n_0 + sin(alpha) a x n_0."""
        return self.cached("arm_normal_B", lambda: (self.turn @ _directions(self.vehicle)).reshape(*self.tilt.shape, 3))

    @property
    def normal_B(self) -> Array:
        """Unit thrust directions of the rotors (N, R, 3)."""
        _, rotors = self.vehicle.geometry()
        return self.cached("normal_B", lambda: self.arm_normal_B[:, rotors.arm])

    @property
    def hub_B(self) -> Array:
        """Positions of the rotors (N, R, 3) from O [m]."""
        arms, rotors = self.vehicle.geometry()
        return self.cached("hub_B", lambda: arms.position_B[rotors.arm] + rotors.offset[:, None] * self.normal_B)


@lru_cache(maxsize=64)
def _directions(vehicle: Vehicle) -> Array:
    """From cosines and sines of all arms to their thrust directions (2A, 3A)."""
    arms, _ = vehicle.geometry()
    own = np.eye(len(arms))[:, :, None]
    return np.vstack([(own * d).reshape(len(arms), -1) for d in (arms.normal_B, arms.lateral_B)])


@dataclass(frozen=True)
class Actuation:
    """The state of the actuators.

    Attributes
    ----------
    tilt : (N, A)
        Angles of the arms [rad].
    rotor_speed, thrust : (N, R)
        Speeds [rad/s], and thrusts along the normals [N].
    rates
        Of the actuators; None counts as at rest.
    posture
        Of these angles; one of other angles is replaced.
    """

    vehicle: Vehicle
    tilt: Array
    rotor_speed: Array
    thrust: Array
    rates: Rates | None = None
    posture: Posture = field(default=None, repr=False, compare=False)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        given: Posture | None = self.posture
        if given is None or given.tilt is not self.tilt or given.vehicle is not self.vehicle:
            object.__setattr__(self, "posture", Posture(self.vehicle, self.tilt))

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

    @property
    def arm_normal_B(self) -> Array:
        """Unit thrust directions of the arms (N, A, 3): cos(alpha) n_0 + sin(alpha) a x n_0."""
        return self.posture.arm_normal_B

    @property
    def normal_B(self) -> Array:
        """Unit thrust directions of the rotors (N, R, 3)."""
        return self.posture.normal_B

    @property
    def hub_B(self) -> Array:
        """Positions of the rotors (N, R, 3) from O [m]."""
        return self.posture.hub_B

    def with_thrust(self, thrust: Array) -> Actuation:
        """The same rotors with other thrusts (N, R)."""
        return Actuation(self.vehicle, self.tilt, self.rotor_speed, thrust, self.rates, self.posture)


@dataclass(frozen=True)
class Motion:
    """The reading of an ideal IMU at O: `omega_B` (N, 3), `omega_dot_B` (N, 3), `specific_force_B` (N, 3)."""

    omega_B: Array
    omega_dot_B: Array
    specific_force_B: Array
