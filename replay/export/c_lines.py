"""A program (`plant.tape`) as C: one statement a line, its tangents beside it, nothing that is zero or unused.

Statements and their order are those of the compiled loop in `compensate.compiled`, so that both round alike.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from wrenchgap._escaping import c_comment
from wrenchgap.plant.tape import ARITY, Op, Program

FREE_OF_CHARGE = (Op.INPUT, Op.CONSTANT)
FLAT = (Op.FLOOR, Op.SIGN, Op.LESS, Op.LESS_EQUAL)
"""Operations whose result has no slope."""

_VALUE = {
    Op.ADD: "{a} + {b}",
    Op.SUB: "{a} - {b}",
    Op.MUL: "{a} * {b}",
    Op.DIV: "{a} / {b}",
    Op.NEG: "-{a}",
    Op.SQRT: "wg_sqrt({a})",
    Op.EXP: "wg_exp({a})",
    Op.SIN: "wg_sin({a})",
    Op.COS: "wg_cos({a})",
    Op.ATAN2: "wg_atan2({a}, {b})",
    Op.ABS: "wg_fabs({a})",
    Op.SIGN: "{a} > 0 ? WG(1.0) : ({a} < 0 ? WG(-1.0) : WG(0.0))",
    Op.MAX: "{a} >= {b} ? {a} : {b}",
    Op.MIN: "{a} <= {b} ? {a} : {b}",
    Op.LESS: "{a} < {b} ? WG(1.0) : WG(0.0)",
    Op.LESS_EQUAL: "{a} <= {b} ? WG(1.0) : WG(0.0)",
    Op.SELECT: "{a} != 0 ? {b} : {c}",
    Op.FLOOR: "wg_floor({a})",
    Op.LOG: "wg_log({a})",
}
_KIND = {Op.DIV: "divide", Op.SQRT: "sqrt", Op.EXP: "exp", Op.LOG: "exp", Op.SIN: "trig", Op.COS: "trig"} | {
    Op.ATAN2: "trig",
    Op.MUL: "multiply",
    Op.ADD: "add",
    Op.SUB: "add",
}
"""What an operation counts as; the others are comparisons and moves."""

_SLOPE = {
    Op.NEG: "-{t}",
    Op.SQRT: "{v} > 0 ? WG(0.5) / {v} * {t} : WG(0.0)",
    Op.EXP: "{v} * {t}",
    Op.SIN: "wg_cos({a}) * {t}",
    Op.COS: "-wg_sin({a}) * {t}",
    Op.ABS: "{a} >= 0 ? {t} : -{t}",
    Op.LOG: "{t} / {a}",
}
"""Tangents of operations with one argument: of its tangent t, its value a, and the result v."""
_SLOPE_COST = {Op.NEG: "other", Op.SQRT: "divide", Op.SIN: "trig", Op.COS: "trig", Op.LOG: "divide"}


class Own(str):
    """A text that was made here, with no name of anybody's in it: templates write it as it is."""

    __slots__ = ()


Counts = Counter[str]
"""How often what is done: add, multiply, divide, sqrt, exp, trig, other."""


@dataclass(frozen=True)
class Code:
    """Statements of a function, how many operations they are, and how many numbers they hold at most."""

    text: Own
    counts: Counts
    numbers: int


def literal(value: float) -> str:
    """A constant in C, in the precision of the build."""
    if math.isinf(value):
        return "WG_INFINITY" if value > 0 else "(-WG_INFINITY)"
    if math.isnan(value):
        return "WG_NAN"
    return f"WG({value!r})"


