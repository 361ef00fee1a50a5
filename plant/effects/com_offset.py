"""Centre of mass away from where the model has it."""

from dataclasses import replace

import numpy as np

from wrenchgap.plant.effects.effect import Array, BodyEffect, Parameter, is_tight, offset_parameters
from wrenchgap.plant.vehicle import Body, Vehicle


class ComOffset(BodyEffect):
    """The centre of mass sits r_c away from its nominal place.

    Thrust F then makes a torque about it, and an accelerometer that stays where it is feels a lever arm:

        M_c = M_O - r_c x F,    f_O = F/m - domega x r_c - omega x (omega x r_c)

    Source: Newton-Euler about a point that is not the centre of mass, docs/notation.md.
    """

    name = "com_offset"
    excited_by = "hover shows r_x and r_y; r_z needs tilt; force in two body directions shows all three"
    confused_with = ("rotor_thrust", "constant_wrench", "rotor_interference")

    typical = 0.02
    """Typical offset of a centre of mass that was not balanced, in spans."""

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Offset along body x, y and z."""
        size = span(vehicle)
        return offset_parameters(0.1 * size, self.typical * size, -size, vehicle.tolerances.com)

    def known(self, vehicle: Vehicle) -> str | None:
        """Balanced, to much less than what is typical."""
        tolerance = vehicle.tolerances.com
        if tolerance is None or not is_tight(tolerance, self.typical * span(vehicle)):
            return None
        return f"the model file knows the centre of mass to {1e3 * float(np.max(tolerance)):.2g} mm"

    def apply(self, body: Body, theta: Array) -> Body:
        """The body with its centre of mass moved; mass and inertia about the centre of mass stay."""
        return replace(body, com_B=body.com_B + theta)


def span(vehicle: Vehicle) -> float:
    """A length [m] to measure offsets by: the longest arm, or what mass and inertia suggest."""
    if vehicle.arms is not None:
        return float(max((vehicle.arms.position_B**2).sum(axis=1)) ** 0.5)
    body = vehicle.body
    return float((1.5 * body.inertia.trace() / body.mass) ** 0.5)
