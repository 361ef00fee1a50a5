"""The lower rotor of a coaxial pair loses what the upper one's wake takes from it."""

import numpy as np

from wrenchgap.plant.effects.coaxial_loss import CoaxialLoss, above
from wrenchgap.plant.effects.effect import Actuation, Array, Context


class CoaxialLossOfWake(CoaxialLoss):
    """The lower rotor loses thrust to the inflow that the upper one makes: T_l = c_f Omega_l^2 - eta sqrt(T_u c_f
    Omega_l^2).

    A blade's lift falls by an amount proportional to its speed and to the velocity of the air that comes from above,
    and that velocity goes with the root of the upper rotor's thrust T_u. At equal speeds the share eta, as in
    `coaxial_loss`; unlike there, one that depends on both rotors alike. The lower rotor's thrust stays positive.
    Source: Leishman, "Principles of Helicopter Aerodynamics", 2nd ed., 3.3 (blade element) and 2.15 (momentum theory).
    """  # noqa: D205

    name = "coaxial_loss_of_wake"
    form = "by the upper rotor's wake"
    confused_with = ("thrust_scale", "drag_torque", "coaxial_loss")

    def apply(self, actuation: Actuation, theta: Array, context: Context) -> Array:
        """Thrusts (N, R), the lower ones reduced."""
        upper = above(context.vehicle)
        wakes = np.where(upper >= 0, np.maximum(actuation.thrust[:, upper], 0.0), 0.0)
        lost = theta[0] * np.sqrt(wakes * np.maximum(actuation.thrust, 0.0))
        return np.asarray(actuation.thrust - np.minimum(lost, np.maximum(actuation.thrust, 0.0)))
