"""The small solves of the search over sets, compiled (docs/decisions/0026-compiled-kernels.md).

A search solves some ten thousand least-squares problems with five to thirty unknowns; as numpy calls they spend nine
tenths of their time outside arithmetic.
"""

import math

import numpy as np
from numba import njit

from wrenchgap.flight.flight import Array, Indices, Mask

TINY = 1e-14
"""Least pivot of a factorisation: what is smaller is rounding."""


@njit(cache=True, nogil=True)
def factor(A: Array) -> Array:
    """Upper triangle U (P, P) with U' U = A, positive definite, row by row; a pivot lost to rounding is tiny."""
    n = A.shape[0]
    U = np.zeros((n, n))
    for j in range(n):
        for i in range(j, n):
            U[j, i] = A[i, j]
    row = np.zeros(n)
    for j in range(n):
        U[j, j] = math.sqrt(max(U[j, j], TINY))
        for i in range(j + 1, n):
            U[j, i] /= U[j, j]
            row[i] = U[j, i]
        for i in range(j + 1, n):
            below, part, share = U[i, i:], row[i:], row[i]
            for k in range(len(part)):
                below[k] -= share * part[k]
    return U


@njit(cache=True, nogil=True)
def solve(U: Array, right: Array) -> Array:
    """The x (P,) with U' U x = right."""
    n = U.shape[0]
    x = right.copy()
    for k in range(n):
        x[k] /= U[k, k]
        row, value = U[k], x[k]
        for i in range(k + 1, n):
            x[i] -= row[i] * value
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= U[i, k] * x[k]
        x[i] /= U[i, i]
    return x


@njit(cache=True, nogil=True)
def scaled(A: Array, scale: Array) -> Array:
    """A in units of `scale`, plus one on the diagonal: the curvature with its prior."""
    n = len(scale)
    H = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            H[i, j] = A[i, j] * scale[i] * scale[j]
        H[i, i] += 1.0
    return H


@njit(cache=True, nogil=True)
def occam(A: Array, theta: Array, scale: Array) -> float:
    """The prior at theta times the width of the posterior: log of what the integral over theta adds."""
    U = factor(scaled(A, scale))
    total = 0.0
    for i in range(len(scale)):
        total -= 0.5 * (theta[i] / scale[i]) ** 2 + math.log(U[i, i])
    return total


@njit(cache=True, nogil=True)
def further_places(theta: Array, scale: Array, place: Array, sizes: Indices) -> float:
    """How many more places than one sparse effects are at, of members with so many parameters (members,).

    `place` (P,) is what each parameter counts for: 1 where it is a place's only one, 0 of an effect that is not sparse.

    Of theta with a prior of the size s that the evidence makes likely, s^2 = theta^2 + var(theta), the data determine
    the share theta^2 / s^2 = 1 - var(theta) / s^2. Source: MacKay, "Information Theory, Inference, and Learning
    Algorithms", 45.4 and eq. 28.19: well-determined parameters.
    """
    total, at = 0.0, 0
    for size in sizes:
        at_own = 0.0
        for i in range(at, at + size):
            at_own += place[i] * (theta[i] / scale[i]) ** 2
        total += max(at_own - 1.0, 0.0)
        at += size
    return total


@njit(cache=True, nogil=True)
def relevant(A: Array, b: Array, low: Array, high: Array, scale: Array, sparse: Mask, typical: Array) -> Array:
    """Sizes (P,) of the parameters' priors: those given, and of `sparse` ones those that the evidence makes likely.

    s^2 <- theta^2 + var(theta), theta within the limits, at least a hundredth of the `typical` sizes; at most eight
    times, until no size changes by a tenth. `A` (P, P) and `b` (P,) are the data's curvature and gradient, `scale` (P,)
    the sizes to begin at. Source: Tipping, JMLR 1, 2001, eq. 17.
    """
    if not np.any(sparse):
        return scale
    scale, one = scale.copy(), np.zeros(len(scale))
    for _ in range(8):
        U = factor(scaled(A, scale))
        theta = solve(U, b * scale) * scale
        most = 0.0
        for i in np.flatnonzero(sparse):
            one[:] = 0.0
            one[i] = scale[i]
            variance = solve(U, one)[i] * scale[i]
            size = max(math.sqrt(min(max(theta[i], low[i]), high[i]) ** 2 + variance), 1e-2 * typical[i])
            most = max(most, abs(math.log(size / scale[i])))
            scale[i] = size
        if most < 0.1:
            break
    return scale


