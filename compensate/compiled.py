"""A step of the compensation in compiled code, over as many periods as are at hand.

Pieces: a tape with its tangents, the expansion of a process, one proposal of Newton's method. Each has its
specification elsewhere, in plain numpy: the effects and `plant.wrench_model` for a tape, `learn.process.gp` for an
expansion, nlopt's L-BFGS for the optimum. numba compiles them once per machine (`cache=True`) and not again for another
vehicle: what differs between vehicles is data.

The step is what `compensate.compensator` does with plain models, in the same order: further inputs of the process, the
correction of the physics, the optimum of both, sigma, gate, correction, what the followers remember. A step that Newton
does not settle (ill-conditioned, not accepted, not finite) is left undone and handed back: L-BFGS decides there.
"""

# mypy: disable-error-code="no-any-return"
# Long because numba renews its cache by the file in which the outermost function stands, and by no other.

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from wrenchgap.compensate.reach import SLACK
from wrenchgap.compensate.step_row import (
    ACCEPTED,
    BETA,
    COMMAND,
    CORRECTED,
    COST,
    EVALUATIONS,
    EXPECTED,
    FOUND,
    LIMITED,
    SIGMA,
    STATE_MAX,
    TURN_MAX,
    TURN_MIN,
)
from wrenchgap.flight.flight import Array
from wrenchgap.plant.expansion import Expansion
from wrenchgap.plant.loop_kernels import value_of
from wrenchgap.plant.tape import Program

F = TypeVar("F", bound=Callable[..., Any])


def kernel_of(**options: Any) -> Callable[[F], F]:
    """Compiles functions that make no array, without numba's reference counts: a call of a function with forty arrays
    would pay for eighty of them.
    """  # noqa: D205
    numba: Any = njit  # whose annotations leave _nrt out
    return numba(cache=True, error_model="numpy", nogil=True, _nrt=False, **options)


opening = njit(cache=True, error_model="numpy", nogil=True)
"""For functions that make views which outlive them."""
compiled = kernel_of()
within = kernel_of(forceinline=True)
"""For functions that are handed the whole of a compensation, 3 kB, and do little with it."""
in_any_order = kernel_of(fastmath={"reassoc", "contract", "nsz"})
"""For sums whose order does not matter beyond rounding: they then take four or eight numbers at once. What is not
finite stays so."""
in_this_order = kernel_of(fastmath={"contract"})
"""For what would be wrong in another order; said, because numba otherwise hands the caller's choice on."""
inside = kernel_of(forceinline=True, fastmath={"contract"})
"""The same, for what stands in the loop of another function."""

INPUT, CONSTANT, ADD, SUB, MUL, DIV, NEG, SQRT, EXP, SIN, COS, ATAN2 = range(12)
ABS, SIGN, MAX, MIN, LESS, LESS_EQUAL, SELECT, FLOOR, LOG = range(12, 21)

PROPOSED, STATIONARY, SINGULAR = 0, 1, 2
ILL = 1e-3
"""Ratio of pivots of A^T A below which A = I + dmu/dW counts as ill-conditioned: singular values apart by 30."""

OPTIMUM, CORRECTION, KNOWN, STAGE, FRESH, BEFORE, LATE, SENT, TILT = 0, 6, 12, 18, 19, 20, 26, 32, 38
"""Where the memory of a compensation has what: three wrenches (6,); how many commands the process has seen (0, 1, 2);
whether the actuators were never commanded; last input and output of the lag of `past`, and the command sent last (6,)
each; then the physics' tilts and memory."""
DONE, HANDED_BACK = 0, 1
LINE = 8
"""Numbers of a line of the processor's cache: what begins with one is fetched in fewer pieces."""
BATCH = 16
"""Steps whose sigma is taken together: C^-1 is fetched once for all of them. Divisible by 4."""


class Lines(NamedTuple):
    """`tape.Program` as compiled code takes it, with room for values (n,) and tangents (n, L)."""

    code: NDArray[np.int32]
    split: int
    inputs: NDArray[np.int64]
    free: NDArray[np.int64]
    results: NDArray[np.int64]
    value: Array
    tangent: Array


class Kernel(NamedTuple):
    """`plant.expansion.Expansion` as compiled code takes it, its scales multiplied out: L outputs, D inputs, N points.

    mean = base + gradient . (xi - input_mean) + height sum_n alpha_n exp(-1/2 |narrow (xi - input_mean) - p_n|^2)
    """

    input_mean: Array  # (D,)
    base: Array  # (L,) output_scale b_0
    gradient: Array  # (L, D) output_scale b / input_scale
    height: Array  # (L,) output_scale signal_variance
    narrow: Array  # (L, D) 1 / (input_scale lengthscale)
    points: Array  # (L, D, N)
    alpha: Array  # (L, N)
    whitener: Array  # (L, N, N)
    triangular: bool
    signal_variance: Array  # (L,)
    noise_variance: Array  # (L,)
    std_scale: Array  # (L,) output_scale sigma_scale
    extent: Array  # (L, D) largest sizes of the points
    rows: Array  # (L, N) kernel values over the signal variance, at the inputs `at`
    sums: Array  # (L,) of `rows` with `alpha`
    at: Array  # (D,), nan before any
    moved: Array  # (1,) not 0 where `rows` came by `move`
    scaled: Array  # (L, 1 + D) scratch
    powers: Array  # (N,) scratch
    batch: Array  # (BATCH, L, N) rows of consecutive steps
    explained: Array  # (BATCH, L) scratch


def as_lines(program: Program | None, outputs: int) -> Lines:
    """Arrays of a program; empty ones where there is none."""
    none = np.zeros(0, dtype=np.int64)
    if program is None:
        empty = np.zeros((0, 4), dtype=np.int32)
        return Lines(empty, 0, none, none, none, np.zeros(0), np.zeros((0, outputs)))
    count = len(program.code)
    code = np.array(program.code, order="C")
    tangent = np.zeros((count if len(program.free) else 0, outputs))
    for k, place in enumerate(program.free):
        tangent[program.inputs[place], k] = 1.0
    start = program.start.copy()
    return Lines(code, program.split, program.inputs, program.free, program.results, start, tangent)


def as_kernel(e: Expansion) -> Kernel:
    """Arrays of an expansion."""
    outputs, count, dims = len(e.output_scale), e.points.shape[1], e.points.shape[2]

    def copied(values: Array) -> Array:
        """Compiled code is compiled anew for arrays that are read-only."""
        return np.array(values, dtype=float, order="C")

    return Kernel(
        input_mean=copied(e.input_mean),
        base=e.output_scale * e.mean_coefficients[:, 0],
        gradient=copied(e.output_scale[:, None] * e.mean_coefficients[:, 1:] / e.input_scale),
        height=e.output_scale * e.signal_variance,
        narrow=copied(1.0 / (e.input_scale * e.lengthscales)),
        points=copied(e.points.transpose(0, 2, 1)),
        alpha=copied(e.alpha),
        whitener=copied(e.whitener),
        triangular=bool(e.triangular),
        signal_variance=copied(e.signal_variance),
        noise_variance=copied(e.noise_variance),
        std_scale=e.output_scale * e.sigma_scale,
        extent=np.abs(e.points).max(axis=1, initial=0.0),
        rows=np.zeros((outputs, count)),
        sums=np.zeros(outputs),
        at=np.full(dims, np.nan),
        moved=np.zeros(1),
        scaled=np.zeros((outputs, 1 + dims)),
        powers=np.zeros(count),
        batch=np.zeros((BATCH, outputs, count)),
        explained=np.zeros((BATCH, outputs)),
    )


