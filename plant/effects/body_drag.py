"""Air drag of the airframe."""

import numpy as np

from wrenchgap.plant.effects.com_offset import span
from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, WrenchEffect, force_at, weight_scale
from wrenchgap.plant.vehicle import Vehicle


class BodyDrag(WrenchEffect):
    """Drag on the body, linear and quadratic in the velocity through the air, axis by axis in B.

        F = -D_1 v_B - D_2 v_B |v_B|,    M = p x F       (componentwise; p: centre of pressure, from the centre of mass)

    Source: Faessler et al., RA-L 2018 (rotor drag, linear), Hoerner, "Fluid-Dynamic
    Drag", 1965 (quadratic).
    """

    name = "body_drag"
    family = "body_drag"
    form = "linear and quadratic, axis by axis"
    accuracy = 0.1
    excited_by = "translation faster than about 1 m/s, in every body direction"
    confused_with = ("wind", "rotor_drag", "body_drag_areas")
    needs_pose = True
    aerodynamic = True
    depends_on = "state"

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Linear and quadratic coefficients along body x, y and z (typical: a tenth of the weight at 5 m/s), and p."""
        weight = weight_scale(vehicle)
        linear = tuple(Parameter(f"linear_{a}", "N s/m", 0.0, 0.2 * weight, 0.02 * weight) for a in "xyz")
        squared = tuple(Parameter(f"quadratic_{a}", "N s^2/m^2", 0.0, 0.04 * weight, 0.004 * weight) for a in "xyz")
        size = span(vehicle)
        point = tuple(Parameter(f"point_{a}", "m", -size, size, 0.2 * size, alone=False) for a in "xyz")
        return linear + squared + point

    def unexcited(self, context: Context) -> str | None:
        """Drag needs speed."""
        return too_slow(context)

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """Drag force at the centre of pressure, about O."""
        velocity_B = context.velocity_through_air_B
        force = -theta[:3] * velocity_B - theta[3:6] * velocity_B * np.abs(velocity_B)
        return force_at(context.vehicle.body.com_B + theta[6:], force)


def too_slow(context: Context, least: float = 0.3) -> str | None:
    """Why a flight is too slow to show aerodynamics of translation, None if it is not."""
    fastest = float(np.linalg.norm(context.velocity_through_air_B, axis=-1).max())
    return f"never faster than {least:g} m/s (fastest {fastest:.2g} m/s)" if fastest < least else None
