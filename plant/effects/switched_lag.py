"""A first-order lag with one time constant while its output rises and another while it falls.

With the error e = u - y behind an input u that is linear between samples (slope m),

    de/dt = m - e / tau,    tau = tau_up where e > 0, tau_down where e < 0

While e keeps its sign, e(t) = m tau + (e_0 - m tau) exp(-t/tau). It changes sign at most once in a step, at
t* = tau ln(1 - e_0 / (m tau)), and only towards the sign of m, which it then keeps: a step y_0 -> y_1 is a closed form.
"""

from __future__ import annotations

import numpy as np

from wrenchgap.plant.effects.lag import Array, LagMemory

SHORTEST = 1e-9
"""Time constant [s] that stands for zero where only the other one is above zero."""


def switched_lag(signal: Array, up: float, down: float, dt: float, memory: LagMemory | None) -> tuple[Array, LagMemory]:
    """Lagged samples (N, D) of `signal` (N, D); starts in equilibrium where there is no memory (last input, output)."""
    if max(up, down) <= 0.0 or (memory is None and len(signal) == 1):  # no lag, or at rest
        return signal, (signal[-1], signal[-1])
    up, down = max(up, SHORTEST), max(down, SHORTEST)
    before, state = (signal[0], signal[0]) if memory is None else memory
    signal = np.ascontiguousarray(signal, dtype=float)  # a trace ends here: a step decides by the sign of its error
    from wrenchgap.plant.switched_kernel import steps  # numba: no help page waits for it

    out = steps(np.vstack((before[None], signal[:-1])), signal, np.array(state, float), up, down, dt)
    return out, (signal[-1], out[-1])
