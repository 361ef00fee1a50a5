"""Rotor drag torque other than the model's."""

import numpy as np

from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, Vehicle, WrenchEffect, pure_torque


class DragTorque(WrenchEffect):
    """Every rotor's drag torque per thrust is (1 + k) kappa: dM = -sum_r spin_r k kappa_r T_r n_r.

    T_r is the thrust with all effects on it: a rotor that lifts less drags less. It cancels in a coaxial pair at equal
    thrusts. Source: actio and reactio between rotor and hull, as in the nominal
    model (`plant/actuation.py`); kappa = C_Q R / C_T of blade element theory. Size: our estimate.
    """

    name = "drag_torque"
    family = "drag_torque"
    form = "in proportion to the thrust"
    excited_by = "unequal speeds within a pair; on fixed-rotor vehicles, yaw"
    confused_with = ("drag_torque_of_speed", "tilt_offset", "constant_wrench")
    needs_rotors = True
    linear = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Relative change of kappa."""
        return (Parameter("change", "1", -0.8, 1.5, 0.3),)

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """The added torque."""
        assert actuation is not None
        _, rotors = context.vehicle.geometry()
        turned = theta * rotors.spin * rotors.kappa * actuation.thrust
        return pure_torque(-np.einsum("nr,nri->ni", turned, actuation.normal_B))
