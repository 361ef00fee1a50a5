"""Effects: equations with parameters that act at one of five places, or describe the air.

place       signature of `apply`                                             examples
commands    (commands, theta, context, dt, memory) -> (commands, memory)     lags, delay, tilt offset
thrusts     (actuation, theta, context) -> thrust (N, R)                     gains, coaxial loss, wakes
wrench      (actuation or None, wrench_B, theta, context) -> wrench_B (N, 6) drag, constant wrench, thrust scale
body        (body, theta) -> body                                            centre of mass, inertia, mass
sensor      (motion, theta, context) -> motion                               misalignment, lever arm

air         (state, theta) -> velocity_E (N, 3)                              wind

The air is the environment: it has no force. What it does at `thrusts` and `wrench` is done by effects that see the
velocity through it, `Context.velocity_through_air_B`; they say so with `aerodynamic`.

`theta` (P,) are the values of `parameters(vehicle)`, in that order. Zero is always "no effect": the identification
starts there, and a test asserts it. The same `apply` serves identification (N samples) and simulation (N = 1, called
again and again); what must be remembered between calls travels in `memory`, None at the start.

Effects at one place commute or are applied in the order of `order` then `name`, never in the order in which they
were added, so that a model does not depend on its history.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any as Any
from typing import ClassVar, Literal

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array as Array
from wrenchgap.flight.so3 import rotate_inverse
from wrenchgap.plant.state import Actuation as Actuation
from wrenchgap.plant.state import Commands as Commands
from wrenchgap.plant.state import Motion as Motion
from wrenchgap.plant.state import State as State
from wrenchgap.plant.vehicle import Arms
from wrenchgap.plant.vehicle import Body as Body
from wrenchgap.plant.vehicle import Vehicle as Vehicle

Place = Literal["commands", "thrusts", "wrench", "body", "sensor", "air"]


@dataclass(frozen=True)
class Parameter:
    """One number of an effect. Zero means "not there".

    `low` and `high` bound what is physically plausible; `scale` is a typical size (prior standard deviation), which
    also sets the step of numerical derivatives. `start` is where a search begins when the derivative at zero is
    not informative (a lag, a width); zero for parameters that enter smoothly. One that is not `alone` does nothing
    while the others of its effect are zero (where a force acts, how wide a wake is).
    """

    name: str
    unit: str
    low: float
    high: float
    scale: float
    start: float = 0.0
    alone: bool = True


def with_prior(parameter: Parameter, tolerance: float | None, least: float, sigmas: float = 3.0) -> Parameter:
    """The parameter with the tolerance of the number that it changes as its prior, bounded at `sigmas` tolerances.

    Unchanged without a tolerance. `least` is the most negative change that leaves the number physical.
    """
    if tolerance is None:
        return parameter
    reach = sigmas * tolerance
    return replace(parameter, low=max(-reach, least), high=reach, scale=tolerance)


def is_tight(tolerance: float | Array | None, typical: float | Array, share: float = 0.25) -> bool:
    """Whether a number is known to `share` of the typical size of an effect on it: no open question."""
    return tolerance is not None and not bool(np.any(tolerance > share * typical))


@dataclass(frozen=True)
class Source:
    """The file of a user's own effect: its name and the SHA-256 of its content."""

    file: str
    sha256: str


@dataclass(frozen=True)
class Context:
    """Inputs of an effect: the vehicle, the state (N samples), the air.

    `air_velocity_E` (N, 3) [m/s] is the velocity of the air in E, None where it is still. It is known at the places
    `thrusts` and `wrench`; what happens to commands and in the IMU does not depend on it.
    """

    vehicle: Vehicle
    state: State
    air_velocity_E: Array | None = None

    @property
    def velocity_through_air_B(self) -> Array:
        """Velocity of O relative to the air (N, 3) [m/s], in B: R_EB^T (v - v_air)."""
        velocity_E, air_E = self.state.velocity_E, self.air_velocity_E
        return rotate_inverse(self.state.quat_EB, velocity_E if air_E is None else velocity_E - air_E)

    def hub_velocity_B(self, actuation: Actuation) -> Array:
        """Velocity of the rotor hubs through the air (N, R, 3) [m/s], in B: v + omega x p, v that of O."""
        turning = np.cross(self.state.omega_B[:, None], actuation.hub_B)
        return np.asanyarray(self.velocity_through_air_B[:, None] + turning)


