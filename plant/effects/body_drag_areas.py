"""Air drag of the airframe with an area per axis."""

import numpy as np

from wrenchgap.flight.flight import GRAVITY
from wrenchgap.plant.effects.body_drag import BodyDrag
from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, force_at
from wrenchgap.plant.vehicle import Vehicle


class BodyDragAreas(BodyDrag):
    """Drag on the body along the velocity's components, each with its own area, in the square of the speed.

        F_i = -1/2 rho A_i |v| v_i   (i = x, y, z of B),   at the centre of mass

    v is the velocity through the air, A_i the drag area, coefficient times area. Where all are equal this is a drag
    against the velocity.
    Source: Hoerner, "Fluid-Dynamic Drag", 1965; the parasitic drag of rotorpy, D = -|v| diag(c) v, c = 1/2 rho A (Folk,
    Paulos and Kumar, arXiv:2306.04485).
    """

    name = "body_drag_areas"
    form = "|v| v with an area per axis"
    accuracy = 0.1
    excited_by = "translation faster than about 2 m/s, in every body direction"
    confused_with = ("body_drag", "wind", "rotor_drag")
    linear = True

    air_density = 1.225
    """Of the International Standard Atmosphere at sea level [kg/m^3]."""

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Drag areas along body x, y and z (typical: a tenth of the weight at 5 m/s)."""
        weight = vehicle.body.mass * GRAVITY
        largest = 0.08 * weight / self.air_density
        return tuple(Parameter(f"area_{a}", "m^2", 0.0, largest, 0.1 * largest) for a in "xyz")

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """Drag force at the centre of mass, about O."""
        velocity_B = context.velocity_through_air_B
        speed = np.linalg.norm(velocity_B, axis=-1, keepdims=True)
        force = -0.5 * self.air_density * theta * speed * velocity_B
        return force_at(context.vehicle.body.com_B, force)
