"""Arms that are swung, and the body that swings back."""

from __future__ import annotations

import numpy as np

from flight.errors import ModelError
from plant.effects.effect import Actuation, Array, Context, Parameter, Vehicle, WrenchEffect


class ArmReaction(WrenchEffect):
    """Tilting an arm takes a torque about it, which the body feels backwards: M = -J_a sum_i d2alpha_i a_i.

    Source: conservation of angular momentum; reference effects.md, "arm inertia reaction" (J_a 0.3 to 1e-3 kg m^2).
    """

    name = "arm_reaction"
    excited_by = "tilt acceleration: steps and fast multisines"
    confused_with = ("inertia", "servo_lag")
    needs_rotors = True
    needs_rates = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Inertia of one arm about its own axis."""
        arms, _ = vehicle.geometry()
        if not arms.tilts.any():
            raise ModelError(f"{vehicle.name}: effect arm_reaction needs arms that tilt, and none does")
        typical = 0.005 * float(np.mean(np.diag(vehicle.body.inertia)))
        return (Parameter("inertia", "kg m^2", 0.0, 20.0 * typical, typical),)

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """The added torque."""
        assert actuation is not None
        arms, _ = context.vehicle.geometry()
        torque = -theta[0] * actuation.tilt_acceleration @ arms.axis_B
        return np.concatenate((np.zeros_like(torque), torque), axis=-1)
