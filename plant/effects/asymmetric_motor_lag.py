"""Rotors that speed up and slow down with different time constants."""

from __future__ import annotations

from dataclasses import replace

from wrenchgap.plant.effects.effect import Any, Array, CommandEffect, Commands, Context, Parameter
from wrenchgap.plant.effects.switched_lag import switched_lag
from wrenchgap.plant.vehicle import Vehicle


class AsymmetricMotorLag(CommandEffect):
    """Every rotor speed follows its command with one time constant up and another down.

        dOmega/dt = (Omega_cmd - Omega) / tau,   tau = tau_up where Omega_cmd > Omega, else tau_down

    The motor drives a rotor up; down, most speed controllers leave it to the air. Equal constants are `motor_lag`.
    Source: the rotor of RotorS (ethz-asl/rotors_simulator), timeConstantUp and timeConstantDown of FirstOrderFilter;
    omav.xacro has 12.5 ms up and 25 ms down.
    """

    name = "asymmetric_motor_lag"
    family = "motor_lag"
    form = "a time constant up and another down"
    excited_by = "thrust and torque that change by much at 1-5 Hz"
    confused_with = ("motor_lag", "command_delay", "servo_lag", "thrust_curve")
    order = 10
    needs_rotors = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """The time constants of speeding up and of slowing down."""
        return tuple(Parameter(name, "s", 0.0, 0.3, 0.03, start=0.02) for name in ("tau_up", "tau_down"))

    def apply(self, commands: Commands, theta: Array, context: Context, dt: float, memory: Any) -> tuple[Commands, Any]:
        """Rotor speeds, lagged."""
        assert commands.rotor_speed is not None
        speed, memory = switched_lag(commands.rotor_speed, float(theta[0]), float(theta[1]), dt, memory)
        return replace(commands, rotor_speed=speed), memory
