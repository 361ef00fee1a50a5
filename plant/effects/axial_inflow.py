"""Rotors that climb or sink through the air."""

import numpy as np

from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, ThrustEffect, Vehicle, hover_rotor


class AxialInflow(ThrustEffect):
    """A rotor that moves along its own thrust loses some: dT = -k_z |Omega| v_n, v_n = (v + omega x p) . n.

    v is the velocity through the air.

    A blade's angle of attack falls by v_n / (Omega r), its lift goes with (Omega r)^2. A rotor that turns backwards
    loses likewise, hence |Omega|. Source: blade element theory at first order, Leishman, "Principles of Helicopter
    Aerodynamics", 2006, ch. 3; k_z = 2.32e-4 kg/rad for rotorpy's Hummingbird (Folk, Paulos and Kumar).
    """

    name = "axial_inflow"
    accuracy = 0.1
    excited_by = "climb, sink, and roll or pitch rates, which it damps"
    confused_with = ("rotational_drag", "body_drag")
    needs_pose = True
    aerodynamic = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """k_z; scaled to the vehicle's hover: a typical rotor loses a few per cent of its thrust per m/s."""
        thrust, speed = hover_rotor(vehicle)
        return (Parameter("k_z", "N s^2/(m rad)", 0.0, 0.3 * thrust / speed, 0.05 * thrust / speed),)

    def apply(self, actuation: Actuation, theta: Array, context: Context) -> Array:
        """Thrusts (N, R) with inflow."""
        v_n = np.einsum("nri,nri->nr", context.hub_velocity_B(actuation), actuation.normal_B)
        return np.asarray(actuation.thrust - theta[0] * np.abs(actuation.rotor_speed) * v_n)
