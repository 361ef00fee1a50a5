"""The minimum of a convex quadratic within bounds, for a few unknowns.

An active set, one unknown at a time (Stark and Parker, "Bounded-variable least squares", Computational Statistics 10,
1995): free unknowns go to their minimum, or as far as the first bound; where they are there, the bound is left that
the slope points away from most. `scipy.optimize.lsq_linear` finds the same (tests/learn/test_bounded.py); importing it
takes as long as all steps of `learn`.
"""

from __future__ import annotations

import numpy as np

from wrenchgap.flight.flight import Array

ROUNDS = 100
"""Changes of the active set for each unknown, at most; it needs one or two."""


def bounded_minimum(H: Array, g: Array, low: Array, high: Array) -> Array:
    """The x (P,) between `low` and `high` that minimises 1/2 x H x - g x, H (P, P) positive definite."""
    found = np.linalg.solve(H, g)
    if np.all((found >= low) & (found <= high)):
        return np.asarray(found)
    x = np.clip(found, low, high)
    free = (found > low) & (found < high)
    for _ in range(ROUNDS * len(g)):
        if free.any():
            aim = x.copy()
            aim[free] = np.linalg.solve(H[np.ix_(free, free)], g[free] - H[np.ix_(free, ~free)] @ x[~free])
            change = aim - x
            room = np.where(change > 0.0, high - x, x - low)
            share = np.where(
                free & (aim != x) & ((aim < low) | (aim > high)), room / np.maximum(np.abs(change), 1e-300), 1.0
            )
            first = int(np.argmin(share))
            if share[first] < 1.0:
                x = np.clip(x + share[first] * change, low, high)
                x[first] = high[first] if change[first] > 0.0 else low[first]
                free[first] = False
                continue
            x = aim
        slope = H @ x - g
        inward = np.where(x <= low, -slope, slope)
        inward[free | (low == high)] = 0.0
        worst = int(np.argmax(inward))
        if inward[worst] <= 1e-12 * (1.0 + np.abs(g[worst])):
            break
        free[worst] = True
    return np.asarray(x)