def packed(given: tuple[Gate, Kernel, Lines, Lines, Room]) -> tuple[Packed, tuple[Gate, Kernel, Lines, Lines, Room]]:
    """Copies of what a step needs, packed; and the same as it lies there."""
    gate, kernel, lines, sent, _ = given
    outputs, dims, points = kernel.points.shape
    sizes = [outputs, dims, points, kernel.triangular, *(getattr(gate, name) for name in SWITCHES)]
    for program in (lines, sent):
        sizes += [len(program.code), program.split, *map(len, (program.inputs, program.results, program.free))]
    sizes += [len(gate.reach), len(gate.middle)]
    kinds = {"f": len(HEAD), "i": len(sizes)}
    parts: tuple[Any, ...] = given
    for part in parts:
        for name in part._fields:
            array = getattr(part, name)
            if name != "code" and isinstance(array, np.ndarray):
                kinds[array.dtype.kind] += aligned(array.size)
    room, counts = np.zeros(kinds["f"] + LINE), np.zeros(kinds["i"], dtype=np.int64)
    start = -(room.ctypes.data // room.itemsize) % LINE
    numbers = room[start : start + kinds["f"]]
    numbers[: len(HEAD)] = [getattr(gate, name) for name in HEAD]
    counts[: len(sizes)] = sizes
    made = Packed(numbers, counts, lines.code, sent.code)
    views = opened(*made)
    pairs: list[tuple[Any, Any]] = list(zip(given, views, strict=True))
    for part, view in pairs:
        for name in part._fields:
            if name != "code" and isinstance(getattr(part, name), np.ndarray):
                getattr(view, name)[...] = getattr(part, name)
    return made, views


@compiled
def evaluate(lines: Lines, first: int, last: int) -> None:
    """Values of the lines first to last, without tangents."""
    code, v = lines.code, lines.value
    for k in range(first, last):
        op, a, b, c = code[k, 0], code[k, 1], code[k, 2], code[k, 3]
        if op <= CONSTANT:
            continue
        v[k] = value_of(op, v[a], v[b], v[c])


@compiled
def differentiate(lines: Lines) -> None:
    """Values and tangents of the lines that depend on the free inputs.

    The tangent of c = f(a, b) is f_a a' + f_b b'; at a kink it is that of the side that was taken.
    """
    code, v, t = lines.code, lines.value, lines.tangent
    count = t.shape[1]
    for k in range(lines.split, len(code)):
        op, a, b, c = code[k, 0], code[k, 1], code[k, 2], code[k, 3]
        if op <= CONSTANT:
            continue
        value = value_of(op, v[a], v[b], v[c])
        v[k] = value
        if op == ADD:
            for i in range(count):
                t[k, i] = t[a, i] + t[b, i]
        elif op == SUB:
            for i in range(count):
                t[k, i] = t[a, i] - t[b, i]
        elif op == MUL:
            va, vb = v[a], v[b]
            if b < lines.split:  # no tangent: and what is infinite there must not meet its zero
                for i in range(count):
                    t[k, i] = t[a, i] * vb
            elif a < lines.split:
                for i in range(count):
                    t[k, i] = va * t[b, i]
            else:
                for i in range(count):
                    t[k, i] = t[a, i] * vb + va * t[b, i]
        elif op == SELECT:
            chosen = b if v[a] != 0.0 else c
            for i in range(count):
                t[k, i] = t[chosen, i]
        else:
            da, db = _slopes(op, v[a], v[b], value)
            if a < lines.split:
                da = 0.0
            if b < lines.split:
                db = 0.0
            if db == 0.0:
                for i in range(count):
                    t[k, i] = da * t[a, i]
            else:
                for i in range(count):
                    t[k, i] = da * t[a, i] + db * t[b, i]


@compiled
def _slopes(op: int, a: float, b: float, value: float) -> tuple[float, float]:
    """Partial derivatives of an operation with one or two arguments; zero where it is flat."""
    if op == DIV:
        return 1.0 / b, -value / b
    if op == NEG:
        return -1.0, 0.0
    if op == SQRT:
        return (0.5 / value if value > 0.0 else 0.0), 0.0
    if op == EXP:
        return value, 0.0
    if op == SIN:
        return math.cos(a), 0.0
    if op == COS:
        return -math.sin(a), 0.0
    if op == ATAN2:
        square = a * a + b * b
        return (b / square, -a / square) if square > 0.0 else (0.0, 0.0)
    if op == ABS:
        return (1.0 if a >= 0.0 else -1.0), 0.0
    if op == MAX:
        return (1.0, 0.0) if a >= b else (0.0, 1.0)
    if op == MIN:
        return (1.0, 0.0) if a <= b else (0.0, 1.0)
    if op == LOG:
        return 1.0 / a, 0.0
    return 0.0, 0.0


MAGIC = 6755399441055744.0  # 1.5 * 2^52: added to a small number, the last bits are its whole part
PER_LN2, LN2_HIGH, LN2_LOW = 1.4426950408889634, 6.93147180369123816490e-01, 1.90821492927058770002e-10
SMALLEST = -1416.0
"""exp(-708) is the smallest number that keeps all its digits; what is smaller counts as this."""


def _bits_of(_: Any, number: Any) -> Any:
    """The 64 bits of a number, as an integer."""

    def generated(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], context.get_value_type(types.int64))

    return types.int64(types.float64), generated


def _number_of(_: Any, bits: Any) -> Any:
    """The number that has these 64 bits."""

    def generated(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], context.get_value_type(types.float64))

    return types.float64(types.int64), generated


bits_of: Any = intrinsic(_bits_of)
number_of: Any = intrinsic(_number_of)


@inside
def _to_fifth(p: float, x: float) -> float:
    """What precedes the 5th power in Horner's form of the series of exp(x), from `p` before the 11th power."""
    p = p * x + 1.0 / 3628800.0
    p = p * x + 1.0 / 362880.0
    p = p * x + 1.0 / 40320.0
    p = p * x + 1.0 / 5040.0
    p = p * x + 1.0 / 720.0
    return p * x + 1.0 / 120.0


@inside
def _from_fifth(p: float, x: float) -> float:
    """The series of exp(x) in Horner's form, from `p` before the 5th power."""
    p = p * x + 1.0 / 24.0
    p = p * x + 1.0 / 6.0
    p = p * x + 0.5
    p = p * x + 1.0
    return p * x + 1.0


