"""An IMU that sits elsewhere than the model has it."""

from dataclasses import replace

import numpy as np

from wrenchgap.plant.effects.com_offset import span
from wrenchgap.plant.effects.effect import Array, Context, Parameter, SensorEffect, is_tight, offset_parameters
from wrenchgap.plant.state import Motion
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import cross


class ImuLeverArm(SensorEffect):
    """The accelerometer sits r away from its nominal place: it feels domega x r + omega x (omega x r) more.

    Source: rigid-body kinematics. Size: our estimate, 1 to 5 cm.
    """

    name = "imu_lever_arm"
    excited_by = "angular rates and accelerations"
    confused_with = ("com_offset", "inertia")

    typical = 0.07
    """Typical error of an IMU's place that was not measured, in spans."""

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Offset along body x, y and z."""
        size = span(vehicle)
        return offset_parameters(0.7 * size, self.typical * size, -size, vehicle.tolerances.imu_position)

    def known(self, vehicle: Vehicle) -> str | None:
        """Measured, to much less than what is typical."""
        tolerance = vehicle.tolerances.imu_position
        if tolerance is None or not is_tight(tolerance, self.typical * span(vehicle)):
            return None
        return f"the model file knows the place of the IMU to {1e3 * float(np.max(tolerance)):.2g} mm"

    def apply(self, motion: Motion, theta: Array, context: Context) -> Motion:
        """What the accelerometer feels."""
        w = motion.omega_B
        more = cross(motion.omega_dot_B, theta) + cross(w, cross(w, theta))
        return replace(motion, specific_force_B=motion.specific_force_B + more)
