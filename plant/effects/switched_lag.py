"""A first-order lag with one time constant while its output rises and another while it falls.

With the error e = u - y behind an input u that is linear between samples (slope m),

    de/dt = m - e / tau,    tau = tau_up where e > 0, tau_down where e < 0

While e keeps its sign, e(t) = m tau + (e_0 - m tau) exp(-t/tau). It changes sign at most once in a step, at
t* = tau ln(1 - e_0 / (m tau)), and only towards the sign of m, which it then keeps: a step y_0 -> y_1 is a closed form.

N steps in a row are the triangular system y_k = phi_k(y_{k-1}), solved for all samples at once by Newton's method. phi
rises with slopes below one; it is convex where tau_up < tau_down and concave where tau_up > tau_down, since dy/dt is so
in y. The inverse of the system's derivative has no negative entry, so the iterates approach the solution from one side,
from any start (monotone Newton theorem: Ortega and Rheinboldt, "Iterative Solution of Nonlinear Equations in Several
Variables", 1970, 13.3.4).
"""

from __future__ import annotations

import numpy as np

from wrenchgap.plant.effects.lag import Array, LagMemory, first_order

SHORTEST = 1e-9
"""Time constant [s] that stands for zero where only the other one is above zero."""
CLOSE = 1e-8
"""Step of Newton's method, relative to the largest sample, that is its last: the next would be about its square."""


def switched_lag(signal: Array, up: float, down: float, dt: float, memory: LagMemory | None) -> tuple[Array, LagMemory]:
    """Lagged samples (N, D) of `signal` (N, D); starts in equilibrium where there is no memory (last input, output)."""
    if max(up, down) <= 0.0:
        return signal, (signal[-1], signal[-1])
    up, down = max(up, SHORTEST), max(down, SHORTEST)
    before, state = (signal[0], signal[0]) if memory is None else memory
    inputs = np.vstack((before[None], signal[:-1])), signal
    if len(signal) == 1:
        out, _ = step(*inputs, state[None], up, down, dt)
        return out, (signal[-1], out[-1])
    from wrenchgap.plant.switched_kernel import steps  # numba: no help page waits for it

    out = steps(np.ascontiguousarray(inputs[0]), np.ascontiguousarray(signal), np.array(state, float), up, down, dt)
    return out, (signal[-1], out[-1])


def solved_at_once(
    signal: Array, up: float, down: float, dt: float, memory: LagMemory | None
) -> tuple[Array, LagMemory]:
    """`switched_lag` in plain numpy, all samples together: what the compiled steps are compared with."""
    before, state = (signal[0], signal[0]) if memory is None else memory
    inputs = np.vstack((before[None], signal[:-1])), signal
    out, _ = first_order(signal, (up * down) ** 0.5, dt, (before, state))
    enough = CLOSE * float(np.abs(signal).max())
    for _ in range(len(signal)):  # after k iterations the first k samples are exact, so this always ends
        reached, slope = step(*inputs, np.vstack((state[None], out[:-1])), up, down, dt)
        change = chained(slope, reached - out)
        out = out + change
        if float(np.abs(change).max()) <= enough:
            break
    return out, (signal[-1], out[-1])


def step(start: Array, end: Array, output: Array, up: float, down: float, dt: float) -> tuple[Array, Array]:
    """Outputs (N, D) a step after `output`, while the input goes from `start` to `end`; and their derivative."""
    error, ramp = start - output, (end - start) / dt
    rising = np.where(error == 0.0, ramp, error) > 0.0
    tau, other = np.where(rising, up, down), np.where(rising, down, up)
    slope = np.where(rising, float(np.exp(-dt / up)), float(np.exp(-dt / down)))
    lag = ramp * tau
    left = lag + (error - lag) * slope
    turns = left * error < 0.0
    if turns.any():
        m, tau, other = ramp[turns], tau[turns], other[turns]
        reach = tau * np.log1p(-error[turns] / (m * tau))
        rest = np.exp(-(dt - reach) / other)
        left[turns] = m * other * (1.0 - rest)
        slope[turns] = np.exp(-reach / tau) * rest
    return end - left, slope


def chained(slope: Array, right: Array) -> Array:
    """The x (N, D) with x_k - slope_k x_{k-1} = right_k, x before the first sample zero."""
    from scipy.linalg.lapack import dtbtrs  # here: others need not wait for it

    count, columns = right.shape
    coupling = slope.T.copy()
    coupling[:, 0] = 0.0  # the columns, one after the other, do not touch
    bands = np.zeros((2, count * columns), order="F")
    bands[1, :-1] = -coupling.ravel()[1:]
    solved, _ = dtbtrs(bands, right.T.reshape(-1, 1), uplo="L", diag="U")
    return np.asarray(solved.reshape(columns, count).T)
