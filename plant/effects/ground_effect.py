"""Rotors near the ground lift more."""

import numpy as np

from wrenchgap.flight.so3 import rotate
from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, ThrustEffect, Vehicle


class GroundEffect(ThrustEffect):
    """Near the ground thrust grows: T -> T / (1 - g (R / 4h)^2), with h = z - z_0 the height of the hub.

    The ground is at z_0 in E: rarely at zero, and for several rotors, whose wakes meet above it, effectively lower.
    Source: Cheeseman and Bennett, ARC R&M 3021, 1955, the image source below one rotor (g = 1); g above 1 for several
    rotors, Sanchez-Cuevas, Heredia and Ollero, Int. J. Aerospace Eng. 2017, 1823056. The denominator is kept above one
    half and h above R/4, where the formula has no meaning.
    """

    name = "ground_effect"
    family = "ground_effect"
    form = "each hub's own height"
    accuracy = 0.15
    excited_by = "a height scan below about four rotor radii"
    confused_with = ("thrust_scale", "mass", "ground_effect_one_height")
    needs_pose = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """The gain g, and the height z_0 of the ground in E."""
        return (Parameter("gain", "1", 0.0, 100.0, 3.0), Parameter("ground", "m", -0.5, 0.3, 0.1, alone=False))

    def unexcited(self, context: Context) -> str | None:
        """Above six rotor radii one rotor gains less than 0.2 % of thrust."""
        _, rotors = context.vehicle.geometry()
        limit = 6.0 * float(rotors.radius.max())
        lowest = float(context.state.position_E[:, 2].min())
        return f"never below {limit:.2g} m, six rotor radii (lowest {lowest:.2g} m)" if lowest > limit else None

    def apply(self, actuation: Actuation, theta: Array, context: Context) -> Array:
        """Thrusts (N, R) near the ground."""
        _, rotors = context.vehicle.geometry()
        h = np.maximum(self.heights_E(actuation, context) - theta[1], 0.25 * rotors.radius)
        return np.asarray(actuation.thrust / np.maximum(1.0 - theta[0] * (rotors.radius / (4.0 * h)) ** 2, 0.5))

    def heights_E(self, actuation: Actuation, context: Context) -> Array:
        """Of the rotors, (N, R) or (N, 1), in E [m]."""
        hubs = rotate(context.state.quat_EB[:, None], actuation.hub_B)[..., 2]
        return np.asanyarray(context.state.position_E[:, None, 2] + hubs)