@in_this_order
def hills(row: Array) -> None:
    """exp(-row / 2) in place of `row` (N,), all of it at once, to the last bit but one.

    exp(x) = 2^k exp(x - k ln 2) with the whole k nearest to x / ln 2, and the series of exp to its 13th power; ln 2 in
    two parts, so that the difference keeps its digits (Cody and Waite, "Software Manual for the Elementary Functions",
    1980, chapter 6). Plain form: `numpy.exp`.
    """
    for n in range(len(row)):
        x = -0.5 * (-SMALLEST if row[n] > -SMALLEST else row[n])
        shifted = x * PER_LN2 + MAGIC
        k = shifted - MAGIC
        r = (x - k * LN2_HIGH) - k * LN2_LOW
        p = (1.0 / 6227020800.0 * r + 1.0 / 479001600.0) * r + 1.0 / 39916800.0
        row[n] = _from_fifth(_to_fifth(p, r), r) * number_of((bits_of(shifted) + 1023) << 52)


@in_any_order
def _square_distances(points: Array, k: int, q: Array, row: Array) -> None:
    """Squared distances of q (D,) from the points of output k, in `row` (N,): the command's six inputs, then three at
    once.
    """  # noqa: D205
    dims, count = points.shape[1], len(row)
    a, b, c, e, f, g = q[0], q[1], q[2], q[3], q[4], q[5]
    for n in range(count):
        x, y, z = points[k, 0, n] - a, points[k, 1, n] - b, points[k, 2, n] - c
        u, v, w = points[k, 3, n] - e, points[k, 4, n] - f, points[k, 5, n] - g
        row[n] = x * x + y * y + z * z + u * u + v * v + w * w
    d = 6
    while d + 3 <= dims:
        a, b, c = q[d], q[d + 1], q[d + 2]
        for n in range(count):
            x, y, z = points[k, d, n] - a, points[k, d + 1, n] - b, points[k, d + 2, n] - c
            row[n] += x * x + y * y + z * z
        d += 3
    while d < dims:
        a = q[d]
        for n in range(count):
            x = points[k, d, n] - a
            row[n] += x * x
        d += 1


@compiled
def near(kernel: Kernel, xi: Array) -> None:
    """Kernel values at inputs xi (D,) over their signal variances, in `kernel.rows`; kept while the inputs stay."""
    same = True
    for d in range(len(xi)):
        same = same and kernel.at[d] == xi[d]
    if same:
        return
    for k in range(len(kernel.sums)):
        row, query = kernel.rows[k], kernel.scaled[k]
        for d in range(len(xi)):
            query[d] = (xi[d] - kernel.input_mean[d]) * kernel.narrow[k, d]
        _square_distances(kernel.points, k, query, row)
        hills(row)
        kernel.sums[k] = _weighted(row, kernel.alpha[k])
    for d in range(len(xi)):
        kernel.at[d] = xi[d]
    kernel.moved[0] = 0.0


@within
def anew(kernel: Kernel, xi: Array) -> None:
    """As `near`, and the same to the last bit whatever was asked before."""
    if kernel.moved[0] != 0.0:
        kernel.at[0] = np.nan
    near(kernel, xi)


@inside
def larger(a: float, b: float) -> float:
    """The larger of two numbers; nan where either is, as of `numpy.max`."""
    return a if a > b or a != a else b


CLOSE, FAR = 7e-3, 0.25
"""|u| up to which exp(u) is its series to the 5th and to the 11th power: what is left out is below 1.7e-16."""


@within
def move(kernel: Kernel, xi: Array, rows: NDArray[np.int64]) -> None:
    """As `near`, from the inputs `kernel.at`, from which xi (D,) differs in the inputs `rows` alone.

    k(x + d) = k(x) exp(u) with u = d . (p - x) - d^2 / 2 for a point p, in lengthscales. Where |u| is small for all
    points, which is so between the proposals of a search, a short series is exp(u) to rounding.
    """
    far, last = 0.0, len(xi)
    for k in range(len(kernel.sums)):
        reach, start = 0.0, 0.0
        for i in range(len(rows)):
            d = rows[i]
            step = (xi[d] - kernel.at[d]) * kernel.narrow[k, d]
            place = (kernel.at[d] - kernel.input_mean[d]) * kernel.narrow[k, d]
            reach += abs(step) * (kernel.extent[k, d] + abs(place) + 0.5 * abs(step))
            start -= step * (place + 0.5 * step)
            kernel.scaled[k, i] = step
        kernel.scaled[k, last] = start
        far = larger(reach, far)
    if not far <= FAR:
        near(kernel, xi)
        return
    for k in range(len(kernel.sums)):
        _products(kernel.points, k, kernel.scaled[k], rows, kernel.scaled[k, last], kernel.powers)
        kernel.sums[k] = _risen(kernel.rows[k], kernel.powers, kernel.alpha[k], far <= CLOSE)
    for d in rows:
        kernel.at[d] = xi[d]
    kernel.moved[0] = 1.0


@in_any_order
def _products(points: Array, k: int, step: Array, rows: NDArray[np.int64], start: float, found: Array) -> None:
    """`start` plus the products of a step in the inputs `rows` with the points of output k, in `found` (N,)."""
    count, i = len(found), 0
    if len(rows) >= 3:
        d, e, f = rows[0], rows[1], rows[2]
        a, b, c = step[0], step[1], step[2]
        for n in range(count):
            found[n] = start + (a * points[k, d, n] + b * points[k, e, n] + c * points[k, f, n])
        i = 3
    else:
        for n in range(count):
            found[n] = start
    while i < len(rows):
        d, a = rows[i], step[i]
        for n in range(count):
            found[n] += a * points[k, d, n]
        i += 1


@in_any_order
def _risen(row: Array, u: Array, alpha: Array, close: bool) -> float:
    """Put row exp(u) in place of `row` (N,), by the series to the 5th power where `close`, else to the 11th.

    Returns its sum with the weights `alpha` (N,).
    """
    found = 0.0
    if close:
        for n in range(len(row)):
            value = row[n] * _from_fifth(1.0 / 120.0, u[n])
            row[n] = value
            found += value * alpha[n]
        return found
    for n in range(len(row)):
        value = row[n] * _from_fifth(_to_fifth(1.0 / 39916800.0, u[n]), u[n])
        row[n] = value
        found += value * alpha[n]
    return found


@in_any_order
def _weighted(row: Array, alpha: Array) -> float:
    """The sum of a row (N,) with weights (N,)."""
    found = 0.0
    for n in range(len(row)):
        found += row[n] * alpha[n]
    return found


@within
def mean_of(kernel: Kernel, xi: Array, mean: Array) -> None:
    """Mean (L,) at inputs xi (D,), at which `kernel.rows` are."""
    for k in range(len(mean)):
        total = kernel.base[k]
        for d in range(len(xi)):
            total += kernel.gradient[k, d] * (xi[d] - kernel.input_mean[d])
        mean[k] = total + kernel.height[k] * kernel.sums[k]


