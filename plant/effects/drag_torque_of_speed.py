"""Rotor drag torque that the speed sets, whatever becomes of the thrust."""

import numpy as np

from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, Vehicle, WrenchEffect, pure_torque


class DragTorqueOfSpeed(WrenchEffect):
    """A rotor's drag torque goes with the square of its speed, also where its thrust is not what that makes.

        dM = -sum_r spin_r kappa_r (k T0_r + e (T0_r - T_r)) n_r,    T0_r = c_f Omega_r |Omega_r|

    T_r is the thrust with all effects on it (a weak rotor, losses within a pair, the ground), T0_r the nominal one at
    the same speed. Together with the nominal model's kappa_r T_r: for e = 1 the torque is (1 + k) kappa_r T0_r, for
    e = 0 the thrust's change is in it, as in `drag_torque`.
    Source: T = C_T rho A R^2 Omega^2 and Q = C_Q rho A R^3 Omega^2, of which C_Q has an induced part that grows as
    C_T^1.5 and a profile part that does not; Leishman, "Principles of Helicopter Aerodynamics", 2006, chapter 2. The
    share e between: our description.
    """

    name = "drag_torque_of_speed"
    family = "drag_torque"
    form = "set by the speed, whatever becomes of the thrust"
    excited_by = "yaw torque of rotors whose thrust is not nominal: one weak rotor, the lower one of a pair, the ground"
    confused_with = ("drag_torque", "tilt_offset", "constant_wrench")
    needs_rotors = True
    linear = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Relative change of kappa, and the share of the thrust's change that the drag torque does not have."""
        return (Parameter("change", "1", -0.8, 1.5, 0.3), Parameter("of_speed", "1", 0.0, 1.5, 0.5))

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """The added torque."""
        assert actuation is not None
        _, rotors = context.vehicle.geometry()
        change, of_speed = theta
        nominal = rotors.c_f * actuation.rotor_speed * np.abs(actuation.rotor_speed)
        thrust = change * nominal + of_speed * (nominal - actuation.thrust)
        torque = -np.einsum("nr,nri->ni", rotors.spin * rotors.kappa * thrust, actuation.normal_B)
        return pure_torque(torque)
