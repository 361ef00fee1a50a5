"""All rotors stronger or weaker by the same factor."""

import numpy as np

from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, WrenchEffect
from wrenchgap.plant.vehicle import Vehicle


class ThrustScale(WrenchEffect):
    """Every thrust, and with it every drag torque, is (1 + s) times what the model says: dW = s W.

    Air density, propeller wear, a wrong c_f. Linear in the wrench, so it needs no geometry.
    Source: T = c_f Omega^2 with another c_f for all rotors.
    """

    name = "thrust_scale"
    excited_by = "any thrust: shows as |F| against m g"
    confused_with = ("mass", "coaxial_loss", "battery_sag", "inertia", "thrust_curve", "thrust_fade")
    linear = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """One relative change."""
        return (Parameter("scale", "1", -0.3, 0.3, 0.05),)

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """The added wrench s W."""
        return np.asarray(theta[0] * wrench_B)
