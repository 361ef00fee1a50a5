"""Air that moves."""

from __future__ import annotations

import numpy as np

from wrenchgap.flight.so3 import rotate_inverse
from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, Vehicle, WrenchEffect


class Wind(WrenchEffect):
    """Linear drag in moving air: F = -D (v - v_w), v_w constant in E, horizontal; at the centre of mass.

    The parameters are D and the force w = D v_w at standstill, in which the effect is linear; v_w = w / D. D is the
    same in every direction. Source: Faessler et al., RA-L 2018 (linear drag) with the velocity through the air.
    """

    name = "wind"
    excited_by = "flight in several directions, and yaw: the force is fixed in E"
    confused_with = ("tether", "body_drag", "constant_wrench")
    needs_pose = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Drag, and the wind's force at standstill along E's x and y."""
        weight = vehicle.body.mass * 9.81
        force = tuple(Parameter(f"force_{a}", "N", -0.3 * weight, 0.3 * weight, 0.02 * weight) for a in "xy")
        return (Parameter("drag", "N s/m", 0.0, 0.2 * weight, 0.01 * weight), *force)

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """The force about the nominal centre of mass, moved to O."""
        x = context.state
        pushed = -theta[0] * x.velocity_E + np.array([theta[1], theta[2], 0.0])
        force = rotate_inverse(x.quat_EB, pushed)
        return np.concatenate((force, np.cross(context.vehicle.body.com_B, force)), axis=-1)
