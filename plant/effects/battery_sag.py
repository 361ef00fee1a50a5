"""Thrust that falls with the battery's voltage."""

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, Vehicle, WrenchEffect


class BatterySag(WrenchEffect):
    """Thrust follows the voltage: dW = -k (V_0 - V) / V_0 W, right at the voltage V_0.

    The parameters are k and q = k / V_0, in which the effect is linear: dW = (q V - k) W.
    Source: first order in V_0 - V of thrust = (V / V_0)^k; speed goes with voltage where the speed controller is open
    loop, and thrust with the square of speed: k = 2, less where the controller makes up for it.
    """

    name = "battery_sag"
    excited_by = "voltage that falls during the flight"
    confused_with = ("thrust_scale", "mass", "thrust_fade")
    needs_voltage = True
    linear = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Sensitivity k, and k / V_0."""
        return (Parameter("sensitivity", "1", 0.0, 4.0, 0.5), Parameter("per_volt", "1/V", 0.0, 1.2, 0.05))

    def unexcited(self, context: Context) -> str | None:
        """A voltage that stays is a thrust scale."""
        voltage = context.state.voltage
        if voltage is None or np.ptp(voltage) < 0.01 * np.max(voltage):
            return "the voltage changes by less than 1 %"
        return None

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """The added (mostly negative) wrench."""
        voltage = context.state.voltage
        if voltage is None:
            raise ModelError(f"effect {self.name}: needs the battery's voltage, which this flight does not have")
        return np.asarray((theta[1] * voltage - theta[0])[:, None] * wrench_B)
