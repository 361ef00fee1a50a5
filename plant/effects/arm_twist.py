"""Arms that twist under load."""

from dataclasses import replace

import numpy as np

from wrenchgap.plant.effects.effect import Any, Array, CommandEffect, Context, Parameter, tilting_arms, weight_scale
from wrenchgap.plant.state import Commands
from wrenchgap.plant.vehicle import Vehicle


class ArmTwist(CommandEffect):
    """An arm turns further by an angle in proportion to its thrust: dalpha_i = q T_i, q = lever / stiffness.

    The lever is that of the thrust about the arm's elastic axis, the stiffness that of arm and joint together; T_i is
    the arm's nominal thrust c_f Omega |Omega|, both rotors. Source: Saint-Venant torsion. Size: our
    estimate of 50-300 Nm/rad for such arms, which at a lever of 0.3 m are 1-6 mrad/N.
    """

    name = "arm_twist"
    needs_tilt = True
    excited_by = "thrust that changes while the arms are tilted"
    confused_with = ("tilt_offset", "com_offset")
    order = 40
    needs_rotors = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Twist per thrust, the same on every tilting arm."""
        arms = tilting_arms(vehicle, self.name)
        per_arm = weight_scale(vehicle) / len(arms)
        return (Parameter("twist", "rad/N", -0.1 / per_arm, 0.1 / per_arm, 0.015 / per_arm),)

    def apply(self, commands: Commands, theta: Array, context: Context, dt: float, memory: Any) -> tuple[Commands, Any]:
        """Tilt angles plus twist."""
        assert commands.tilt is not None
        assert commands.rotor_speed is not None
        arms, rotors = context.vehicle.geometry()
        speed = commands.rotor_speed
        thrust = (rotors.c_f * speed * np.abs(speed)) @ (rotors.arm[:, None] == np.arange(len(arms)))
        return replace(commands, tilt=commands.tilt + theta[0] * thrust * arms.tilts), None
