"""Rotors resist moving in their own plane."""

import numpy as np

from wrenchgap.plant.effects.com_offset import span
from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, Vehicle, WrenchEffect, hover_rotor


class RotorDrag(WrenchEffect):
    """The H-force: each rotor pulls against its velocity in its own plane, F_r = -lambda |Omega| v_perp, at the hub.

    The velocity is that of the hub through the air.

    Source: Martin and Salaun, ICRA 2010; RotorS' `rotor_drag_coefficient` (8.06e-5 N s^2/(m rad)).
    """

    name = "rotor_drag"
    excited_by = "translation across the rotors, and yaw rate"
    confused_with = ("body_drag", "wind", "rotational_drag")
    needs_rotors = True
    needs_pose = True
    aerodynamic = True
    depends_on = "commands"
    linear = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """lambda, scaled to the vehicle's weight and rotor speed."""
        thrust, speed = hover_rotor(vehicle)
        return (Parameter("coefficient", "N s^2/(m rad)", 0.0, 0.3 * thrust / speed, 0.02 * thrust / speed),)

    def unexcited(self, context: Context) -> str | None:
        """Hubs that hardly move: neither translation nor rates."""
        least = 0.3
        turning = span(context.vehicle) * np.linalg.norm(context.state.omega_B, axis=-1)
        fastest = float(np.max(np.linalg.norm(context.velocity_through_air_B, axis=-1) + turning))
        return f"no rotor faster than {least:g} m/s (fastest {fastest:.2g} m/s)" if fastest < least else None

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """Force and torque about O of all rotors."""
        assert actuation is not None
        velocity = context.hub_velocity_B(actuation)
        along = np.einsum("nri,nri->nr", velocity, actuation.normal_B)
        across = velocity - along[..., None] * actuation.normal_B
        force = -theta[0] * np.abs(actuation.rotor_speed)[..., None] * across
        return np.concatenate((force.sum(axis=1), np.cross(actuation.hub_B, force).sum(axis=1)), axis=-1)