class Effect(ABC):
    """Base of all effects. A subclass is one file: equation and source in its docstring, and two methods."""

    name: ClassVar[str]
    """Small letters, digits and `_`; that of the file, in the catalogue."""
    place: ClassVar[Place]
    excited_by: ClassVar[str]
    """What a flight must have to show the effect, in a few words."""
    confused_with: ClassVar[tuple[str, ...]] = ()
    """Names of the effects that look alike on many flights."""
    parts: ClassVar[tuple[str, ...]] = ()
    """Effects that this one stands for when they come together (a payload: mass, centre of mass, inertia)."""
    stands_in_for: ClassVar[str] = ""
    """The effect that is the one to try where the log has what it needs."""
    family: ClassVar[str] = ""
    """The name that several forms of one effect share: that of the first of them. Empty where there is one form."""
    form: ClassVar[str] = ""
    """In a family: which form this is, in a few words ("one height for all rotors")."""
    accuracy: ClassVar[float] = 0.05
    """Share to which the law is known: more where its shape is an assumption, or differs between vehicles."""
    order: ClassVar[int] = 0
    """Effects at one place are applied in this order, then by name."""
    needs_rotors: ClassVar[bool] = False
    """Whether it needs the geometry of the rotors: `actuation` is then never None."""
    needs_tilt: ClassVar[bool] = False
    """Whether it is about arms that tilt."""
    needs_coaxial: ClassVar[bool] = False
    """Whether it is about two rotors on one arm."""
    needs_voltage: ClassVar[bool] = False
    """Whether it needs the battery's voltage, `context.state.voltage`."""
    needs_pose: ClassVar[bool] = False
    """Whether it needs attitude, position or velocity, in `context.state`."""
    needs_rates: ClassVar[bool] = False
    """Whether it needs the rates of the actuators, `actuation.rates`."""
    aerodynamic: ClassVar[bool] = False
    """Whether it depends on the velocity through the air, so that air that moves acts through it."""
    of_parts: ClassVar[str] = ""
    """The effect of the catalogue of which this one has a number for each rotor or arm: not in the catalogue itself."""
    sparse: ClassVar[bool] = False
    """Whether a few large parameters are likelier than many small ones (one damaged rotor, one slipped servo)."""

    @abstractmethod
    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Names, units, plausible ranges of the parameters for this vehicle."""

    def unexcited(self, context: Context) -> str | None:
        """Why a flight through these states cannot show the effect, e.g. "never faster than 0.2 m/s", or None."""
        del context
        return None

    def known(self, vehicle: Vehicle) -> str | None:
        """Why the effect is no open question on this vehicle, e.g. "the mass is known to 0.005 kg", or None."""
        del vehicle
        return None

    def outdated(self, values: Mapping[str, float]) -> str | None:
        """Where `values` are by parameters that an earlier version had: that, and the remedy, as an error says it."""
        del values
        return None


class CommandEffect(Effect):
    """Acts on what the controller sends, before it becomes thrust: lags, delays, offsets."""

    place = "commands"

    @abstractmethod
    def apply(self, commands: Commands, theta: Array, context: Context, dt: float, memory: Any) -> tuple[Commands, Any]:
        """Commands as they arrive, and the memory to hand to the next call. Samples are `dt` [s] apart."""


class ThrustEffect(Effect):
    """Changes the rotor thrusts: gains, losses, interference."""

    place = "thrusts"
    needs_rotors = True

    @abstractmethod
    def apply(self, actuation: Actuation, theta: Array, context: Context) -> Array:
        """Rotor thrusts (N, R) [N] with the effect."""


class WrenchEffect(Effect):
    """Adds to the wrench on the body: drag, bias, scale."""

    place = "wrench"
    depends_on: ClassVar[Literal["state", "commands", "thrusts"]] = "thrusts"
    """What its wrench depends on besides its parameters: `context` alone; rotor speeds and tilt angles, too; or the
    thrusts and `wrench_B` as well. Where that stays as it was, a search need not evaluate it again."""
    linear: ClassVar[bool] = False
    """Whether its wrench is linear in its parameters, sum_k theta_k w_k: a search then evaluates each w_k once."""

    @abstractmethod
    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """The *added* wrench (N, 6) about O, in B. `wrench_B` is what the rotors make, before any wrench effect."""


class BodyEffect(Effect):
    """Changes the mass properties."""

    place = "body"

    @abstractmethod
    def apply(self, body: Body, theta: Array) -> Body:
        """The body as it is."""


class SensorEffect(Effect):
    """Changes what the IMU reads."""

    place = "sensor"

    @abstractmethod
    def apply(self, motion: Motion, theta: Array, context: Context) -> Motion:
        """The motion as the nominal processing will believe it to be (at O)."""


class AirEffect(Effect):
    """Describes the motion of the air. The velocities of several effects add up."""

    place = "air"

    @abstractmethod
    def apply(self, state: State, theta: Array) -> Array:
        """Velocity of the air (N, 3) [m/s] in E at the times and places of these states."""


AnyEffect = CommandEffect | ThrustEffect | WrenchEffect | BodyEffect | SensorEffect | AirEffect


def weight_scale(vehicle: Vehicle) -> float:
    """A round weight [N] by which plausible ranges of parameters are scaled."""
    return vehicle.body.mass * 9.81


def hover_rotor(vehicle: Vehicle) -> tuple[float, float]:
    """Thrust [N] and speed [rad/s] of a rotor in hover, by which plausible ranges of parameters are scaled."""
    _, rotors = vehicle.geometry()
    thrust = weight_scale(vehicle) / len(rotors)
    return thrust, float(np.sqrt(thrust / rotors.c_f.mean()))


def offset_parameters(reach: float, typical: float, least: float, tolerance: Array | None) -> tuple[Parameter, ...]:
    """Offsets along body x, y and z of up to `reach`, typically `typical` [m], or with a tolerance (3,) as prior."""
    usual = [Parameter(axis, "m", -reach, reach, typical) for axis in "xyz"]
    if tolerance is None:
        return tuple(usual)
    return tuple(with_prior(p, float(t), least) for p, t in zip(usual, tolerance, strict=True))


def tilting_arms(vehicle: Vehicle, effect: str) -> Arms:
    """The arms of a vehicle for an effect that needs some of them to tilt; raises ModelError where none does."""
    arms, _ = vehicle.geometry()
    if not arms.tilts.any():
        raise ModelError(f"{vehicle.name}: effect {effect} needs arms that tilt, and none does")
    return arms


def pure_torque(torque_B: Array) -> Array:
    """Wrench (N, 6) of a torque (N, 3) [Nm] without a force."""
    return np.concatenate((np.zeros_like(torque_B), torque_B), axis=-1)


def force_at(point_B: Array, force_B: Array) -> Array:
    """Wrench (N, 6) about O of a force (N, 3) [N] at a point (3,) or (N, 3) [m] of B."""
    return np.concatenate((force_B, np.cross(point_B, force_B)), axis=-1)
