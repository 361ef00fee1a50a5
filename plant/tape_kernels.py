"""A tape (`plant.tape.Program`) in compiled code: its values, and its derivatives beside them (tangent propagation)."""

# mypy: disable-error-code="no-any-return"

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numba import njit

F = TypeVar("F", bound=Callable[..., Any])

INPUT, CONSTANT, ADD, SUB, MUL, DIV, NEG, SQRT, EXP, SIN, COS, ATAN2 = range(12)
ABS, SIGN, MAX, MIN, LESS, LESS_EQUAL, SELECT, FLOOR, LOG = range(12, 21)
"""Operations (`plant.tape.Op`)."""


def compiled(function: F) -> F:
    """Without numba's reference counts: no array is made here, and every call would pay for all that it is handed."""
    numba: Any = njit  # whose annotations leave _nrt out
    return numba(cache=True, error_model="numpy", nogil=True, _nrt=False)(function)


@compiled
def value_of(op: int, a: float, b: float, c: float) -> float:
    """One operation of a tape."""
    if op == MUL:
        return a * b
    if op == ADD:
        return a + b
    if op == SUB:
        return a - b
    if op == DIV:
        return a / b
    if op == NEG:
        return -a
    if op == SQRT:
        return math.sqrt(a)
    if op == EXP:
        return math.exp(a)
    if op == SIN:
        return math.sin(a)
    if op == COS:
        return math.cos(a)
    if op == ATAN2:
        return math.atan2(a, b)
    if op == ABS:
        return abs(a)
    if op == SIGN:
        return 1.0 if a > 0.0 else (-1.0 if a < 0.0 else 0.0)
    if op == MAX:
        return a if a >= b else b
    if op == MIN:
        return a if a <= b else b
    if op == LESS:
        return 1.0 if a < b else 0.0
    if op == LESS_EQUAL:
        return 1.0 if a <= b else 0.0
    if op == SELECT:
        return b if a != 0.0 else c
    if op == FLOOR:
        return np.floor(a)
    return math.log(a)


@compiled
def evaluate(tape: Any, first: int, last: int) -> None:
    """Values of the lines first to last, without tangents."""
    code, v = tape.code, tape.value
    for k in range(first, last):
        op, a, b, c = code[k, 0], code[k, 1], code[k, 2], code[k, 3]
        if op <= CONSTANT:
            continue
        v[k] = value_of(op, v[a], v[b], v[c])


@compiled
def differentiate(tape: Any) -> None:
    """Values and tangents of the lines that depend on the free inputs.

    The tangent of c = f(a, b) is f_a a' + f_b b'; at a kink it is that of the side that was taken.
    """
    code, v, t = tape.code, tape.value, tape.tangent
    count = t.shape[1]
    for k in range(tape.split, len(code)):
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
            if b < tape.split:  # no tangent: and what is infinite there must not meet its zero
                for i in range(count):
                    t[k, i] = t[a, i] * vb
            elif a < tape.split:
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
            if a < tape.split:
                da = 0.0
            if b < tape.split:
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
