"""Arms that stand at another angle than commanded."""

from dataclasses import replace

from wrenchgap.plant.effects.effect import Any, Array, CommandEffect, Commands, Context, Parameter, tilting_arms
from wrenchgap.plant.vehicle import Vehicle


class TiltOffset(CommandEffect):
    """Arm i stands at alpha_i + d_i: servo zero, horn spline, bent arm.

    To first order dW = sum_i d_i T_i dn_i/dalpha with its lever arms, linear in W_cmd under the pseudo-inverse.
    Source: the geometry of `plant.vehicle` at another angle, docs/effects/tilt_offset.md.
    """

    name = "tilt_offset"
    needs_tilt = True
    excited_by = "every tilt; in hover a common offset is a yaw torque"
    confused_with = ("constant_wrench", "com_offset", "arm_twist", "imu_misalignment")
    order = 30
    needs_rotors = True
    sparse = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """One angle per tilting arm."""
        arms = tilting_arms(vehicle, self.name)
        return tuple(Parameter(f"arm_{i}", "rad", -0.15, 0.15, 0.02) for i in range(len(arms)) if arms.tilts[i])

    def apply(self, commands: Commands, theta: Array, context: Context, dt: float, memory: Any) -> tuple[Commands, Any]:
        """Tilt angles plus their offsets."""
        arms, _ = context.vehicle.geometry()
        assert commands.tilt is not None
        tilt = commands.tilt.copy()
        tilt[:, arms.tilts] += theta
        return replace(commands, tilt=tilt), None
