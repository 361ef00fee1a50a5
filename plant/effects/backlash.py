"""Play in the tilt mechanism."""

from dataclasses import replace

import numpy as np

from wrenchgap.plant.effects.effect import Any, Array, CommandEffect, Commands, Context, Parameter, tilting_arms
from wrenchgap.plant.vehicle import Vehicle


class Backlash(CommandEffect):
    """An arm follows its servo through a joint with play b: it rests until it is pushed.

        alpha[k] = min(max(alpha[k-1], c[k] - b/2), c[k] + b/2)         c: the servo's angle

    Source: the play operator, Visintin, "Differential Models of Hysteresis", 1994, III.2. N steps are a product of
    clamps, and clamps compose to clamps, so a prefix scan does them at once.
    """

    name = "backlash"
    needs_tilt = True
    accuracy = 0.1
    excited_by = "reversals of the tilt angles"
    confused_with = ("servo_lag", "tilt_offset")
    order = 20
    needs_rotors = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """The play, from stop to stop, the same on every tilting arm."""
        tilting_arms(vehicle, self.name)
        return (Parameter("play", "rad", 0.0, 0.05, 0.005, start=0.005),)

    def apply(self, commands: Commands, theta: Array, context: Context, dt: float, memory: Any) -> tuple[Commands, Any]:
        """Tilt angles after the play."""
        assert commands.tilt is not None
        half = 0.5 * theta
        before = commands.tilt[0] if memory is None else memory
        low, high = commands.tilt - half, commands.tilt + half
        step = 1
        while step < len(low):  # after this pass, row k stands for the last 2 step clamps up to k
            low[step:], high[step:] = (
                np.clip(low[:-step], low[step:], high[step:]),
                np.clip(high[:-step], low[step:], high[step:]),
            )
            step *= 2
        tilt = np.clip(before, low, high)
        return replace(commands, tilt=tilt), tilt[-1]
