"""A force and torque that never change, fixed in the body."""

import numpy as np

from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, WrenchEffect
from wrenchgap.plant.vehicle import Vehicle


class ConstantWrench(WrenchEffect):
    """A constant wrench in B, about O: trim, a bias of the IMU or of the actuators taken together.

    Source: definition, docs/effects/constant_wrench.md.
    """

    name = "constant_wrench"
    excited_by = "always present; tilt separates it from forces fixed in E, thrust changes from gains"
    confused_with = ("accelerometer_bias", "tilt_offset", "com_offset", "tether")
    depends_on = "state"
    linear = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Force and torque along the body axes; scaled to the vehicle's weight and size."""
        body = vehicle.body
        force = 0.02 * body.mass * 9.81
        torque = force * float(np.sqrt(1.5 * np.trace(body.inertia) / body.mass))
        kinds = (("force", "N", force), ("torque", "Nm", torque))
        return tuple(Parameter(f"{kind}_{a}", unit, -10 * s, 10 * s, s) for kind, unit, s in kinds for a in "xyz")

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """The added wrench, the same in every sample."""
        return np.broadcast_to(theta, wrench_B.shape)
