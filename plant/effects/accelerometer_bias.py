"""An accelerometer with an offset."""

from wrenchgap.plant.effects.effect import Array, Context, Motion, Parameter, SensorEffect, Vehicle


class AccelerometerBias(SensorEffect):
    """The accelerometer reads f + b for the specific force f, with b constant in B.

    z_F = m b, z_M = 0 about O. A fit has a bias of its own for every flight, of up to 0.05 m/s^2 (5 mg), which is no
    news; this one is larger, and the same on all flights. Source: the bias of the usual error model of inertial sensors
    (IEEE Std 952; Woodman, "An introduction to inertial navigation", 2007). Size: consumer parts are given with 20 to
    80 mg over temperature where they are not calibrated (MPU-6050, BMI088 data sheets).
    """

    name = "accelerometer_bias"
    excited_by = "any flight; told from a force by turning the vehicle over on the bench"
    confused_with = ("constant_wrench", "mass", "thrust_scale", "imu_misalignment", "tether")

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Along body x, y and z."""
        return tuple(Parameter(a, "m/s^2", -1.0, 1.0, 0.1) for a in "xyz")

    def apply(self, motion: Motion, theta: Array, context: Context) -> Motion:
        """What the IMU reads."""
        return Motion(motion.omega_B, motion.omega_dot_B, motion.specific_force_B + theta)
