"""Arms that turn by another share of what is commanded."""

from dataclasses import replace

from wrenchgap.plant.effects.effect import Any, Array, CommandEffect, Commands, Context, Parameter, tilting_arms
from wrenchgap.plant.vehicle import Vehicle


class TiltScale(CommandEffect):
    """Every tilting arm stands at (1 + s) alpha_i: the servos' travel per pulse, the ratio of a gear or a linkage.

    To first order dW = sum_i s alpha_i T_i dn_i/dalpha with its lever arms. Source: the geometry of `plant.vehicle` at
    another angle, docs/effects/tilt_scale.md.
    """

    name = "tilt_scale"
    needs_tilt = True
    excited_by = "tilts of several sizes: forces along x and y, attitudes away from level"
    confused_with = ("thrust_scale", "mass", "accelerometer_bias", "imu_misalignment")
    order = 29
    needs_rotors = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """One for all arms: servos of one kind are set up alike."""
        tilting_arms(vehicle, self.name)
        return (Parameter("scale", "1", -0.3, 0.3, 0.05),)

    def apply(self, commands: Commands, theta: Array, context: Context, dt: float, memory: Any) -> tuple[Commands, Any]:
        """Tilt angles times 1 + s."""
        assert commands.tilt is not None
        return replace(commands, tilt=(1.0 + theta[0]) * commands.tilt), None
