"""Air resists turning."""

import numpy as np

from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, Vehicle, WrenchEffect, pure_torque


class RotationalDrag(WrenchEffect):
    """Torque against the body rates: M = -d_1 omega - d_2 omega |omega|, axis by axis.

    Source: drag at the local velocity omega x r, the linear part mostly of the rotors (see `rotor_drag`), the quadratic
    of the booms (Hoerner, "Fluid-Dynamic Drag", 1965). Size: our estimate.
    """

    name = "rotational_drag"
    excited_by = "body rates on every axis"
    confused_with = ("axial_inflow", "rotor_drag", "servo_lag", "motor_lag")
    depends_on = "state"
    linear = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Linear coefficients about body x, y and z, and one quadratic coefficient; scaled to the inertia."""
        J = np.diag(vehicle.body.inertia)
        axes = zip("xyz", J, strict=True)
        linear = [Parameter(f"linear_{a}", "Nm s/rad", 0.0, 5.0 * j, 0.2 * j) for a, j in axes]
        return (*linear, Parameter("quadratic", "Nm s^2/rad^2", 0.0, 5.0 * J.mean(), 0.2 * J.mean()))

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """The added torque."""
        omega = context.state.omega_B
        torque = -theta[:3] * omega - theta[3] * omega * np.abs(omega)
        return pure_torque(torque)
