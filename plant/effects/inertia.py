"""Inertia other than the model's."""

from dataclasses import replace

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.plant.effects.effect import Array, BodyEffect, Parameter, is_tight, with_prior
from wrenchgap.plant.vehicle import Body, Vehicle

_PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


class Inertia(BodyEffect):
    """The inertia about the centre of mass differs by a symmetric dJ.

    In terms of the nominal processing the torque residual is, to first order, -dJ domega - omega x dJ omega.
    Source: Euler's equation, docs/effects/inertia.md.
    """

    name = "inertia"
    excited_by = "angular acceleration on every axis (multisine)"
    confused_with = ("thrust_scale", "thrust_curve", "servo_lag", "motor_lag", "command_delay")

    typical_moment, typical_product = 0.1, 0.03
    """Typical errors of moments and products of inertia that were not measured, relative to the moments."""

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """The six independent entries of dJ."""
        J, tolerance = vehicle.body.inertia, vehicle.tolerances.inertia
        found = []
        for i, k in _PLACES:
            size = float(np.sqrt(J[i, i] * J[k, k]))
            typical = (self.typical_moment if i == k else self.typical_product) * size
            usual = Parameter("xyz"[i] + "xyz"[k], "kg m^2", -0.4 * size, 0.4 * size, typical)
            found.append(with_prior(usual, None if tolerance is None else float(tolerance[i, k]), -0.6 * size))
        return tuple(found)

    def known(self, vehicle: Vehicle) -> str | None:
        """Every moment measured, to much less than what is typical."""
        tolerance, moments = vehicle.tolerances.inertia, np.diag(vehicle.body.inertia)
        if tolerance is None or not is_tight(np.diag(tolerance), self.typical_moment * moments):
            return None
        share = float(np.max(np.diag(tolerance) / moments))
        return f"the model file knows the moments of inertia to {100.0 * share:.2g} %"

    def apply(self, body: Body, theta: Array) -> Body:
        """The body with J + dJ."""
        dJ = np.zeros((3, 3))
        for value, (i, k) in zip(theta, _PLACES, strict=True):
            dJ[i, k] = dJ[k, i] = value
        try:
            return replace(body, inertia=body.inertia + dJ)
        except ModelError as error:
            raise ModelError(f"effect inertia: the change {theta.tolist()} kg m^2 is too large; {error}") from None