@in_any_order
def _moments(
    points: Array, k: int, row: Array, alpha: Array, rows: NDArray[np.int64], slope: Array
) -> None:  # fmt: skip
    """Sums of the points of output k with row (N,) times alpha (N,), in `rows`: row k of `slope` (L, len(rows))."""
    i = 0
    while i + 3 <= len(rows):
        d, e, f = rows[i], rows[i + 1], rows[i + 2]
        a, b, c = 0.0, 0.0, 0.0
        for n in range(len(row)):
            weight = row[n] * alpha[n]
            a += weight * points[k, d, n]
            b += weight * points[k, e, n]
            c += weight * points[k, f, n]
        slope[k, i], slope[k, i + 1], slope[k, i + 2] = a, b, c
        i += 3
    while i < len(rows):
        d, a = rows[i], 0.0
        for n in range(len(row)):
            a += row[n] * alpha[n] * points[k, d, n]
        slope[k, i] = a
        i += 1


@within
def slope_of(kernel: Kernel, xi: Array, slope: Array, rows: NDArray[np.int64]) -> None:
    """Derivative of the mean at inputs xi (D,), at which `kernel.rows` are, to `rows`: slope (L, len(rows))."""
    for k in range(len(kernel.sums)):
        _moments(kernel.points, k, kernel.rows[k], kernel.alpha[k], rows, slope)
        for i in range(len(rows)):
            d = rows[i]
            q = (xi[d] - kernel.input_mean[d]) * kernel.narrow[k, d]
            part = (slope[k, i] - q * kernel.sums[k]) * kernel.narrow[k, d]
            slope[k, i] = kernel.gradient[k, d] + kernel.height[k] * part


@compiled
def expand(kernel: Kernel, xi: Array, mean: Array, slope: Array, rows: NDArray[np.int64], wanted: bool) -> None:
    """Mean (L,) at inputs xi (D,), and where `wanted` its derivative to the inputs `rows`: slope (L, len(rows))."""
    near(kernel, xi)
    mean_of(kernel, xi, mean)
    if wanted:
        slope_of(kernel, xi, slope, rows)


@compiled
def spread(kernel: Kernel, xi: Array, std: Array) -> None:
    """Standard deviation (L,) at inputs xi (D,), noise included."""
    near(kernel, xi)
    for k in range(len(std)):
        std[k] = _deviation(kernel, k, _whitened(kernel.whitener[k], kernel.rows[k], kernel.triangular))


@compiled
def _deviation(kernel: Kernel, k: int, explained: float) -> float:
    """Standard deviation of output k of whose variance |C^-1 row|^2 is explained."""
    signal = kernel.signal_variance[k]
    left = signal - signal * signal * explained
    variance = (left if not left <= 0.0 else 0.0) + kernel.noise_variance[k]
    return kernel.std_scale[k] * math.sqrt(variance)


@in_any_order
def _whitened(whitener: Array, row: Array, triangular: bool) -> float:
    """|C^-1 row|^2, four rows at once: `row` is fetched a quarter as often."""
    count, total = len(row), 0.0
    whole = count - count % 4
    for n in range(0, whole, 4):
        one, two, three, four = whitener[n], whitener[n + 1], whitener[n + 2], whitener[n + 3]
        a, b, c, d = 0.0, 0.0, 0.0, 0.0
        for m in range(n + 4 if triangular else count):
            value = row[m]
            a += one[m] * value
            b += two[m] * value
            c += three[m] * value
            d += four[m] * value
        total += a * a + b * b + c * c + d * d
    for n in range(whole, count):
        last, a = whitener[n], 0.0
        for m in range(count):
            a += last[m] * row[m]
        total += a * a
    return total


@in_any_order
def whiten(kernel: Kernel, k: int, steps: int) -> None:
    """`_whitened` of output k for the first `steps` rows of `kernel.batch`, into `kernel.explained`.

    Four rows of C^-1 by four steps at once: sixteen sums stay in registers, C^-1 is fetched once for all steps.
    """
    W, K, found = kernel.whitener, kernel.batch, kernel.explained
    count = W.shape[1]
    whole = count - count % 4
    for b in range(steps):
        found[b, k] = 0.0
    for n in range(0, whole, 4):
        last = (
            min((n + 4 + LINE - 1) // LINE * LINE, count) if kernel.triangular else count
        )  # whole lines: zeros are cheap
        for b in range(0, steps, 4):
            a0, a1, a2, a3 = 0.0, 0.0, 0.0, 0.0
            b0, b1, b2, b3 = 0.0, 0.0, 0.0, 0.0
            c0, c1, c2, c3 = 0.0, 0.0, 0.0, 0.0
            d0, d1, d2, d3 = 0.0, 0.0, 0.0, 0.0
            for m in range(last):
                w0, w1, w2, w3 = W[k, n, m], W[k, n + 1, m], W[k, n + 2, m], W[k, n + 3, m]
                x0, x1, x2, x3 = K[b, k, m], K[b + 1, k, m], K[b + 2, k, m], K[b + 3, k, m]
                a0, a1, a2, a3 = a0 + w0 * x0, a1 + w1 * x0, a2 + w2 * x0, a3 + w3 * x0
                b0, b1, b2, b3 = b0 + w0 * x1, b1 + w1 * x1, b2 + w2 * x1, b3 + w3 * x1
                c0, c1, c2, c3 = c0 + w0 * x2, c1 + w1 * x2, c2 + w2 * x2, c3 + w3 * x2
                d0, d1, d2, d3 = d0 + w0 * x3, d1 + w1 * x3, d2 + w2 * x3, d3 + w3 * x3
            found[b, k] += a0 * a0 + a1 * a1 + a2 * a2 + a3 * a3
            found[b + 1, k] += b0 * b0 + b1 * b1 + b2 * b2 + b3 * b3
            found[b + 2, k] += c0 * c0 + c1 * c1 + c2 * c2 + c3 * c3
            found[b + 3, k] += d0 * d0 + d1 * d1 + d2 * d2 + d3 * d3
    for n in range(whole, count):
        for b in range(steps):
            a0 = 0.0
            for m in range(count):
                a0 += W[k, n, m] * K[b, k, m]
            found[b, k] += a0 * a0


@compiled
def propose(x: Array, r: Array, A: Array, low: Array, high: Array, damping: float, room: Array, found: Array) -> int:
    """The next point (L,) of the search for the least |r|^2 in a box, from r (L,) and A = dr/dx (L, L) at x (L,).

    Newton's step -A^-1 r in the components that are free, by the normal equations with `damping`:
    (A^T A + damping I) p = -A^T r (Levenberg and Marquardt; Nocedal and Wright, "Numerical Optimization", 2nd ed.,
    10.3); a component at a bound that the cost pushes against is held (projected Newton, Bertsekas 1982).
    `room` (L + 1, L) is scratch, its last row the pivots' ratio.
    """
    count = len(x)
    H, g = room, found
    largest = 0.0
    for i in range(count):
        g[i] = 0.0
        for k in range(count):
            g[i] += A[k, i] * r[k]
        for j in range(i + 1):
            H[i, j] = 0.0
            for k in range(count):
                H[i, j] += A[k, i] * A[k, j]
        largest = max(largest, H[i, i])
    moving = 0
    for i in range(count):
        held = (x[i] <= low[i] and g[i] > 0.0) or (x[i] >= high[i] and g[i] < 0.0)
        if held:
            for j in range(i):
                H[i, j] = 0.0
            for j in range(i + 1, count):
                H[j, i] = 0.0
            H[i, i] = largest
            g[i] = 0.0
        elif g[i] != 0.0:
            moving += 1
        H[i, i] += damping
    if moving == 0:
        return STATIONARY
    least = largest + damping
    for i in range(count):  # Cholesky, in place; the solution of the triangular systems in g
        for j in range(i + 1):
            total = H[i, j]
            for k in range(j):
                total -= H[i, k] * H[j, k]
            if i == j:
                least = min(least, total)
                if not total > 1e-14 * (largest + damping):
                    return SINGULAR
                H[i, i] = math.sqrt(total)
            else:
                H[i, j] = total / H[j, j]
    for i in range(count):
        for k in range(i):
            g[i] -= H[i, k] * g[k]
        g[i] /= H[i, i]
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, count):
            g[i] -= H[k, i] * g[k]
        g[i] /= H[i, i]
    room[count, 0] = least / (largest + damping)
    for i in range(count):
        found[i] = min(max(x[i] - g[i], low[i]), high[i])
    return PROPOSED