class Printer:
    """Prints the two parts of a program: what is fixed during a search, and what moves with the free inputs."""

    def __init__(self, program: Program, prefix: str = "v") -> None:
        self.program, self.prefix = program, prefix
        self.ops = [Op(line[0]) for line in program.code.tolist()]
        self.arguments = [
            tuple(line[1 : 1 + ARITY.get(op, 1)]) for line, op in zip(program.code.tolist(), self.ops, strict=True)
        ]
        self.inputs = {int(line): k for k, line in enumerate(program.inputs)}
        self.free = {int(program.inputs[k]): i for i, k in enumerate(program.free)}
        moving = range(program.split, len(self.ops))
        asked = {a for line in moving for a in self.arguments[line]} | set(program.results.tolist())
        kept = [k for k in range(program.split) if k in asked and self.ops[k] is not Op.CONSTANT]
        self.kept = {line: place for place, line in enumerate(kept)}
        """Fixed lines that the moving ones look at, and their places in what is handed from one to the other."""
        self.slopes = self._slopes()

    def _slopes(self) -> dict[int, frozenset[int]]:
        """With respect to which free inputs a moving line has a tangent that a result needs."""
        found: dict[int, frozenset[int]] = {}
        for line in range(self.program.split, len(self.ops)):
            if line in self.free:
                found[line] = frozenset([self.free[line]])
            elif self.ops[line] not in FLAT:
                given = self._sloping(line)
                found[line] = frozenset().union(*(found.get(a, frozenset()) for a in given))
        needed: set[int] = set(self.program.results.tolist())
        for line in range(len(self.ops) - 1, self.program.split - 1, -1):
            if line in needed and found.get(line):
                needed.update(self._sloping(line))
        return {line: slopes for line, slopes in found.items() if slopes and line in needed}

    def _sloping(self, line: int) -> tuple[int, ...]:
        """Arguments through which a slope can come."""
        if self.ops[line] in FLAT:
            return ()
        return self.arguments[line][1:] if self.ops[line] is Op.SELECT else self.arguments[line]

    def value(self, line: int, fixed: bool) -> str:
        """How a line's value is called."""
        if self.ops[line] is Op.CONSTANT:
            return literal(float(self.program.start[line]))
        if line in self.inputs and (fixed or line in self.free):
            return f"in[{self.inputs[line]}]" if fixed else f"w[{self.free[line]}]"
        if not fixed and line < self.program.split:
            return f"h[{self.kept[line]}]"
        return f"{self.prefix}{line}"

    def fixed(self, results: bool = False) -> Code:
        """Statements from `in` to `h`; or to `out` the results, where there are no moving lines."""
        last = len(self.ops) if results else self.program.split
        text, counts = self._statements(range(last), fixed=True)
        if results:
            wanted = [(f"out[{k}]", line) for k, line in enumerate(self.program.results.tolist())]
        else:
            wanted = [(f"h[{place}]", line) for line, place in self.kept.items()]
        text += [f"    {name} = {self.value(line, True)};" for name, line in wanted]
        return Code(Own("\n".join(text)), counts, len(text))

    def moving(self) -> Code:
        """Statements from `h` and `w` to `mean` and `slope`."""
        text, counts = self._statements(range(self.program.split, len(self.ops)), fixed=False)
        count = len(self.free)
        for k, line in enumerate(self.program.results.tolist()):
            text.append(f"    mean[{k}] = {self.value(line, False)};")
            for i in range(count):
                has = i in self.slopes.get(line, frozenset())
                text.append(f"    slope[{k}][{i}] = {self._tangent(line, i) if has else 'WG(0.0)'};")
        return Code(Own("\n".join(text)), counts, len(text))

    def _tangent(self, line: int, i: int) -> str:
        return "WG(1.0)" if line in self.free else f"t{line}_{i}"

    def _statements(self, lines: range, fixed: bool) -> tuple[list[str], Counts]:
        text: list[str] = []
        counts: Counts = Counter()
        section = None
        for line in lines:
            op = self.ops[line]
            if op in FREE_OF_CHARGE:
                continue
            if self.program.sections[line] != section:
                section = self.program.sections[line]
                text.append(f"    /* {c_comment(section)} */")
            names = dict(zip("abc", (self.value(a, fixed) for a in self.arguments[line]), strict=False))
            text.append(f"    const wg_real {self.prefix}{line} = {_VALUE[op].format(**names)};")
            counts[_KIND.get(op, "other")] += 1
            for i in sorted(self.slopes.get(line, frozenset())) if not fixed else ():
                statement = self._slope(line, i, names)
                text.append(f"    const wg_real t{line}_{i} = {statement};")
                counts[_SLOPE_COST.get(op, "multiply")] += 1
                counts["multiply" if op is Op.DIV else "add"] += 1
        return text, counts

    def _slope(self, line: int, i: int, names: dict[str, str]) -> str:
        op, given = self.ops[line], self.arguments[line]
        has = [i in self.slopes.get(a, frozenset()) for a in given]
        t = [self._tangent(a, i) if yes else "WG(0.0)" for a, yes in zip(given, has, strict=True)]
        a, b = names.get("a", ""), names.get("b", "")
        v = f"{self.prefix}{line}"
        if op in _SLOPE:
            return _SLOPE[op].format(t=t[0], a=a, v=v)
        if op is Op.SELECT:
            return f"{a} != 0 ? {t[1]} : {t[2]}"
        if op in (Op.MAX, Op.MIN):
            return f"{a} {'>=' if op is Op.MAX else '<='} {b} ? {t[0]} : {t[1]}"
        if op in (Op.ADD, Op.SUB):
            sign = "+" if op is Op.ADD else "-"
            return f"{t[0]} {sign} {t[1]}" if all(has) else t[0] if has[0] else f"{'' if op is Op.ADD else '-'}{t[1]}"
        if op is Op.MUL:
            parts = [f"{t[0]} * {b}"] * has[0] + [f"{a} * {t[1]}"] * has[1]
            return " + ".join(parts)
        if op is Op.DIV:
            parts = [f"WG(1.0) / {b} * {t[0]}"] * has[0] + [f"-{v} / {b} * {t[1]}"] * has[1]
            return " + ".join(parts)
        assert op is Op.ATAN2
        square = f"({a} * {a} + {b} * {b})"
        parts = [f"{b} / {square} * {t[0]}"] * has[0] + [f"-{a} / {square} * {t[1]}"] * has[1]
        return f"{square} > 0 ? {' + '.join(parts)} : WG(0.0)"
