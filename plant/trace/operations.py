"""The operations of a tape (`plant.trace.tape`): their values and slopes, each written once.

numba compiles these functions (`plant.trace.tape`), a tape works out with them what is constant, and the C of an
export is printed from their source (`replay.export.c_lines`), for which each `return` is one expression.
"""

import ast
import inspect
import math
from collections.abc import Callable
from enum import IntEnum
from functools import cache
from typing import Any

import numpy as np


class Op(IntEnum):
    """Operation of a line of a tape on its arguments a, b and c. Conditions are 1.0 where they hold, else 0.0."""

    INPUT = 0
    CONSTANT = 1
    ADD = 2
    SUB = 3
    MUL = 4
    DIV = 5
    NEG = 6
    SQRT = 7
    EXP = 8
    SIN = 9
    COS = 10
    ATAN2 = 11
    ABS = 12
    SIGN = 13
    MAX = 14
    MIN = 15
    LESS = 16
    LESS_EQUAL = 17
    SELECT = 18  # b where a holds, else c
    FLOOR = 19
    LOG = 20


FLAT = (Op.FLOOR, Op.SIGN, Op.LESS, Op.LESS_EQUAL)
"""Operations whose result has no slope."""
CHOOSING = (Op.MAX, Op.MIN, Op.SELECT)
"""Operations whose result is one of their arguments."""
_PAIRS = (Op.ADD, Op.SUB, Op.MUL, Op.DIV, Op.ATAN2, Op.MAX, Op.MIN, Op.LESS, Op.LESS_EQUAL)
ARITY = {Op.INPUT: 0, Op.CONSTANT: 0, Op.SELECT: 3, **dict.fromkeys(_PAIRS, 2)}
"""Arguments of an operation; one where it is not listed."""


def value_of(op: int, a: float, b: float, c: float) -> float:
    """The value of an operation."""
    if op == Op.MUL:
        return a * b
    if op == Op.ADD:
        return a + b
    if op == Op.SUB:
        return a - b
    if op == Op.DIV:
        return a / b
    if op == Op.NEG:
        return -a
    if op == Op.SQRT:
        return math.sqrt(a)
    if op == Op.EXP:
        return math.exp(a)
    if op == Op.SIN:
        return math.sin(a)
    if op == Op.COS:
        return math.cos(a)
    if op == Op.ATAN2:
        return math.atan2(a, b)
    if op == Op.ABS:
        return abs(a)
    if op == Op.SIGN:
        return 1.0 if a > 0.0 else (-1.0 if a < 0.0 else 0.0)
    if op == Op.MAX:
        return a if a >= b else b
    if op == Op.MIN:
        return a if a <= b else b
    if op == Op.LESS:
        return 1.0 if a < b else 0.0
    if op == Op.LESS_EQUAL:
        return 1.0 if a <= b else 0.0
    if op == Op.SELECT:
        return b if a != 0.0 else c
    if op == Op.FLOOR:
        return np.floor(a)  # type: ignore[no-any-return]
    if op == Op.LOG:
        return math.log(a)
    return math.nan


def slopes_of(op: int, a: float, b: float, value: float) -> tuple[float, float]:
    """Partial derivatives of an operation's value with respect to a and b; at a kink those of one side."""
    if op == Op.MUL:
        return b, a
    if op == Op.ADD:
        return 1.0, 1.0
    if op == Op.SUB:
        return 1.0, -1.0
    if op == Op.DIV:
        return 1.0 / b, -value / b
    if op == Op.NEG:
        return -1.0, 0.0
    if op == Op.SQRT:
        return 0.5 / value if value > 0.0 else 0.0, 0.0
    if op == Op.EXP:
        return value, 0.0
    if op == Op.SIN:
        return math.cos(a), 0.0
    if op == Op.COS:
        return -math.sin(a), 0.0
    if op == Op.ATAN2:
        return b / (a * a + b * b) if a * a + b * b > 0.0 else 0.0, -a / (a * a + b * b) if a * a + b * b > 0.0 else 0.0
    if op == Op.ABS:
        return 1.0 if a >= 0.0 else -1.0, 0.0
    if op == Op.LOG:
        return 1.0 / a, 0.0
    return 0.0, 0.0


def chosen_of(op: int, a: float, b: float) -> int:
    """Which argument (0, 1, 2) is the result of an operation of `CHOOSING`."""
    if op == Op.MAX:
        return 0 if a >= b else 1
    if op == Op.MIN:
        return 0 if a <= b else 1
    if op == Op.SELECT:
        return 1 if a != 0.0 else 2
    return 0


@cache
def expressions(function: Callable[..., Any]) -> dict[Op, ast.expr]:
    """The expression that each operation returns in one of the functions above."""
    (found,) = ast.parse(inspect.getsource(function)).body
    assert isinstance(found, ast.FunctionDef)
    written = {}
    for branch in found.body:
        if (
            isinstance(branch, ast.If)
            and isinstance(branch.test, ast.Compare)
            and isinstance(branch.body[0], ast.Return)
        ):
            name = branch.test.comparators[0]
            assert isinstance(name, ast.Attribute)
            assert branch.body[0].value is not None
            written[Op[name.attr]] = branch.body[0].value
    return written