class Gate(NamedTuple):
    """Constants of a compensation. `rows` (L,) are the components that are corrected, `bound` (L,) by how much.

    `groups` (4,) says which of velocity, rates, position and past are inputs; `a`, `b0` and `b1` are the lag of past.
    """

    rows: NDArray[np.int64]
    bound: Array
    accept: float
    enough: float
    most: int
    lenient: bool
    watched: NDArray[np.int64]
    offset: Array
    scale: Array
    threshold: float
    kappa: float
    decay: float
    groups: NDArray[np.int64]
    a: float
    b0: float
    b1: float
    has_process: bool
    has_physics: bool
    known: Array  # (L,) bound of the correction of the physics where a process is on top of it
    reach: Array  # (G, 6), low, high, middle, half, weak of a `reach.Reach`, the rows for a wrench in its units
    low: Array
    high: Array
    middle: Array
    half: Array
    weak: Array


class Room(NamedTuple):
    """Scratch: inputs of process (D,) and physics, and of the searches."""

    xi: Array
    inputs: Array
    r: Array
    A: Array
    trial: Array
    x: Array
    warm: Array
    start: Array
    low: Array
    high: Array
    square: Array
    best: Array
    r_at: Array
    A_at: Array
    saved: Array


@within
def residual(
    gate: Gate, kernel: Kernel, lines: Lines, room: Room, wrench: Array, free: Array, process: bool, moved: bool
) -> float:
    """|r|^2 at a correction (L,) of `wrench` (6,), with r left in `room`; and dr/dx, see `steepen` for the process.

    `moved` says that the last one asked for was another correction of the same wrench.
    """
    count = len(gate.rows)
    r, A = room.r, room.A
    for i in range(count):
        r[i] = 0.0
        for j in range(count):
            A[i, j] = 0.0
    if process:
        for d in range(6):
            room.xi[d] = wrench[d]
        for i in range(count):
            room.xi[gate.rows[i]] += free[i]
        if moved:
            move(kernel, room.xi, gate.rows)
        else:
            anew(kernel, room.xi)
        mean_of(kernel, room.xi, r)
    if gate.has_physics:
        for i in range(count):
            lines.value[lines.inputs[gate.rows[i]]] = wrench[gate.rows[i]] + free[i]
        differentiate(lines)
        for i in range(count):
            r[i] += lines.value[lines.results[i]]
            for j in range(count):
                A[i, j] += lines.tangent[lines.results[i], j]
    cost = 0.0
    for i in range(count):
        r[i] += free[i]
        A[i, i] += 1.0
        cost += r[i] * r[i]
    return cost


@within
def steepen(gate: Gate, kernel: Kernel, room: Room, process: bool) -> None:
    """Add the slope of a process to dr/dx at the point of the last `residual`; only the last of all needs none."""
    if process:
        slope_of(kernel, room.xi, room.square, gate.rows)
        for i in range(len(gate.rows)):
            for j in range(len(gate.rows)):
                room.A[i, j] += room.square[i, j]


@compiled
def newton(
    gate: Gate, kernel: Kernel, lines: Lines, room: Room, wrench: Array, start: Array, process: bool
) -> tuple[float, int, bool]:
    """Search from `start` (L,) within the box of `room`; the best point is left in `room.x`.

    Its cost, evaluations, and whether A was ill-conditioned on the way. Newton's step is taken where it lowers the
    cost; else it is damped more and more.
    """
    x, trial, r, A = room.x, room.trial, room.r, room.A
    count = len(x)
    for i in range(count):
        x[i] = min(max(start[i], room.low[i]), room.high[i])
    cost = residual(gate, kernel, lines, room, wrench, x, process, False)
    r_at, A_at = room.r_at, room.A_at
    if cost > gate.enough:
        steepen(gate, kernel, room, process)
    used, proposals, damping, ill = 1, 0, 0.0, False
    while used < gate.most and cost > gate.enough and proposals < 2 * gate.most:
        proposals += 1
        for i in range(count):
            r_at[i] = r[i]
            for j in range(count):
                A_at[i, j] = A[i, j]
        said = propose(x, r_at, A_at, room.low, room.high, damping, room.square, trial)
        trace = 0.0
        for i in range(count):
            for j in range(count):
                trace += A_at[i, j] * A_at[i, j]
        if said == STATIONARY or not math.isfinite(trace):
            break
        if said == SINGULAR:
            ill = True
            damping = max(10.0 * damping, 1e-6 * trace)
            continue
        if damping == 0.0:
            ill = ill or room.square[count, 0] < ILL
        moved, size = 0.0, 0.0
        for i in range(count):
            moved, size = max(moved, abs(trial[i] - x[i])), max(size, abs(x[i]))
        if moved <= 1e-13 * size:
            break
        new = residual(gate, kernel, lines, room, wrench, trial, process, True)
        used += 1
        if new < cost:
            stalled = cost - new <= 1e-12 * cost
            cost = new
            damping = 0.1 * damping if damping > 1e-9 * trace else 0.0
            for i in range(count):
                x[i] = trial[i]
            if stalled:
                break
            if cost > gate.enough:
                steepen(gate, kernel, room, process)
        else:
            damping = max(10.0 * damping, 1e-4 * trace)
            for i in range(count):
                r[i] = r_at[i]
                for j in range(count):
                    A[i, j] = A_at[i, j]
    return cost, used, ill


