"""The classical Runge-Kutta method of fourth order on a tuple of floats.

    k1 = f(y), k2 = f(y + h/2 k1), k3 = f(y + h/2 k2), k4 = f(y + h k3);   y <- y + h/6 (k1 + 2 k2 + 2 k3 + k4)

Tuples of floats, not arrays: for a dozen numbers this is several times faster. A quaternion among them is brought
back to unit norm by the caller after each step; its drift is of the order of the method's own error, so that the
order is kept (tests/plant/test_rigid_body.py measures it).
"""

from __future__ import annotations

from collections.abc import Callable

Floats = tuple[float, ...]


def rk4(derivative: Callable[[Floats], Floats], y: Floats, h: float) -> Floats:
    """One step of length `h` for the autonomous system y' = derivative(y)."""
    half, sixth = 0.5 * h, h / 6.0
    k1 = derivative(y)
    k2 = derivative(tuple([a + half * b for a, b in zip(y, k1, strict=True)]))
    k3 = derivative(tuple([a + half * b for a, b in zip(y, k2, strict=True)]))
    k4 = derivative(tuple([a + h * b for a, b in zip(y, k3, strict=True)]))
    return tuple([a + sixth * (b + 2.0 * (c + d) + e) for a, b, c, d, e in zip(y, k1, k2, k3, k4, strict=True)])
