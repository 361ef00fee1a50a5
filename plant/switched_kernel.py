"""Steps of `plant.effects.switched_lag`, one after the other, compiled (docs/decisions/0026-compiled-kernels.md)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from wrenchgap.plant.effects.lag import Array


@njit(cache=True, nogil=True)
def steps(start: Array, end: Array, state: Array, up: float, down: float, dt: float) -> Array:
    """Outputs (N, D) of N steps from `state` (D,), while inputs go from `start` (N, D) to `end` (N, D)."""
    out = np.empty(end.shape)
    kept_up, kept_down = math.exp(-dt / up), math.exp(-dt / down)
    for k in range(len(end)):
        for d in range(end.shape[1]):
            error, ramp = start[k, d] - state[d], (end[k, d] - start[k, d]) / dt
            rising = (ramp if error == 0.0 else error) > 0.0
            tau, other = (up, down) if rising else (down, up)
            lag = ramp * tau
            left = lag + (error - lag) * (kept_up if rising else kept_down)
            if left * error < 0.0:
                reach = tau * math.log1p(-error / lag)
                left = ramp * other * (1.0 - math.exp(-(dt - reach) / other))
            state[d] = out[k, d] = end[k, d] - left
    return out