@within
def solve(
    gate: Gate, kernel: Kernel, lines: Lines, room: Room, wrench: Array, start: Array, process: bool
) -> tuple[float, int, bool]:
    """As `Optimiser.solve`: from `start`, else from zero, else zero itself; the correction in `room.best` (L,).

    `newton` is called in one place, since all that it is handed lies on the stack for each.
    """
    count = len(gate.rows)
    cost, used, ill, elsewhere = np.inf, 0, False, False
    for i in range(count):
        room.start[i] = start[i]
        elsewhere = elsewhere or start[i] != 0.0
    for attempt in range(2):
        found, evaluations, hard = newton(gate, kernel, lines, room, wrench, room.start, process)
        used += evaluations
        if attempt == 0:
            ill = hard
        if attempt == 0 or found < cost or not math.isfinite(cost):
            cost = found
            for i in range(count):
                room.best[i] = room.x[i]
        if cost < gate.accept or not elsewhere:
            break
        for i in range(count):
            room.start[i] = 0.0
    if not cost < gate.accept:
        for i in range(count):
            room.start[i] = 0.0
        nothing = residual(gate, kernel, lines, room, wrench, room.start, process, False)
        if not cost < nothing:
            cost = nothing
            for i in range(count):
                room.best[i] = 0.0
    return cost, used, ill


@compiled
def further_inputs(gate: Gate, room: Room, memory: Array, state: Array) -> None:
    """The inputs of the process beyond the command, in the order of `plant.mismatch_inputs`; and the lag of `past`."""
    place = 6
    if gate.groups[0]:
        w, x, y, z = state[3], -state[4], -state[5], -state[6]
        a, b, c = state[7], state[8], state[9]
        tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
        room.xi[place] = a + w * tx + (y * tz - z * ty)
        room.xi[place + 1] = b + w * ty + (z * tx - x * tz)
        room.xi[place + 2] = c + w * tz + (x * ty - y * tx)
        place += 3
    if gate.groups[1]:
        for i in range(3):
            room.xi[place + i] = state[10 + i]
        place += 3
    if gate.groups[2]:
        for i in range(3):
            room.xi[place + i] = state[i]
        place += 3
    if gate.groups[3]:
        for i in range(6):
            sent = memory[SENT + i]
            late = sent
            if memory[STAGE] >= 2.0:
                late = gate.a * memory[LATE + i] + gate.b0 * memory[BEFORE + i] + gate.b1 * sent
            room.xi[place + i] = sent - late
            memory[BEFORE + i], memory[LATE + i] = sent, late
        if memory[STAGE] == 1.0:
            memory[STAGE] = 2.0


@within
def prepare(gate: Gate, lines: Lines, room: Room, memory: Array, wrench: Array, state: Array) -> None:
    """Set the inputs of this period: of the physics, whose part that no correction changes is worked out, and of the
    process beyond the command.
    """  # noqa: D205
    if gate.has_physics:
        for i in range(6):
            room.inputs[i] = wrench[i]
        for i in range(15):
            room.inputs[6 + i] = state[i]
        room.inputs[21] = memory[FRESH]
        for i in range(len(memory) - TILT):
            room.inputs[22 + i] = memory[TILT + i]
        for i in range(len(lines.inputs)):
            lines.value[lines.inputs[i]] = room.inputs[i]
        evaluate(lines, 0, lines.split)
    if gate.has_process:
        further_inputs(gate, room, memory, state)


@compiled
def search(gate: Gate, kernel: Kernel, lines: Lines, room: Room, memory: Array, wrench: Array, out: Array) -> int:
    """Corrections of the physics alone, about which the bounds are, and of both."""
    count, evaluations = len(gate.rows), 0
    for i in range(count):
        room.low[i], room.high[i] = -gate.bound[i], gate.bound[i]
    if gate.has_process and gate.has_physics:
        for i in range(count):
            room.low[i], room.high[i] = -gate.known[i], gate.known[i]
            room.warm[i] = memory[KNOWN + gate.rows[i]]
        cost, evaluations, ill = solve(gate, kernel, lines, room, wrench, room.warm, False)
        if not gate.lenient and (ill or not cost < gate.accept):
            return HANDED_BACK
        for i in range(count):
            value = room.best[i] if math.isfinite(cost) else 0.0
            memory[KNOWN + gate.rows[i]] = value
            room.low[i], room.high[i] = value - gate.bound[i], value + gate.bound[i]
    for i in range(count):
        room.warm[i] = memory[OPTIMUM + gate.rows[i]]
    cost, used, ill = solve(gate, kernel, lines, room, wrench, room.warm, gate.has_process)
    if not gate.lenient and (ill or not cost < gate.accept):
        return HANDED_BACK
    for i in range(count):
        memory[OPTIMUM + gate.rows[i]] = room.best[i] if math.isfinite(cost) else 0.0
    out[COST], out[EVALUATIONS], out[ACCEPTED] = cost, evaluations + used, (1.0 if cost < gate.accept else 0.0)
    return DONE


@compiled
def finish(
    gate: Gate, kernel: Kernel, lines: Lines, sent: Lines, room: Room, memory: Array, wrench: Array, out: Array,
    expects: bool,
) -> None:  # fmt: skip
    """From the optimum to the command that is sent, and what is remembered of it."""
    count = len(gate.rows)
    for i in range(6):
        room.xi[i] = wrench[i] + memory[OPTIMUM + i]
        out[FOUND + i] = memory[OPTIMUM + i]
    if gate.has_process:
        spread(kernel, room.xi, room.r)
    gated(gate, room.r, memory, wrench, out)
    if expects:
        expected(gate, kernel, lines, room, out[:6], out[EXPECTED + count :], True)
        expected(gate, kernel, lines, room, wrench, out[EXPECTED : EXPECTED + count], True)
    if gate.has_physics:
        remember(gate, sent, room, memory, out)
    memory[STAGE] = max(memory[STAGE], 1.0)
    for i in range(6):
        memory[SENT + i] = out[COMMAND + i]


@within
def reached(gate: Gate, wrench: Array) -> bool:
    """Whether the vehicle makes a wrench (6,) with no limit met, as `reach.Reach.inside` has it; False for nan."""
    arms = len(gate.middle)
    for g in range(arms):
        lateral, vertical = 0.0, 0.0
        for i in range(6):
            lateral += gate.reach[2 * g, i] * wrench[i]
            vertical += gate.reach[2 * g + 1, i] * wrench[i]
        thrust = math.hypot(lateral, vertical)
        if not thrust <= 1.0 + SLACK:
            return False
        turned = math.atan2(lateral, vertical) - gate.middle[g]
        turned -= 2.0 * math.pi * math.floor(turned / (2.0 * math.pi) + 0.5)
        if thrust > gate.weak[g] and abs(turned) > gate.half[g] + SLACK:
            return False
    for g in range(len(gate.low)):
        value = 0.0
        for i in range(6):
            value += gate.reach[2 * arms + g, i] * wrench[i]
        if not (value >= gate.low[g] - SLACK and value <= gate.high[g] + SLACK):
            return False
    return True


@within
def plausible(gate: Gate, state: Array) -> bool:
    """Whether the numbers of a state (15,) are such as a flight can have; the voltage is not asked for."""
    if gate.has_physics or gate.groups[0] or gate.groups[1] or gate.groups[2]:
        for i in range(14):
            if not abs(state[i]) <= STATE_MAX[i]:
                return False
        square = state[3] * state[3] + state[4] * state[4] + state[5] * state[5] + state[6] * state[6]
        return TURN_MIN <= square <= TURN_MAX
    return True


