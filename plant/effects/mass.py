"""Mass other than the model's."""

from __future__ import annotations

from dataclasses import replace

from wrenchgap.plant.effects.effect import Array, Body, BodyEffect, Parameter, Vehicle


class Mass(BodyEffect):
    """The vehicle weighs m + dm, its centre of mass and inertia being as the model has them.

    The nominal processing then reads a force residual -(dm / (m + dm)) F. Source: Newton's second law.
    A set of scales settles it.
    """

    name = "mass"
    excited_by = "any thrust; shows in force only, as |F| against m g"
    confused_with = ("thrust_scale", "payload", "battery_sag")

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """The added mass."""
        m = vehicle.body.mass
        return (Parameter("added", "kg", -0.2 * m, 0.3 * m, 0.03 * m),)

    def apply(self, body: Body, theta: Array) -> Body:
        """The body with m + dm."""
        return replace(body, mass=body.mass + float(theta[0]))
