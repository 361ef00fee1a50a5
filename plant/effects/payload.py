"""Something fixed to the vehicle that the model does not know of."""

import numpy as np

from wrenchgap.plant.effects.com_offset import span
from wrenchgap.plant.effects.effect import Array, Body, BodyEffect, Parameter, Vehicle


class Payload(BodyEffect):
    """A point mass dm held at p: mass, centre of mass and inertia change together.

        m' = m + dm,   c' = (m c + dm p) / m',   J' about c' = J + (m dm / m') (|d|^2 I - d d^T),   d = p - c

    Source: parallel axis theorem.
    """

    name = "payload"
    excited_by = "weight, and tilt about two axes; rates for its inertia"
    confused_with = ("mass", "com_offset", "tether", "thrust_scale")
    parts = ("mass", "com_offset", "inertia")

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Mass, and place from O along body x, y and z."""
        m, size = vehicle.body.mass, span(vehicle)
        place = tuple(Parameter(a, "m", -2.0 * size, 2.0 * size, 0.3 * size, alone=False) for a in "xyz")
        return (Parameter("mass", "kg", 0.0, 0.5 * m, 0.05 * m), *place)

    def apply(self, body: Body, theta: Array) -> Body:
        """The body with the point mass on it."""
        dm = float(theta[0])
        if dm == 0.0:
            return body
        total = body.mass + dm
        d = theta[1:] - body.com_B
        inertia = body.inertia + body.mass * dm / total * (d @ d * np.eye(3) - np.outer(d, d))
        return Body(total, inertia, (body.mass * body.com_B + dm * theta[1:]) / total)
