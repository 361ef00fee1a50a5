"""Arms that are swung, and the body that swings back."""

import numpy as np

from wrenchgap.plant.effects.effect import Array, Context, Parameter, WrenchEffect, pure_torque, tilting_arms
from wrenchgap.plant.state import Actuation
from wrenchgap.plant.vehicle import Vehicle


class ArmReaction(WrenchEffect):
    """Tilting an arm takes a torque about it, which the body feels backwards.

        h_i = J_a dalpha_i a_i,   M = -d/dt sum_i h_i = -J_a sum_i [d2alpha_i a_i + omega x (dalpha_i a_i)]

    Arms are balanced about their axes, so that their tilt moves no mass. Source: angular momentum of a gyrostat,
    Hughes, "Spacecraft Attitude Dynamics", 1986, ch. 3. Size: 3.4e-4 kg m^2 about the arm of a tilt unit in RotorS
    (ethz-asl/rotors_simulator, omav.xacro); up to 1e-3 is our estimate for larger ones.
    """

    name = "arm_reaction"
    needs_tilt = True
    excited_by = "tilt acceleration: steps and fast multisines"
    confused_with = ("inertia", "servo_lag")
    needs_rotors = True
    needs_rates = True
    depends_on = "commands"
    linear = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Inertia of one arm about its own axis."""
        tilting_arms(vehicle, self.name)
        typical = 0.005 * float(np.mean(np.diag(vehicle.body.inertia)))
        return (Parameter("inertia", "kg m^2", 0.0, 20.0 * typical, typical),)

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """The added torque."""
        assert actuation is not None
        arms, _ = context.vehicle.geometry()
        swing = actuation.tilt_rate @ arms.axis_B
        torque = -theta[0] * (actuation.tilt_acceleration @ arms.axis_B + np.cross(context.state.omega_B, swing))
        return pure_torque(torque)
