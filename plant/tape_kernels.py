"""A tape (`plant.tape.Program`) in compiled code: its values, and its derivatives beside them (tangent propagation)."""

# mypy: disable-error-code="no-any-return"

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

from wrenchgap.plant.operations import Op, chosen_of, slopes_of, value_of

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Without numba's reference counts: no array is made here, and every call would pay for all that it is handed."""
    numba: Any = njit  # whose annotations leave _nrt out
    return numba(cache=True, error_model="numpy", nogil=True, _nrt=False)(function)


_value_of, _slopes_of, _chosen_of = compiled(value_of), compiled(slopes_of), compiled(chosen_of)


@compiled
def evaluate(tape: Any, first: int, last: int) -> None:
    """Values of the lines first to last, without tangents."""
    code, v = tape.code, tape.value
    for k in range(first, last):
        op, a, b, c = code[k, 0], code[k, 1], code[k, 2], code[k, 3]
        if op <= Op.CONSTANT:
            continue
        v[k] = _value_of(op, v[a], v[b], v[c])


@compiled
def differentiate(tape: Any) -> None:
    """Values and tangents of the lines that depend on the free inputs.

    The tangent of c = f(a, b) is f_a a' + f_b b'; at a kink it is that of the side that was taken. What is infinite
    must not meet the zero of an argument that has no tangent.
    """
    code, v, t, split = tape.code, tape.value, tape.tangent, tape.split
    count = t.shape[1]
    for k in range(split, len(code)):
        op, a, b, c = code[k, 0], code[k, 1], code[k, 2], code[k, 3]
        if op <= Op.CONSTANT:
            continue
        v[k] = _value_of(op, v[a], v[b], v[c])
        if op == Op.MAX or op == Op.MIN or op == Op.SELECT:
            chosen = code[k, 1 + _chosen_of(op, v[a], v[b])]
            for i in range(count):
                t[k, i] = t[chosen, i]
            continue
        da, db = _slopes_of(op, v[a], v[b], v[k])
        if a < split:
            for i in range(count):
                t[k, i] = db * t[b, i]
        elif b < split or db == 0.0:
            for i in range(count):
                t[k, i] = da * t[a, i]
        else:
            for i in range(count):
                t[k, i] = da * t[a, i] + db * t[b, i]