@within
def gated(gate: Gate, std: Array, memory: Array, wrench: Array, out: Array) -> None:
    """sigma, beta and the correction that the gate lets through (`compensate.uncertainty`).

    `std` (L,) are the standard deviations at the optimum, which `out` has.
    """
    count = len(gate.rows)
    sigma = -np.inf
    if gate.has_process:
        for i in range(count):
            if gate.watched[i]:
                normal = (std[i] - gate.offset[i]) / gate.scale[i]
                sigma = larger(normal, sigma)
    else:
        for i in range(count):
            if gate.watched[i]:
                sigma = max(sigma, -gate.offset[i] / gate.scale[i])
    beta = 0.0 if math.isinf(gate.threshold) else 1.0 / (1.0 + math.exp(-gate.kappa * (sigma - gate.threshold)))
    if not math.isfinite(sigma):
        beta = 1.0
    for i in range(6):
        found = out[FOUND + i] - memory[KNOWN + i]
        kept = gate.decay * beta * memory[CORRECTION + i] + (1.0 - beta) * found
        memory[CORRECTION + i] = kept
        out[CORRECTED + i] = memory[KNOWN + i] + kept
        out[COMMAND + i] = wrench[i] + out[CORRECTED + i]
    out[SIGMA], out[BETA] = sigma, beta
    out[LIMITED] = 0.0 if reached(gate, out[COMMAND : COMMAND + 6]) else 1.0


@compiled
def remember(gate: Gate, sent: Lines, room: Room, memory: Array, out: Array) -> None:
    """Where the command has brought the actuators."""
    for i in range(6):
        room.inputs[i] = out[COMMAND + i]
    for i in range(len(sent.inputs)):
        sent.value[sent.inputs[i]] = room.inputs[i]
    evaluate(sent, 0, len(sent.code))
    for i in range(len(sent.results)):
        memory[TILT + i] = sent.value[sent.results[i]]
    memory[FRESH] = 0.0


@within
def expected(
    gate: Gate, kernel: Kernel, lines: Lines, room: Room, wrench: Array, found: Array, moved: bool
) -> None:  # fmt: skip
    """Mismatch (L,) of a command (6,) as the models have it in the step at hand; the lines' inputs must be set.

    `moved` says that the last one asked for was another correction of the same wrench.
    """
    count = len(gate.rows)
    for i in range(count):
        found[i] = 0.0
    if gate.has_process:
        for i in range(6):
            room.xi[i] = wrench[i]
        if moved:
            move(kernel, room.xi, gate.rows)
        else:
            anew(kernel, room.xi)
        mean_of(kernel, room.xi, found)
    if gate.has_physics:
        for i in range(6):
            lines.value[lines.inputs[i]] = wrench[i]
        evaluate(lines, 0, len(lines.code))
        for i in range(count):
            found[i] += lines.value[lines.results[i]]


HEAD = ("accept", "enough", "threshold", "kappa", "decay", "a", "b0", "b1")
"""Numbers of a gate with which the numbers of a `Packed` begin."""
SWITCHES = ("most", "lenient", "has_process", "has_physics")
SIZES = 20
"""How many counts come before the arrays of counts: outputs, inputs of the process, points, whether the whitener is
triangular; `SWITCHES`; lines, split, inputs, results and free inputs of the mismatch, and of what is sent; limits of
the reach, and arms that tilt."""


class Packed(NamedTuple):
    """All that a step needs, in four arrays: to hand sixty to compiled code costs as much time as a step takes."""

    numbers: Array
    counts: NDArray[np.int64]
    code: NDArray[np.int32]
    sent: NDArray[np.int32]


@opening
def aligned(size: int) -> int:
    """The least multiple of `LINE` that is not smaller."""
    return (size + LINE - 1) // LINE * LINE


@opening
def _flat(numbers: Any, at: int, size: int) -> tuple[Any, int]:
    return numbers[at : at + size], at + aligned(size)


@opening
def _square(numbers: Array, at: int, rows: int, columns: int) -> tuple[Array, int]:
    return numbers[at : at + rows * columns].reshape((rows, columns)), at + aligned(rows * columns)


@opening
def _cube(numbers: Array, at: int, layers: int, rows: int, columns: int) -> tuple[Array, int]:
    size = layers * rows * columns
    return numbers[at : at + size].reshape((layers, rows, columns)), at + aligned(size)


@opening
def _as_gate(numbers: Array, counts: NDArray[np.int64], at: int, n: int) -> tuple[Gate, int, int]:
    count = counts[0]
    rows, n = _flat(counts, n, count)
    watched, n = _flat(counts, n, count)
    groups, n = _flat(counts, n, 4)
    bound, at = _flat(numbers, at, count)
    offset, at = _flat(numbers, at, count)
    scale, at = _flat(numbers, at, count)
    accept, enough, threshold, kappa = numbers[0], numbers[1], numbers[2], numbers[3]
    decay, a, b0, b1 = numbers[4], numbers[5], numbers[6], numbers[7]
    most, lenient, process, physics = counts[4], counts[5], counts[6], counts[7]
    known, at = _flat(numbers, at, count)
    reach, at = _square(numbers, at, counts[18], 6)
    low, at = _flat(numbers, at, counts[18] - 2 * counts[19])
    high, at = _flat(numbers, at, counts[18] - 2 * counts[19])
    middle, at = _flat(numbers, at, counts[19])
    half, at = _flat(numbers, at, counts[19])
    weak, at = _flat(numbers, at, counts[19])
    gate = Gate(
        rows, bound, accept, enough, most, lenient, watched, offset, scale, threshold, kappa, decay, groups, a, b0, b1,
        process, physics, known, reach, low, high, middle, half, weak,
    )  # fmt: skip
    return gate, at, n


@opening
def _as_kernel(numbers: Array, counts: NDArray[np.int64], at: int) -> tuple[Kernel, int]:
    count, dims, points = counts[0], counts[1], counts[2]
    input_mean, at = _flat(numbers, at, dims)
    base, at = _flat(numbers, at, count)
    gradient, at = _square(numbers, at, count, dims)
    height, at = _flat(numbers, at, count)
    narrow, at = _square(numbers, at, count, dims)
    places, at = _cube(numbers, at, count, dims, points)
    alpha, at = _square(numbers, at, count, points)
    whitener, at = _cube(numbers, at, count, points, points)
    signal, at = _flat(numbers, at, count)
    noise, at = _flat(numbers, at, count)
    std_scale, at = _flat(numbers, at, count)
    extent, at = _square(numbers, at, count, dims)
    rows, at = _square(numbers, at, count, points)
    sums, at = _flat(numbers, at, count)
    inputs, at = _flat(numbers, at, dims)
    moved, at = _flat(numbers, at, 1)
    scaled, at = _square(numbers, at, count, 1 + dims)
    powers, at = _flat(numbers, at, points)
    batch, at = _cube(numbers, at, BATCH, count, points)
    explained, at = _square(numbers, at, BATCH, count)
    kernel = Kernel(
        input_mean, base, gradient, height, narrow, places, alpha, whitener, counts[3],
        signal, noise, std_scale, extent, rows, sums, inputs, moved, scaled, powers, batch, explained,
    )  # fmt: skip
    return kernel, at


