"""Tilt servos that follow late."""

from dataclasses import replace

from wrenchgap.plant.effects.effect import Any, Array, CommandEffect, Commands, Context, Parameter, tilting_arms
from wrenchgap.plant.effects.lag import first_order
from wrenchgap.plant.vehicle import Vehicle


class ServoLag(CommandEffect):
    """Every tilt angle follows its command as a first-order lag: dalpha/dt = (alpha_cmd - alpha) / tau.

    Source: first-order model of a position servo, docs/effects/servo_lag.md. Size: our estimate, 15-90 ms.
    """

    name = "servo_lag"
    needs_tilt = True
    excited_by = "fast tilt; torque about z first, since tilting the arms makes it"
    confused_with = ("command_delay", "motor_lag", "asymmetric_motor_lag", "rotational_drag")
    order = 10
    needs_rotors = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """The time constant."""
        tilting_arms(vehicle, self.name)
        return (Parameter("tau", "s", 0.0, 0.3, 0.03, start=0.02),)

    def apply(self, commands: Commands, theta: Array, context: Context, dt: float, memory: Any) -> tuple[Commands, Any]:
        """Tilt angles, lagged."""
        assert commands.tilt is not None
        tilt, memory = first_order(commands.tilt, theta, dt, memory)
        return replace(commands, tilt=tilt), memory
