"""Rotors that fly sideways lift more."""

import numpy as np

from wrenchgap.plant.effects.body_drag import too_slow
from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, ThrustEffect, Vehicle, hover_rotor


class TranslationalLift(ThrustEffect):
    """Air that comes in edgewise adds thrust: dT = k_h |v_t|^2, v_t the hub's velocity through the air in its plane.

    The mean over a turn of the blade's (Omega r + v_t sin psi)^2 is (Omega r)^2 + |v_t|^2 / 2; a rotor that turns
    backwards gains downwards. Source: blade element theory; the form is that of rotorpy's `k_h` (Folk, Paulos and
    Kumar); 3.39e-3 kg/m for its Hummingbird.
    """

    name = "translational_lift"
    accuracy = 0.15
    excited_by = "speed across the rotors"
    confused_with = ("thrust_scale", "body_drag")
    needs_pose = True
    aerodynamic = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """k_h per rotor, scaled to the hover thrust."""
        thrust, _ = hover_rotor(vehicle)
        return (Parameter("k_h", "N s^2/m^2", 0.0, 0.03 * thrust, 1e-3 * thrust),)

    def unexcited(self, context: Context) -> str | None:
        """It goes with the square of the speed."""
        return too_slow(context)

    def apply(self, actuation: Actuation, theta: Array, context: Context) -> Array:
        """Thrusts (N, R) with translational lift."""
        velocity = context.hub_velocity_B(actuation)
        along = np.einsum("nri,nri->nr", velocity, actuation.normal_B)
        gain = theta[0] * ((velocity**2).sum(axis=-1) - along**2)
        return np.asarray(actuation.thrust + np.sign(actuation.rotor_speed) * gain)
