"""Mass other than the model's."""

from dataclasses import replace

from wrenchgap.plant.effects.effect import Array, Body, BodyEffect, Parameter, Vehicle, is_tight, with_prior


class Mass(BodyEffect):
    """The vehicle weighs m + dm, its centre of mass and inertia being as the model has them.

    The nominal processing then reads a force residual -(dm / (m + dm)) F. Source: Newton's second law.
    A set of scales settles it.
    """

    name = "mass"
    excited_by = "any thrust; shows in force only, as |F| against m g"
    confused_with = ("thrust_scale", "payload", "battery_sag")

    typical = 0.03
    """Typical error of a mass that was not weighed, relative."""

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """The added mass."""
        m = vehicle.body.mass
        usual = Parameter("added", "kg", -0.2 * m, 0.3 * m, self.typical * m)
        return (with_prior(usual, vehicle.tolerances.mass, -0.6 * m),)

    def known(self, vehicle: Vehicle) -> str | None:
        """Weighed, to much less than what is typical."""
        tolerance = vehicle.tolerances.mass
        if tolerance is None or not is_tight(tolerance, self.typical * vehicle.body.mass):
            return None
        return f"the model file knows the mass to {tolerance:.3g} kg"

    def apply(self, body: Body, theta: Array) -> Body:
        """The body with m + dm."""
        return replace(body, mass=body.mass + float(theta[0]))
