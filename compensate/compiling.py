"""Decorators of the compiled step: what numba makes of a function, and whether `replay.export` prints it too."""

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])

PRINTED = ("printed", "sums", "replaced")
"""Decorators of functions that the export prints."""


def _compiled(**options: Any) -> Callable[[F], F]:
    """Compile without numba's reference counts: no array is allocated, and each call would count every argument."""
    numba: Any = njit  # whose annotations leave _nrt out
    decorator: Callable[[F], F] = numba(cache=True, error_model="numpy", nogil=True, _nrt=False, **options)
    return decorator


kernel = _compiled()
"""For Python alone."""
printed = _compiled()
"""Here and in the exported code."""
sums = _compiled(forceinline=True, fastmath={"reassoc", "contract", "nsz"})
"""As `printed`, for sums whose order does not matter beyond rounding: they then take four or eight numbers at once.
What is not finite stays so."""


opening = njit(cache=True, error_model="numpy", nogil=True)
"""For functions that make views which outlive them."""


@opening
def _end(at: int, size: int) -> int:
    """Where a part that begins at `at` ends, in whole lines of the cache (`compensate.packing.LINE`)."""
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
