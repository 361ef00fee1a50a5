"""Thrust that falls steadily with time, where no voltage says why."""

import numpy as np

from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, Vehicle, WrenchEffect


class ThrustFade(WrenchEffect):
    """Every thrust, and with it every drag torque, falls in proportion to time: dW = -r t W, right at t = 0.

    t is the time since the log's first sample, whatever clock stamped it. It stands in for `battery_sag` where no
    voltage is logged; thrust that is off at t = 0 already is a `thrust_scale`.
    Source: first order in t of thrust = (V / V_0)^k (`battery_sag`) while the voltage falls steadily.
    """

    name = "thrust_fade"
    excited_by = "minutes in the air (for logs without a voltage)"
    stands_in_for = "battery_sag"
    confused_with = ("battery_sag", "thrust_scale")

    min_time, min_span = 20.0, 15.0
    """Time since the log's first sample that must be reached, and that must be flown in one piece [s]."""
    linear = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Share of the thrust that is lost every minute."""
        return (Parameter("rate", "1/min", 0.0, 0.2, 0.02),)

    def unexcited(self, context: Context) -> str | None:
        """With a voltage `battery_sag` is the one to try; a short flight shows a thrust scale."""
        time = context.state.time
        if context.state.voltage is not None:
            return "the log has a voltage, which battery_sag goes by"
        if time[-1] < self.min_time or np.ptp(time) < self.min_span:
            return (
                f"flown for {np.ptp(time):.0f} s, until {time[-1]:.0f} s after the log's first sample; expected "
                f"{self.min_span:.0f} s in one piece, until {self.min_time:.0f} s or later"
            )
        return None

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """The added wrench -r t W."""
        return np.asarray(-theta[0] * (context.state.time / 60.0)[:, None] * wrench_B)
