"""Decorators of the compiled step: what numba makes of a function, and whether `replay.export` prints it too.

Also exp(-x / 2) of a whole row at once: numba's own exp takes one number at a time, which would double a step.
"""

# mypy: disable-error-code="no-any-return"

from collections.abc import Callable
from typing import Any

from numba import njit, types
from numba.extending import intrinsic

from wrenchgap.flight.flight import Array
from wrenchgap.plant.trace.tape import F, compiled

PRINTED = ("printed", "sums", "replaced")
"""Decorators of functions that the export prints."""


kernel = compiled
"""For Python alone."""
printed = compiled
"""Here and in the exported code."""


def sums(function: F) -> F:
    """As `printed`, for sums whose order does not matter beyond rounding: they then take four or eight numbers at once.

    What is not finite stays so.
    """
    return compiled(function, forceinline=True, fastmath={"reassoc", "contract", "nsz"})


opening = njit(cache=True, error_model="numpy", nogil=True)
"""For functions that make views which outlive them."""


@opening
def _end(at: int, size: int) -> int:
    """Where a part that begins at `at` ends, in whole lines of the cache (`compensate.tables.LINE`)."""
    return at + (size + 7) // 8 * 8


@opening
def vector(numbers: Any, at: int, size: int) -> tuple[Any, int]:
    """A view (size,) from the place `at` on, and where the next one begins."""
    return numbers[at : at + size], _end(at, size)


@opening
def matrix(numbers: Any, at: int, rows: int, columns: int) -> tuple[Any, int]:
    """As `vector`, (rows, columns)."""
    return numbers[at : at + rows * columns].reshape((rows, columns)), _end(at, rows * columns)


@opening
def cube(numbers: Any, at: int, layers: int, rows: int, columns: int) -> tuple[Any, int]:
    """As `vector`, (layers, rows, columns)."""
    size = layers * rows * columns
    return numbers[at : at + size].reshape((layers, rows, columns)), _end(at, size)


def external(*writes: str) -> Callable[[F], F]:
    """For functions that the exported code has in another form, which `writes` to these arguments: the physics."""
    return kernel


def replaced(by: Any) -> Callable[[F], F]:
    """As `printed`, but that Python runs `by`, which gives the same to the last bit but one, faster."""
    return lambda _: by


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


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract"})
def gaussians(row: Array) -> None:
    """exp(-row / 2) in place of `row` (N,), to the last bit but one.

    exp(x) = 2^k exp(x - k ln 2) with the whole k nearest to x / ln 2, and the series of exp to its 13th power; ln 2 in
    two parts, so that the difference keeps its digits (Cody and Waite, "Software Manual for the Elementary Functions",
    1980, chapter 6). exp(-708) is the smallest number that keeps all its digits; a row of more than 1416 counts as it.
    """
    largest, per_ln2, ln2_high, ln2_low = (
        1416.0,
        1.4426950408889634,
        6.93147180369123816490e-01,
        1.90821492927058770002e-10,
    )
    shift = 6755399441055744.0  # 1.5 * 2^52: added to a small number, the last bits are its whole part
    for n in range(len(row)):
        x = -0.5 * (largest if row[n] > largest else row[n])
        shifted = x * per_ln2 + shift
        k = shifted - shift
        r = (x - k * ln2_high) - k * ln2_low
        p = (1.0 / 6227020800.0 * r + 1.0 / 479001600.0) * r + 1.0 / 39916800.0
        p = ((p * r + 1.0 / 3628800.0) * r + 1.0 / 362880.0) * r + 1.0 / 40320.0
        p = ((p * r + 1.0 / 5040.0) * r + 1.0 / 720.0) * r + 1.0 / 120.0
        p = ((((p * r + 1.0 / 24.0) * r + 1.0 / 6.0) * r + 0.5) * r + 1.0) * r + 1.0
        row[n] = p * number_of((bits_of(shifted) + 1023) << 52)
