"""Rotors that climb or sink through the air."""

from __future__ import annotations

import numpy as np

from flight.so3 import rotate_inverse
from plant.effects.effect import Actuation, Array, Context, Parameter, ThrustEffect, Vehicle


class AxialInflow(ThrustEffect):
    """A rotor that moves along its own thrust loses some: dT = -k_z Omega v_n, v_n = (v + omega x p) . n.

    Source: blade element theory, Mahony, Kumar and Corke, RAM 2012, eq. (thrust variation); reference effects.md,
    "axial inflow" (k_z about 2.3e-4 N s^2 / (m rad)).
    """

    name = "axial_inflow"
    excited_by = "climb, sink, and roll or pitch rates, which it damps"
    confused_with = ("rotational_drag", "body_drag")
    needs_pose = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """k_z; scaled to the vehicle's hover: a typical rotor loses a few per cent of its thrust per m/s."""
        _, rotors = vehicle.geometry()
        thrust = vehicle.body.mass * 9.81 / len(rotors)
        speed = float(np.sqrt(thrust / rotors.c_f.mean()))
        return (Parameter("k_z", "N s^2/(m rad)", 0.0, 0.3 * thrust / speed, 0.05 * thrust / speed),)

    def apply(self, actuation: Actuation, theta: Array, context: Context) -> Array:
        """Thrusts (N, R) with inflow."""
        v_n = np.einsum("nri,nri->nr", hub_velocity_B(actuation, context), actuation.normal_B)
        return np.asarray(actuation.thrust - theta[0] * actuation.rotor_speed * v_n)


def hub_velocity_B(actuation: Actuation, context: Context) -> Array:
    """Velocity of the hubs through still air (N, R, 3) [m/s], in B: v + omega x p."""
    x = context.state
    velocity_B = rotate_inverse(x.quat_EB, x.velocity_E)
    return np.asarray(velocity_B[:, None] + np.cross(x.omega_B[:, None], actuation.hub_B))
