"""An IMU that is mounted askew."""

from wrenchgap.plant.effects.effect import Array, Context, Motion, Parameter, SensorEffect, Vehicle
from wrenchgap.plant.wrench_model import cross


class ImuMisalignment(SensorEffect):
    """The IMU's axes are turned by the small rotation e against B: gyro and accelerometer read v - e x v for v in B.

    To first order z_F = -e x F, and z_M = -J (e x domega) at low rates (-e x M if J were a multiple of one). Right to
    second order in e: 0.06 % at 2 deg. Source: rotation of axes by a small angle. Size: our
    estimate, 0.5 to 2 deg.
    """

    name = "imu_misalignment"
    excited_by = "force in two body directions"
    confused_with = ("tilt_offset", "constant_wrench", "wind")

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Rotation about body x, y and z."""
        return tuple(Parameter(a, "rad", -0.15, 0.15, 0.02) for a in "xyz")

    def apply(self, motion: Motion, theta: Array, context: Context) -> Motion:
        """What the IMU reads."""
        return Motion(*(v - cross(theta, v) for v in (motion.omega_B, motion.omega_dot_B, motion.specific_force_B)))
