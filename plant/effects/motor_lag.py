"""Rotors that spin up late."""

from dataclasses import replace

from wrenchgap.plant.effects.effect import Any, Array, CommandEffect, Commands, Context, Parameter
from wrenchgap.plant.effects.lag import first_order
from wrenchgap.plant.vehicle import Vehicle


class MotorLag(CommandEffect):
    """Every rotor speed follows its command as a first-order lag: dOmega/dt = (Omega_cmd - Omega) / tau.

    One time constant for both directions; `asymmetric_motor_lag` has two. Source: the first-order rotor of RotorS
    (ethz-asl/rotors_simulator), whose omav.xacro has 12.5 ms up and 25 ms down.
    """

    name = "motor_lag"
    family = "motor_lag"
    form = "one time constant"
    excited_by = "torque about x and y at 1-5 Hz"
    confused_with = ("command_delay", "servo_lag", "asymmetric_motor_lag")
    order = 10
    needs_rotors = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """The time constant."""
        return (Parameter("tau", "s", 0.0, 0.3, 0.03, start=0.02),)

    def apply(self, commands: Commands, theta: Array, context: Context, dt: float, memory: Any) -> tuple[Commands, Any]:
        """Rotor speeds, lagged."""
        assert commands.rotor_speed is not None
        speed, memory = first_order(commands.rotor_speed, theta, dt, memory)
        return replace(commands, rotor_speed=speed), memory
