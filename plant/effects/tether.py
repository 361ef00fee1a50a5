"""A force that keeps its direction in the world, at a point of the body."""

import numpy as np

from wrenchgap.flight.so3 import rotate_inverse
from wrenchgap.plant.effects.com_offset import span
from wrenchgap.plant.effects.effect import Array, Context, Parameter, WrenchEffect, force_at, weight_scale
from wrenchgap.plant.state import Actuation
from wrenchgap.plant.vehicle import Vehicle


class Tether(WrenchEffect):
    """A force F constant in E pulls at the point p of B: a cable, a contact, a weight on a string.

        F_B = R_EB^T F,   M_O = p x F_B

    What hangs or drags on a vehicle pulls it down or aside. Up it pulls as much as a safety line relieves that is kept
    just free of slack. Source: statics, docs/effects/tether.md.
    """

    name = "tether"
    accuracy = 0.1
    excited_by = "yaw and tilt, which turn E against B"
    confused_with = ("payload", "constant_wrench", "wind", "com_offset")
    needs_pose = True
    depends_on = "state"

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Force in E, and the point in B."""
        weight, size = weight_scale(vehicle), span(vehicle)
        most = {"x": 0.3, "y": 0.3, "z": 0.05}  # share of the weight; up, a safety line relieves a little of it
        force = tuple(Parameter(f"force_{a}", "N", -0.3 * weight, most[a] * weight, 0.02 * weight) for a in "xyz")
        point = [Parameter(f"point_{a}", "m", -2.0 * size, 2.0 * size, 0.5 * size, alone=False) for a in "xyz"]
        return (*force, *point)

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """The added wrench about O."""
        force = rotate_inverse(context.state.quat_EB, np.broadcast_to(theta[:3], context.state.velocity_E.shape))
        return force_at(theta[3:], force)
