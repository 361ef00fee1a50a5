"""Numbers of a model file that are known to a tolerance: `mass = { value = 1.52, tolerance = 0.005 }`.

A bare number is one of which nothing is said. Tolerances are one standard deviation, in the unit of the value: of a
vector one number for all entries or one for each; of an inertia one for all moments, one for each, or three rows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import ValidatorFunctionWrapHandler, WrapValidator

from wrenchgap.flight.flight import Array
from wrenchgap.plant.reader import LEAST, broken

ROUNDED = 0.03
"""Share by which rounding lets the largest moment of inertia exceed the sum of the others: papers give two digits."""
PRODUCTS = 0.3
"""Tolerance of a product of inertia, relative to those of its two moments, where it is not given."""


@dataclass(frozen=True, eq=False)
class Told:
    """A value as the file has it, and its tolerance, None where there is none."""

    value: Any
    tolerance: Any = None


def told(tolerance: Callable[[Any], Any]) -> WrapValidator:
    """A value of the wrapped kind, or a table of it with a tolerance, which `tolerance` reads; either as `Told`."""

    def check(value: Any, handler: ValidatorFunctionWrapHandler) -> Told:
        if not isinstance(value, dict):
            return Told(handler(value))
        if set(value) != {"value", "tolerance"}:
            raise broken(f"got a table with {_keys(value)}, expected {{ value = ..., tolerance = ... }}")
        return Told(handler(value["value"]), tolerance(value["tolerance"]))

    return WrapValidator(check)


def told_of(value: Any) -> Told:
    """What was read, as `Told`; a default has no tolerance."""
    return value if isinstance(value, Told) else Told(value)


def _keys(table: dict[str, Any]) -> str:
    return f"the keys {', '.join(table)}" if table else "no keys"


def _positive(given: Any, shapes: tuple[tuple[int, ...], ...], words: str) -> Array:
    """The tolerance as an array of one of these shapes; an error of the file where it is none, or not positive."""
    wrong = broken(f"tolerance: got {given!r}, expected {words}, positive")
    flat = given if isinstance(given, list) else [given]
    entries = [x for row in flat for x in (row if isinstance(row, list) else [row])]
    if any(isinstance(x, bool) or not isinstance(x, int | float) for x in entries):
        raise wrong
    try:
        values = np.array(given, dtype=float)
    except ValueError:
        raise wrong from None
    if values.shape not in shapes or not np.all(np.isfinite(values)) or not np.all(values > 0.0):
        raise wrong
    return values


def of_number(given: Any) -> float:
    """Of one number."""
    return float(_positive(given, ((),), "one number"))


def of_vector(given: Any) -> Array:
    """Of a vector, (3,)."""
    return np.broadcast_to(_positive(given, ((), (3,)), "one number or three"), 3).copy()


def of_inertia(given: Any) -> Array:
    """Of an inertia, (3, 3)."""
    values = _positive(given, ((), (3,), (3, 3)), "one number, three, or three rows of three")
    if values.ndim == 2:
        return values
    moments = np.broadcast_to(values, 3)
    out = PRODUCTS * np.sqrt(np.outer(moments, moments))
    np.fill_diagonal(out, moments)
    return out


def inertia_of(given: Told) -> tuple[Array, str]:
    """The inertia (3, 3) of the file's rows, and a note where it is impossible by no more than its tolerance.

    No rigid body has a principal moment above the sum of the other two. Within rounding (`ROUNDED`), or within the
    tolerances of the three moments together, that is said; beyond it is an error of the file.
    """
    rows = given.value
    inertia = np.diag(rows) if np.ndim(rows) == 1 else np.array(rows, dtype=float)
    low, middle, high = np.linalg.eigvalsh(inertia)
    if 0.0 < low < LEAST:
        raise broken(f"a principal moment is {low:.3g} kg m^2; expected at least {LEAST:g}")
    excess = float(high - low - middle)
    if excess <= 1e-3 * (low + middle):
        return inertia, ""
    granted = ROUNDED * (low + middle)
    if given.tolerance is not None:
        granted = max(granted, float(np.trace(given.tolerance)))
    words = f"the principal moments {low:.4g}, {middle:.4g}, {high:.4g} kg m^2"
    if low <= 0.0 or excess > granted:
        raise broken(f"no body has {words}: the largest exceeds the sum of the others by {excess:.2g}")
    over = 100.0 * excess / (low + middle)
    return inertia, (
        f"vehicle.inertia: of {words} the largest exceeds the sum of the others by {over:.2g} %, which no body does; "
        "taken as it is, since its tolerance allows it."
    )