@njit(cache=True, nogil=True)
def bounded(A: Array, b: Array, low: Array, high: Array, scale: Array) -> Array:
    """Where 1/2 theta A theta - b theta + 1/2 |theta / scale|^2 is least within the limits: an active-set method.

    Source: Nocedal and Wright, "Numerical Optimization", 2nd ed., 16.5.
    """
    H, g, lower, upper = scaled(A, scale), b * scale, low / scale, high / scale
    x, free, push = np.zeros(len(scale)), np.ones(len(scale), dtype=np.bool_), g
    for _ in range(40):
        inner, crossed = np.flatnonzero(free), False
        step = solve(factor(H[inner][:, inner]), push[inner])
        for k in range(len(inner)):
            i = inner[k]
            x[i] += step[k]
            if x[i] < lower[i] - 1e-12 or x[i] > upper[i] + 1e-12:
                x[i] = min(max(x[i], lower[i]), upper[i])
                free[i], crossed = False, True
        push = g - H @ x
        if crossed:
            continue
        worst, most = -1, 0.0
        for i in np.flatnonzero(~free):
            back = (x[i] <= lower[i] and push[i] > 1e-9) or (x[i] >= upper[i] and push[i] < -1e-9)
            if back and abs(push[i]) > most:
                worst, most = int(i), abs(push[i])
        if worst < 0:
            break
        free[worst] = True
    return np.minimum(np.maximum(x, lower), upper) * scale


@njit(cache=True, nogil=True)
def normal_equations(whole: Array, unknown: Indices, fixed: Indices) -> tuple[Array, Array, Array]:
    """Curvature (P, P) and gradient (P,) of a set with these `unknown` rows (P,) of `whole` (Q, Q), and the weights
    (1 + members,) of the `fixed` rows: the first is what is to be explained, and the others are taken off it.
    """  # noqa: D205
    weights = -np.ones(len(fixed))
    weights[0] = 1.0
    rows = whole[unknown]
    return rows[:, unknown], rows[:, fixed] @ weights, weights


@njit(cache=True, nogil=True)
def score(
    whole: Array,
    unknown: Indices,
    fixed: Indices,
    sizes: Indices,
    low: Array,
    high: Array,
    typical: Array,
    place: Array,
    accuracy: Array,
) -> tuple[float, float, float]:
    """A set's fit less what its laws may be off by, its Occam factor, and `further_places`.

    `whole` (Q, Q) are the weighed products, `unknown` (P,) and `fixed` (1 + members,) the rows of them that the set
    uses, `sizes` and `accuracy` (members,) the parameters of each and the share to which its law is known; the rest is
    (P,), of the unknowns.
    """
    A, b, weights = normal_equations(whole, unknown, fixed)
    scale = relevant(A, b, low, high, typical, place > 0.0, typical)
    theta = bounded(A, b, low, high, scale)
    given = weights @ normal_equations(whole, fixed, fixed)[1]
    fitted = -0.5 * (given - 2.0 * theta @ b + theta @ (A @ theta) - whole[0, 0])
    total, at = 0.0, 0
    for m in range(len(sizes)):
        offset, own = fixed[1 + m : 2 + m], theta[at : at + sizes[m]]
        curvature, slope, _ = normal_equations(whole, unknown[at : at + sizes[m]], offset)
        square = own @ (curvature @ own) + 2.0 * own @ slope + whole[offset[0], offset[0]]
        total += accuracy[m] * math.sqrt(max(square, 0.0))
        at += sizes[m]
    return fitted - 0.5 * total**2, occam(A, theta, scale), further_places(theta, scale, place, sizes)


@njit(cache=True, nogil=True)
def gains(whole: Array, unknown: Indices, fixed: Indices, rows: Indices, starts: Indices, scale: Array) -> Array:
    """What each of several candidates would take off what a set leaves, to second order and without bounds.

    `unknown` and `fixed` are the set's, as in `score`; candidate k has the rows `rows[starts[k]:starts[k + 1]]` of
    `whole` (Q, Q), its offset last. `scale` (Q,) are typical sizes.
    """
    A, b, _ = normal_equations(whole, unknown, fixed)
    usual = scale[unknown]
    U = factor(scaled(A, usual))
    out = np.empty(len(starts) - 1)
    for k in range(len(out)):
        own = rows[starts[k] : starts[k + 1]]
        H, left, _ = normal_equations(whole, own, fixed)
        shared = whole[own][:, unknown]
        for j in range(len(own)):
            known = solve(U, shared[j] * usual) * usual
            left[j] -= known @ b
            H[j] -= shared @ known
        left *= scale[own]
        out[k] = left @ solve(factor(scaled(H, scale[own])), left)
    return out
