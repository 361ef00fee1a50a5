"""Single rotors stronger or weaker than the model."""

import numpy as np

from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, ThrustEffect
from wrenchgap.plant.vehicle import Vehicle


class RotorThrust(ThrustEffect):
    """Rotor r makes (1 + e_r) times its nominal thrust: T_r = (1 + e_r) c_f Omega_r^2.

    Damage, wear, a wrong pitch. Damage takes thrust; a rotor lifts more than its type only by scatter between blades
    and motors, a few per cent, so that little is believed upwards. Source: T = c_f Omega^2 for every rotor on its own.
    """

    name = "rotor_thrust"
    excited_by = "tilt about two axes; force and torque together separate it from a centre-of-mass offset"
    confused_with = ("com_offset", "thrust_scale", "coaxial_loss", "constant_wrench")
    sparse = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """One relative change per rotor."""
        _, rotors = vehicle.geometry()
        return tuple(Parameter(f"rotor_{r}", "1", -0.6, 0.1, 0.05) for r in range(len(rotors)))

    def apply(self, actuation: Actuation, theta: Array, context: Context) -> Array:
        """Thrusts (N, R) times their gains."""
        return np.asarray(actuation.thrust * (1.0 + theta))
