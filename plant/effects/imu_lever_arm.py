"""An IMU that sits elsewhere than the model has it."""

from __future__ import annotations

from dataclasses import replace

from wrenchgap.plant.effects.com_offset import span
from wrenchgap.plant.effects.effect import Array, Context, Motion, Parameter, SensorEffect, Vehicle
from wrenchgap.plant.wrench_model import cross


class ImuLeverArm(SensorEffect):
    """The accelerometer sits r away from its nominal place: it feels domega x r + omega x (omega x r) more.

    Source: rigid-body kinematics. Size: our estimate, 1 to 5 cm.
    """

    name = "imu_lever_arm"
    excited_by = "angular rates and accelerations"
    confused_with = ("com_offset", "inertia")

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Offset along body x, y and z."""
        size = span(vehicle)
        return tuple(Parameter(a, "m", -0.7 * size, 0.7 * size, 0.07 * size) for a in "xyz")

    def apply(self, motion: Motion, theta: Array, context: Context) -> Motion:
        """What the accelerometer feels."""
        w = motion.omega_B
        more = cross(motion.omega_dot_B, theta) + cross(w, cross(w, theta))
        return replace(motion, specific_force_B=motion.specific_force_B + more)
