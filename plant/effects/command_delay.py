"""Commands that arrive late."""

from wrenchgap.plant.effects.effect import Any, Array, CommandEffect, Commands, Context, Parameter
from wrenchgap.plant.effects.lag import delay
from wrenchgap.plant.vehicle import Vehicle


class CommandDelay(CommandEffect):
    """Everything that is commanded takes effect d later: u(t) <- u(t - d). Bus, transport, ESC or clock.

    Source: definition of a transport delay, docs/effects/command_delay.md.
    """

    name = "command_delay"
    excited_by = "broadband commands; only the phase, axis by axis, separates it from the lags"
    confused_with = ("servo_lag", "motor_lag", "asymmetric_motor_lag")
    order = 0

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """The delay."""
        return (Parameter("delay", "s", 0.0, 0.2, 0.02, start=0.01),)

    def apply(self, commands: Commands, theta: Array, context: Context, dt: float, memory: Any) -> tuple[Commands, Any]:
        """Wrench, tilt angles and rotor speeds of d ago."""
        seconds = float(theta[0])
        held: dict[str, Array] = {} if memory is None else memory
        kept: dict[str, Array] = {}
        late: dict[str, Array] = {}
        for name in ("wrench_B", "tilt", "rotor_speed"):
            signal = getattr(commands, name)
            if signal is not None:
                late[name], kept[name] = delay(signal, seconds, dt, held.get(name))
        return Commands(**late), kept
