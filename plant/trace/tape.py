"""A tape of scalar operations, each on the results of earlier ones.

A compiled loop evaluates a tape, together with its derivatives where they are wanted (tangent propagation: Griewank and
Walther, "Evaluating Derivatives", 2nd ed., 2008, ch. 3); an export prints it as C. Equal operations are written once;
constants are evaluated while writing.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.plant.trace.operations import ARITY, Op, chosen_of, slopes_of, value_of

Line = tuple[int, int, int, int]


class Tape:
    """Lines (operation, a, b, c); the arguments are numbers of earlier lines, and every line has one result.

    `section` names what is being traced; `sections` holds for every line the section in which it first appeared.
    """

    def __init__(self) -> None:
        self.lines: list[Line] = []
        self.constants: dict[int, float] = {}
        self.names: dict[int, str] = {}
        self.sections: list[str] = []
        self.section = ""
        self._found: dict[object, int] = {}

    def input(self, name: str) -> int:
        """A new input; its line's number."""
        number = self._add((Op.INPUT, 0, 0, 0))
        self.names[number] = name
        return number

    def constant(self, value: float) -> int:
        """The line of a constant."""
        key = ("constant", value, math.copysign(1.0, value))
        if key not in self._found:
            self._found[key] = self._add((Op.CONSTANT, 0, 0, 0))
            self.constants[self._found[key]] = float(value)
        return self._found[key]

    def write(self, op: Op, a: int, b: int = 0, c: int = 0) -> int:
        """The line with the result of an operation: a new one, or an equal one."""
        given = (a, b, c)[: ARITY.get(op, 1)]
        if all(k in self.constants for k in given):
            values = (*(self.constants[k] for k in given), 0.0, 0.0)
            try:
                return self.constant(value_of(op, *values[:3]))
            except (ZeroDivisionError, ValueError, OverflowError):
                return self.constant(math.nan)
        short = self._simplified(op, a, b, c)
        if short is not None:
            return short
        if op in (Op.ADD, Op.MUL) and a > b:
            a, b = b, a
        key = (op, a, b, c)
        if key not in self._found:
            self._found[key] = self._add(key)
        return self._found[key]

    def needed(self, results: Sequence[int]) -> set[int]:
        """All lines that some results need, themselves among them."""
        found, pending = set[int](), list(results)
        while pending:
            line = pending.pop()
            if line not in found:
                found.add(line)
                op, *arguments = self.lines[line]
                pending.extend(arguments[: ARITY.get(Op(op), 1)])
        return found

    def _add(self, line: Line) -> int:
        self.lines.append(line)
        self.sections.append(self.section)
        return len(self.lines) - 1

    def _simplified(self, op: Op, a: int, b: int, c: int) -> int | None:
        """An existing line where the operation has no effect; products with zero are zero."""
        zero, one = (self._found.get(("constant", value, 1.0), -1) for value in (0.0, 1.0))
        if op is Op.ADD and zero in (a, b):
            return b if a == zero else a
        if op is Op.SUB and a == b:
            return self.constant(0.0)
        if op is Op.SUB and b == zero:
            return a
        if op is Op.MUL and zero in (a, b):
            return zero
        if op is Op.MUL and one in (a, b):
            return b if a == one else a
        if op is Op.DIV and (b == one or a == zero):
            return a
        if op is Op.SELECT and (b == c or a in self.constants):
            return b if b == c or self.constants[a] else c
        return None


@dataclass(frozen=True, eq=False)
class Program:
    """The lines that some results need; those that do not depend on the `free` inputs come first.

    code        (n, 4) operation and arguments of every line
    start       (n,) constants in their places, zero elsewhere
    inputs      (I,) lines of the inputs, -1 for one that nothing needs
    free        (L,) places, among the inputs, of those with respect to which is differentiated
    split       number of lines that do not depend on the free inputs
    results     (K,) lines of the results
    sections    (n,) the section of each line
    """

    code: NDArray[np.int32]
    start: Array
    inputs: NDArray[np.int64]
    free: NDArray[np.int64]
    split: int
    results: NDArray[np.int64]
    sections: tuple[str, ...]


def program(tape: Tape, inputs: Sequence[int], free: Sequence[int], results: Sequence[int]) -> Program:
    """The program of a tape for lines `results`, with lines `inputs`, of which `free` are differentiated to."""
    needed = tape.needed([*inputs, *results])
    moving: set[int] = set()
    for line in sorted(needed):
        op, *arguments = tape.lines[line]
        if line in free or any(k in moving for k in arguments[: ARITY.get(Op(op), 1)]):
            moving.add(line)
    order = sorted(needed, key=lambda line: (line in moving, line))
    place = {line: k for k, line in enumerate(order)}
    code = np.zeros((len(order), 4), dtype=np.int32)
    for line, k in place.items():
        op, *arguments = tape.lines[line]
        count = ARITY.get(Op(op), 1)
        code[k] = [op, *(place[a] for a in arguments[:count]), *[0] * (3 - count)]
    return Program(
        code=code,
        start=np.array([tape.constants.get(line, 0.0) for line in order]),
        inputs=np.array([place[line] for line in inputs], dtype=np.int64),
        free=np.array([list(inputs).index(line) for line in free], dtype=np.int64),
        split=len(needed) - len(moving),
        results=np.array([place[line] for line in results], dtype=np.int64),
        sections=tuple(tape.sections[line] for line in order),
    )


F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F, **options: Any) -> F:
    """Compile without numba's reference counts: no array is allocated, and each call would count every argument."""
    numba: Any = njit  # whose annotations leave _nrt out
    dispatcher: F = numba(cache=True, error_model="numpy", nogil=True, _nrt=False, **options)(function)
    return dispatcher


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
