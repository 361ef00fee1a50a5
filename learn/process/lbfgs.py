"""Limited-memory BFGS: minima of smooth functions of some twenty unknowns, without bounds.

Directions by two recursions over the last steps s and changes of slope y (Nocedal and Wright, Numerical Optimization,
2nd ed., algorithm 7.4), with (s y) / (y y) I in place of what is forgotten; steps by the line search of More and
Thuente (ACM Trans. Math. Softw. 20, 1994, section 4 for the trial values). Constants and ends are those of scipy's
L-BFGS-B, which takes the same steps but for rounding where nothing is bounded (tests/learn/test_lbfgs.py); importing
scipy.optimize takes as long as a fifth of the searches of `learn`.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import njit

from wrenchgap.flight.flight import Array

Objective = Callable[[Array], tuple[float, Array]]
"""Unknowns (P,) -> value and slope (P,)."""

MEMORY = 10
"""Steps that are remembered."""
LESS, FLATTER, NARROW = 1e-3, 0.9, 0.1
"""A step has to have this share of the promised decrease and at most this share of the slope; or it is known to this
share of itself."""
TRIALS = 20
"""Values at most along one direction."""
SAME, FLAT = 2.220446049250313e-09, 1e-5
"""Relative decrease and largest slope at which the search ends."""
FAR = 1e10
EPSILON = float(np.finfo(float).eps)


def minimise(objective: Objective, start: Array, most: int) -> tuple[float, Array]:
    """Value and unknowns (P,) at a minimum, from `start`, after at most `most` steps or values or so."""
    x = np.array(start, dtype=float)
    value, slope = objective(x)
    steps, changes, calls = np.empty((0, len(x))), np.empty((0, len(x))), 1
    for count in range(most):
        if np.abs(slope).max() <= FLAT or calls > most:
            break
        found = None
        while found is None:
            found, used = _along(objective, x, value, slope, _direction(slope, steps, changes), first=not count)
            calls += used
            if found is None:
                if not len(steps):
                    return value, x
                steps, changes = steps[:0], changes[:0]
        before, (step, value, new) = value, found
        x = x + step
        change, slope = new - slope, new
        if before - value <= SAME * max(abs(before), abs(value), 1.0):
            break
        if step @ change > EPSILON * -(step @ (slope - change)):
            steps = np.concatenate((steps[-MEMORY + 1 :], step[None]))
            changes = np.concatenate((changes[-MEMORY + 1 :], change[None]))
    return value, x


@njit(cache=True)
def _direction(slope: Array, steps: Array, changes: Array) -> Array:
    """Down from a place with this slope (P,), by the last `steps` and `changes` (K, P) of the slope."""
    down = -slope
    count = len(steps)
    if count == 0:
        return down
    share, curve = np.empty(count), np.empty(count)
    for k in range(count - 1, -1, -1):
        curve[k] = np.sum(steps[k] * changes[k])
        share[k] = np.sum(steps[k] * down) / curve[k]
        down -= share[k] * changes[k]
    down *= curve[count - 1] / np.sum(changes[count - 1] ** 2)
    for k in range(count):
        down += (share[k] - np.sum(changes[k] * down) / curve[k]) * steps[k]
    return down


def _along(
    objective: Objective, x: Array, value: float, slope: Array, direction: Array, *, first: bool
) -> tuple[tuple[Array, float, Array] | None, int]:
    """The step (P,) along a direction with value and slope (P,) there, None where there is none, and how often the
    objective was asked.
    """  # noqa: D205
    start = float(direction @ slope)
    if not start < 0.0:
        return None, 0
    wanted = LESS * start
    size = min(1.0 / math.sqrt(float(direction @ direction)), FAR) if first else 1.0
    low = high = (0.0, value, start)
    bracketed, modified = False, True
    least, largest, width, last = 0.0, 5.0 * size, FAR, 2.0 * FAR
    for count in range(1, TRIALS + 1):
        step = size * direction
        there, new = objective(x + step)
        along = float(direction @ new)
        enough = value + size * wanted
        modified = modified and not (there <= enough and along >= 0.0)
        lost = bracketed and (size <= least or size >= largest or largest - least <= NARROW * largest)
        lost = lost or (size == FAR and there <= enough and along <= wanted) or size == 0.0
        if lost or (there <= enough and abs(along) <= -FLATTER * start):
            return (step, there, new), count
        tilt = wanted if modified and enough < there <= low[1] else 0.0
        parts = [(at, f - at * tilt, g - tilt) for at, f, g in (low, high, (size, there, along))]
        try:
            low, high, size, bracketed = _trial(parts[0], parts[1], parts[2], bracketed, least, largest)
        except ZeroDivisionError:  # flat to the last digit
            return None, count
        low, high = ((at, f + at * tilt, g + tilt) for at, f, g in (low, high))
        if bracketed:
            if abs(high[0] - low[0]) >= 0.66 * last:
                size = low[0] + 0.5 * (high[0] - low[0])
            last, width = width, abs(high[0] - low[0])
            least, largest = min(low[0], high[0]), max(low[0], high[0])
        else:
            least, largest = size + 1.1 * (size - low[0]), size + 4.0 * (size - low[0])
        size = min(max(size, 0.0), FAR)
        if bracketed and (size <= least or size >= largest or largest - least <= NARROW * largest):
            size = low[0]
    return None, TRIALS


Place = tuple[float, float, float]
"""Along a direction: step, value, slope."""


def _trial(
    low: Place, high: Place, now: Place, bracketed: bool, least: float, largest: float
) -> tuple[Place, Place, float, bool]:
    """The ends of the interval that holds a minimum, the next step, and whether there are two ends; see the source."""
    (a, fa, ga), b, (t, ft, gt) = low, high[0], now
    if ft > fa:  # higher: a minimum lies between
        cubic, parabola = _cubic(low, now), a + 0.5 * (t - a) * ga / ((fa - ft) / (t - a) + ga)
        nearer = abs(cubic - a) < abs(parabola - a)
        return low, now, cubic if nearer else cubic + 0.5 * (parabola - cubic), True
    if gt * ga < 0.0:  # beyond a minimum
        cubic, secant = _cubic(now, low), t + gt / (gt - ga) * (a - t)
        return now, low, cubic if abs(cubic - t) > abs(secant - t) else secant, True
    if abs(gt) < abs(ga):  # flatter
        secant, cubic = t + gt / (gt - ga) * (a - t), _cubic_beyond(low, now, least, largest)
        if bracketed:
            size = cubic if abs(cubic - t) < abs(secant - t) else secant
            bound = t + 0.66 * (b - t)
            return now, high, min(bound, size) if t > a else max(bound, size), True
        size = cubic if abs(cubic - t) > abs(secant - t) else secant
        return now, high, min(max(size, least), largest), False
    if bracketed:  # as steep
        return now, high, _cubic(now, high), True
    return now, high, largest if t > a else least, False


def _cubic(one: Place, other: Place) -> float:
    """Where the cubic through two places with these slopes is least, seen from the first."""
    (a, fa, ga), (b, fb, gb) = one, other
    theta = 3.0 * (fa - fb) / (b - a) + ga + gb
    scale = max(abs(theta), abs(ga), abs(gb))
    gamma = scale * math.sqrt(max((theta / scale) ** 2 - (ga / scale) * (gb / scale), 0.0))
    gamma = -gamma if b < a else gamma
    return a + ((gamma - ga) + theta) / (((gamma - ga) + gamma) + gb) * (b - a)


def _cubic_beyond(low: Place, now: Place, least: float, largest: float) -> float:
    """The same where the slope has not changed its sign: beyond the second place, or the limit on its side."""
    (a, fa, ga), (t, ft, gt) = low, now
    theta = 3.0 * (fa - ft) / (t - a) + ga + gt
    scale = max(abs(theta), abs(ga), abs(gt))
    gamma = scale * math.sqrt(max((theta / scale) ** 2 - (ga / scale) * (gt / scale), 0.0))
    gamma = -gamma if t > a else gamma
    ratio = ((gamma - gt) + theta) / ((gamma + (ga - gt)) + gamma)
    if ratio < 0.0 and gamma != 0.0:
        return t + ratio * (a - t)
    return largest if t > a else least