@opening
def _as_lines(
    numbers: Array, counts: NDArray[np.int64], code: NDArray[np.int32], first: int, at: int, n: int
) -> tuple[Lines, int, int]:
    count, size, split = counts[0], counts[first], counts[first + 1]
    inputs, n = _flat(counts, n, counts[first + 2])
    results, n = _flat(counts, n, counts[first + 3])
    free, n = _flat(counts, n, counts[first + 4])
    value, at = _flat(numbers, at, size)
    tangent, at = _square(numbers, at, size if len(free) else 0, count)
    return Lines(code, split, inputs, free, results, value, tangent), at, n


@opening
def _as_room(numbers: Array, counts: NDArray[np.int64], at: int) -> Room:
    count = counts[0]
    xi, at = _flat(numbers, at, counts[1])
    inputs, at = _flat(numbers, at, max(counts[10], 22))
    r, at = _flat(numbers, at, count)
    A, at = _square(numbers, at, count, count)
    trial, at = _flat(numbers, at, count)
    x, at = _flat(numbers, at, count)
    warm, at = _flat(numbers, at, count)
    start, at = _flat(numbers, at, count)
    low, at = _flat(numbers, at, count)
    high, at = _flat(numbers, at, count)
    square, at = _square(numbers, at, count + 1, count)
    best, at = _flat(numbers, at, count)
    r_at, at = _flat(numbers, at, count)
    A_at, at = _square(numbers, at, count, count)
    saved, at = _flat(numbers, at, TILT + max(counts[10] - 22, 0))
    return Room(xi, inputs, r, A, trial, x, warm, start, low, high, square, best, r_at, A_at, saved)


@opening
def opened(
    numbers: Array, counts: NDArray[np.int64], code: NDArray[np.int32], sent: NDArray[np.int32]
) -> tuple[Gate, Kernel, Lines, Lines, Room]:
    """What a `Packed` holds, in the same memory."""
    gate, at, n = _as_gate(numbers, counts, len(HEAD), SIZES)
    kernel, at = _as_kernel(numbers, counts, at)
    lines, at, n = _as_lines(numbers, counts, code, 8, at, n)
    after, at, n = _as_lines(numbers, counts, sent, 13, at, n)
    return gate, kernel, lines, after, _as_room(numbers, counts, at)


@within
def resume(kernel: Kernel, xi: Array, n: int) -> None:
    """Take the kernel values at inputs xi (D,) from place n of the batch."""
    for k in range(kernel.rows.shape[0]):
        for m in range(kernel.rows.shape[1]):
            kernel.rows[k, m] = kernel.batch[n, k, m]
        kernel.sums[k] = _weighted(kernel.rows[k], kernel.alpha[k])
    for d in range(len(xi)):
        kernel.at[d] = xi[d]
    kernel.moved[0] = 1.0


@compiled
def advance_together(
    gate: Gate, kernel: Kernel, lines: Lines, room: Room, memory: Array, wrenches: Array, states: Array, out: Array,
    expects: bool,
) -> int:  # fmt: skip
    """As `advance`, for a process that depends on nothing that was sent: sigma and gate of `BATCH` steps at once.

    No search looks at what the gate let through before, so that all searches of a batch may come first.
    """
    count = len(gate.rows)
    for first in range(0, len(wrenches), BATCH):
        last = min(first + BATCH, len(wrenches))
        done = first
        while done < last:
            if not (reached(gate, wrenches[done]) and plausible(gate, states[done])):
                break
            prepare(gate, lines, room, memory, wrenches[done], states[done])
            if search(gate, kernel, lines, room, memory, wrenches[done], out[done]) != DONE:
                break
            for i in range(6):
                out[done, FOUND + i] = memory[OPTIMUM + i]
                room.xi[i] = wrenches[done, i] + memory[OPTIMUM + i]
            near(kernel, room.xi)
            for k in range(count):
                for n in range(kernel.rows.shape[1]):
                    kernel.batch[done - first, k, n] = kernel.rows[k, n]
            if expects:
                expected(gate, kernel, lines, room, wrenches[done], out[done, EXPECTED : EXPECTED + count], True)
            done += 1
        for k in range(count):
            whiten(kernel, k, (done - first + 3) // 4 * 4)
        for n in range(first, done):
            for k in range(count):
                room.r[k] = _deviation(kernel, k, kernel.explained[n - first, k])
            gated(gate, room.r, memory, wrenches[n], out[n])
            if expects:
                prepare(gate, lines, room, memory, wrenches[n], states[n])
                for i in range(6):
                    room.xi[i] = wrenches[n, i] + out[n, FOUND + i]
                resume(kernel, room.xi, n - first)
                expected(gate, kernel, lines, room, out[n, :6], out[n, EXPECTED + count :], True)
            memory[STAGE] = max(memory[STAGE], 1.0)
            for i in range(6):
                memory[SENT + i] = out[n, COMMAND + i]
            if out[n, LIMITED] > 0.0:
                return n + 1
        if done < last:
            return done
    return len(wrenches)


@compiled
def _advance(
    gate: Gate, kernel: Kernel, lines: Lines, sent: Lines, room: Room, memory: Array, wrenches: Array, states: Array,
    out: Array, expects: bool,
) -> int:  # fmt: skip
    if len(wrenches) > 1 and gate.has_process and not gate.has_physics and gate.groups[3] == 0:
        return advance_together(gate, kernel, lines, room, memory, wrenches, states, out, expects)
    saved = room.saved
    for k in range(len(wrenches)):
        if not (reached(gate, wrenches[k]) and plausible(gate, states[k])):
            return k
        for i in range(len(memory)):
            saved[i] = memory[i]
        prepare(gate, lines, room, memory, wrenches[k], states[k])
        if search(gate, kernel, lines, room, memory, wrenches[k], out[k]) != DONE:
            for i in range(len(memory)):
                memory[i] = saved[i]
            return k
        finish(gate, kernel, lines, sent, room, memory, wrenches[k], out[k], expects)
        if out[k, LIMITED] > 0.0:
            return k + 1
    return len(wrenches)


@opening
def advance(
    numbers: Array, counts: NDArray[np.int64], code: NDArray[np.int32], sent_code: NDArray[np.int32], memory: Array,
    wrenches: Array, states: Array, out: Array, expects: bool,
) -> int:  # fmt: skip
    """Steps through wrenches (K, 6) with states (K, 15) until the end, or one that is not done as it is.

    That is the first that is handed back, or the first whose command the vehicle cannot make (LIMITED), which is done.

    Returns how many were done; `out` (K, 24 + 2 L) has their results, with the mismatch expected of desired and sent
    command where `expects`. The memory is as it was before a step that is handed back.
    """
    gate, kernel, lines, sent, room = opened(numbers, counts, code, sent_code)
    return _advance(gate, kernel, lines, sent, room, memory, wrenches, states, out, expects)
