"""Rotors that speed up and slow down with different time constants."""

import math
from dataclasses import replace

import numpy as np
from numba import njit

from wrenchgap.plant.effects.effect import Any, Array, CommandEffect, Commands, Context, Parameter
from wrenchgap.plant.effects.lag import LagMemory
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


def switched_lag(signal: Array, up: float, down: float, dt: float, memory: LagMemory | None) -> tuple[Array, LagMemory]:
    """Lagged samples (N, D) of `signal` (N, D), and the last input and output for the next call.

    The lag has the time constant `up` [s] while its output rises and `down` [s] while it falls; without memory it
    starts in equilibrium. With the error e = u - y behind an input u that is linear between samples (slope m),

        de/dt = m - e / tau,    tau = tau_up where e > 0, tau_down where e < 0

    While e keeps its sign, e(t) = m tau + (e_0 - m tau) exp(-t/tau). It changes sign at most once in a step, at
    t* = tau ln(1 - e_0 / (m tau)), and only towards the sign of m, which it then keeps: a closed form.
    """
    if max(up, down) <= 0.0 or (memory is None and len(signal) == 1):  # no lag, or at rest
        return signal, (signal[-1], signal[-1])
    up, down = max(up, 1e-9), max(down, 1e-9)  # one of them may be zero
    before, state = (signal[0], signal[0]) if memory is None else memory
    signal = np.ascontiguousarray(signal, dtype=float)  # a trace ends here: a step decides by the sign of its error
    out = _switched_steps(np.vstack((before[None], signal[:-1])), signal, np.array(state, float), up, down, dt)
    return out, (signal[-1], out[-1])


@njit(cache=True, nogil=True)
def _switched_steps(start: Array, end: Array, state: Array, up: float, down: float, dt: float) -> Array:
    """Outputs (N, D) of N steps from `state` (D,), while inputs go from `start` (N, D) to `end` (N, D)."""
    out = np.empty(end.shape)
    kept_up, kept_down = math.exp(-dt / up), math.exp(-dt / down)
    for k in range(len(end)):
        for d in range(end.shape[1]):
            error, ramp = start[k, d] - state[d], (end[k, d] - start[k, d]) / dt
            rising = (ramp if error == 0.0 else error) > 0.0
            tau, other = (up, down) if rising else (down, up)
            lag = ramp * tau
            remaining = lag + (error - lag) * (kept_up if rising else kept_down)
            if remaining * error < 0.0:
                reach = tau * math.log1p(-error / lag)
                remaining = ramp * other * (1.0 - math.exp(-(dt - reach) / other))
            state[d] = out[k, d] = end[k, d] - remaining
    return out
