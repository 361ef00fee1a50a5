"""Effects of the catalogue with a number of their own for each rotor or arm: for `trend`, over a season.

They are not in the catalogue: a flight seldom tells twelve lags apart, and a search would ask it to. Over a season each
is compared with itself, and what a flight does not show stays near zero, with the width of its prior.
"""

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.plant.effects.backlash import Backlash
from wrenchgap.plant.effects.drag_torque import DragTorque
from wrenchgap.plant.effects.effect import Context, Parameter, tilting_arms
from wrenchgap.plant.effects.motor_lag import MotorLag
from wrenchgap.plant.effects.servo_lag import ServoLag
from wrenchgap.plant.state import Commands
from wrenchgap.plant.vehicle import Vehicle


class DragTorqueByRotor(DragTorque):
    """Rotor r's drag torque per thrust is (1 + k_r) kappa_r: dM = -sum_r spin_r k_r kappa_r T_r n_r."""

    name = "drag_torque_by_rotor"
    of_parts: ClassVar[str] = "drag_torque"
    sparse = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """One relative change of kappa for each rotor."""
        return _of_rotors(vehicle, *super().parameters(vehicle))


class MotorLagByRotor(MotorLag):
    """Rotor r's speed follows its command as a first-order lag with tau_r."""

    name = "motor_lag_by_rotor"
    of_parts: ClassVar[str] = "motor_lag"

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """One time constant for each rotor."""
        return _of_rotors(vehicle, *super().parameters(vehicle))


class ServoLagByArm(ServoLag):
    """Arm i's tilt follows its command as a first-order lag with tau_i."""

    name = "servo_lag_by_arm"
    of_parts: ClassVar[str] = "servo_lag"

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """One time constant for each tilting arm."""
        return _of_arms(vehicle, self.name, *super().parameters(vehicle))

    def apply(self, commands: Commands, theta: Array, context: Context, dt: float, memory: Any) -> tuple[Commands, Any]:
        """Tilt angles, each lagged by its own."""
        return super().apply(commands, _of_all_arms(context.vehicle, theta), context, dt, memory)


class BacklashByArm(Backlash):
    """Arm i has the play b_i."""

    name = "backlash_by_arm"
    of_parts: ClassVar[str] = "backlash"

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """One play for each tilting arm."""
        return _of_arms(vehicle, self.name, *super().parameters(vehicle))

    def apply(self, commands: Commands, theta: Array, context: Context, dt: float, memory: Any) -> tuple[Commands, Any]:
        """Tilt angles after the play of each."""
        return super().apply(commands, _of_all_arms(context.vehicle, theta), context, dt, memory)


def _of_rotors(vehicle: Vehicle, whole: Parameter) -> tuple[Parameter, ...]:
    return tuple(replace(whole, name=f"rotor_{r}") for r in range(len(vehicle.geometry()[1])))


def _of_arms(vehicle: Vehicle, effect: str, whole: Parameter) -> tuple[Parameter, ...]:
    return tuple(replace(whole, name=f"arm_{i}") for i in np.flatnonzero(tilting_arms(vehicle, effect).tilts))


def _of_all_arms(vehicle: Vehicle, theta: Array) -> Array:
    """Values (A,) of all arms from those that tilt, zero for the others."""
    tilts = vehicle.geometry()[0].tilts
    values = np.zeros(len(tilts))
    values[tilts] = theta
    return values
