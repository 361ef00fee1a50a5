"""A program (`plant.trace.tape`) as C: one statement a line, its tangents beside it, nothing that is zero or unused.

Statements and their order are those of the compiled tape (`plant.trace.tape`), so that both round alike.
"""

from __future__ import annotations

import ast
import math
from collections import Counter
from dataclasses import dataclass

from wrenchgap._escaping import c_comment
from wrenchgap.compensate.c_expressions import PRODUCT, Expressions
from wrenchgap.plant.trace.operations import ARITY, CHOOSING, FLAT, Op, chosen_of, expressions, slopes_of, value_of
from wrenchgap.plant.trace.tape import Program

FREE_OF_CHARGE = (Op.INPUT, Op.CONSTANT)
KINDS = {ast.Add: "add", ast.Sub: "add", ast.Mult: "multiply", ast.Div: "divide"}
CALLED = {"sqrt": "sqrt", "exp": "exp", "log": "exp", "sin": "trig", "cos": "trig", "atan2": "trig"}
"""What operators and functions count as; comparisons and moves count as others."""


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
            written = expressions(value_of)[op]
            text.append(f"    const wg_real {self.prefix}{line} = {Expressions(names).plain(written)};")
            counts.update(_counted(written))
            for i in sorted(self.slopes.get(line, frozenset())) if not fixed else ():
                statement, cost = self._slope(line, i, names | {"value": f"{self.prefix}{line}"})
                text.append(f"    const wg_real t{line}_{i} = {statement};")
                counts.update(cost)
        return text, counts

    def _slope(self, line: int, i: int, names: dict[str, str]) -> tuple[str, Counts]:
        """The tangent of a line with respect to the i-th free input, and what it costs."""
        op, given, write = self.ops[line], self.arguments[line], Expressions(names)
        has = [i in self.slopes.get(a, frozenset()) for a in given]
        tangents = [self._tangent(a, i) if yes else "WG(0.0)" for a, yes in zip(given, has, strict=True)]
        if op in CHOOSING:
            chosen = expressions(chosen_of)[op]
            assert isinstance(chosen, ast.IfExp)
            yes, no = (tangents[ast.literal_eval(part)] for part in (chosen.body, chosen.orelse))
            return f"{write.plain(chosen.test)} ? {yes} : {no}", Counter(other=1)
        slopes = expressions(slopes_of)[op]
        assert isinstance(slopes, ast.Tuple)
        parts = [(s, t) for s, t, there in zip(slopes.elts, tangents, has, strict=False) if there]
        terms = [_times(write, slope, tangent) for slope, tangent in parts]
        cost = sum((_counted(slope) for slope, _ in parts), Counter(multiply=len(parts), add=len(parts) - 1))
        return " + ".join(terms), cost


def _times(write: Expressions, slope: ast.expr, tangent: str) -> str:
    """A slope times a tangent, where it is not one."""
    factor = {"1.0": "", "-1.0": "-"}.get(ast.unparse(slope))
    if factor is not None:
        return f"{factor}{tangent}"
    text, _, binding = write.expression(slope)
    return f"{text if binding >= PRODUCT else f'({text})'} * {tangent}"


def _counted(written: ast.expr) -> Counts:
    """Operations of an expression, all of its branches."""
    found: Counts = Counter()
    for node in ast.walk(written):
        if isinstance(node, ast.BinOp):
            found[KINDS[type(node.op)]] += 1
        elif isinstance(node, ast.Call):
            found[CALLED.get(ast.unparse(node.func).rpartition(".")[2], "other")] += 1
        elif isinstance(node, ast.IfExp | ast.UnaryOp):
            found["other"] += 1
    return found
