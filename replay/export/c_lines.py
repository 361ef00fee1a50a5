"""A program (`plant.trace.tape`) as C: one statement a line, its tangents beside it, nothing that is zero or unused.

Statements and their order are those of the compiled tape (`plant.trace.tape`), so that both round alike. They are
counted: what an exported step costs, operations at worst and usually, and memory.
"""

import ast
import math
from collections import Counter
from dataclasses import dataclass

from wrenchgap._escaping import c_comment
from wrenchgap.compensate.c_expressions import PRODUCT, Expressions
from wrenchgap.compensate.fast import Plan, compensation_of, sizes_of
from wrenchgap.compensate.kernels import PULLS, ROUNDS
from wrenchgap.compensate.tables import Room, layout
from wrenchgap.flight.flight import Array
from wrenchgap.plant.trace.operations import ARITY, CHOOSING, FLAT, Op, chosen_of, expressions, slopes_of, value_of
from wrenchgap.plant.trace.tape import Program

FREE_OF_CHARGE = (Op.INPUT, Op.CONSTANT)
KINDS = ("add", "multiply", "divide", "sqrt", "exp", "trig", "other")
"""Operations, in the order of the tables; `exp` counts logarithms too, `trig` sine, cosine and atan2, `other`
comparisons, absolute values and signs."""
OPERATORS = {ast.Add: "add", ast.Sub: "add", ast.Mult: "multiply", ast.Div: "divide"}
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


def rows_text(values: Array) -> Own:
    """Rows of an array (K, C) as initialisers in C, in double precision."""
    texts = (", ".join("NAN" if math.isnan(v) else repr(v) for v in row) for row in values.astype(float).tolist())
    return Own(",\n".join(f"    {{{text}}}" for text in texts))


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
            found[OPERATORS[type(node.op)]] += 1
        elif isinstance(node, ast.Call):
            found[CALLED.get(ast.unparse(node.func).rpartition(".")[2], "other")] += 1
        elif isinstance(node, ast.IfExp | ast.UnaryOp):
            found["other"] += 1
    return found


@dataclass(frozen=True)
class Cost:
    """Operations (`KINDS`) of a step `at_worst` and as it went in the recorded steps (`usual`), and bytes.

    tables    constants, in read-only memory
    memory    a `wg_memory`
    stack     upper bound: the room of a period, and every number of the longest piece of physics at once
    evaluations_usual, evaluations_worst   of the model in a step
    """

    at_worst: dict[str, int]
    usual: dict[str, int]
    evaluations_usual: float
    evaluations_worst: int
    tables: int
    memory: int
    stack: int


@dataclass(frozen=True)
class Pieces:
    """The generated functions; None without physics."""

    fixed: Code | None
    moving: Code | None
    sent: Code | None


def evaluations(plan: Plan) -> tuple[int, int]:
    """Evaluations of the physics alone, and of everything, in one step at worst: two searches and zero each."""
    both = plan.gate.has_process and plan.gate.has_physics
    each = 2 * plan.gate.most + 1
    return (each if both else 0), each


def _scaled(counts: Counts, factor: float) -> Counts:
    return Counter({kind: round(number * factor) for kind, number in counts.items()})


def _process(plan: Plan) -> tuple[Counts, Counts]:
    """Operations of the mean with its derivatives, and of sigma."""
    if plan.expansion is None:
        return Counter(), Counter()
    outputs, points, inputs = plan.expansion.points.shape
    distances = Counter(add=2 * inputs * points, multiply=inputs * points, divide=2 * inputs)
    mean = distances + Counter(multiply=3 * points, exp=points, add=points)
    mean += Counter(add=3 * inputs, multiply=inputs, divide=inputs)
    mean += Counter(add=2 * outputs * points, multiply=outputs * points, divide=4 * outputs)
    pairs = points * (points + 1) // 2 if plan.expansion.triangular else points * points
    sigma = distances + Counter(multiply=2 * points, exp=points, sqrt=1, divide=1)
    sigma += Counter(add=pairs + points, multiply=pairs + points)
    return _scaled(mean, outputs), _scaled(sigma, outputs)


def _reach(plan: Plan) -> tuple[Counts, Counts]:
    """Operations of looking whether a wrench is within reach, and of the search for the nearest that is."""
    table = plan.reach.table
    limits, arms = len(table.rows), len(table.middle)
    looking = Counter(add=6 * limits + 5 * arms, multiply=6 * limits + 3 * arms, divide=6 + arms, trig=arms, sqrt=arms)
    looking += Counter(other=2 * limits + 3 * arms)
    turn = looking + Counter(add=14 * limits + 36, multiply=6 * limits + 36, divide=2 * arms, trig=4 * arms, sqrt=arms)
    return looking, _scaled(turn, ROUNDS) + _scaled(looking + Counter(add=12, multiply=6), PULLS)


def cost(plan: Plan, pieces: Pieces, usual: float, number: int, table_numbers: int) -> Cost:
    """The cost of a step; `usual` is the mean number of evaluations, `number` the bytes of one number."""
    size = len(plan.gate.rows)
    alone, whole = evaluations(plan)
    mean, sigma = _process(plan)
    physics = pieces.moving.counts if pieces.moving else Counter()
    around = Counter(sigma)
    for piece in (pieces.fixed, pieces.sent):
        around += piece.counts if piece else Counter()
    once = size**3 + size**2  # of a proposal: normal equations, Cholesky, two triangular systems
    each = physics + Counter(add=once, multiply=once, divide=size**2, sqrt=size, other=8 * size)
    looking, finding = _reach(plan)
    around += _scaled(looking, 3)
    worst = _scaled(each, alone) + _scaled(each + mean, whole + 1) + around + _scaled(finding, 2)
    share = whole / (alone + whole)
    often = _scaled(each, usual * (1 - share)) + _scaled(each + mean, usual * share + 1) + around
    memory = 6 * 6 + 2 + (plan.physics.arms + plan.physics.memory if plan.physics else 0) + 1
    sizes = sizes_of(plan, compensation_of(plan)) | {"WG_FIXED": pieces.fixed.numbers if pieces.fixed else 0}
    room = sum(math.prod(sizes[n] if isinstance(n, str) else n for n in entry.shape) for entry in layout(Room))
    functions = [p.numbers for p in (pieces.fixed, pieces.moving, pieces.sent) if p]
    frames = 250  # numbers of the calls themselves: locals, arguments, saved registers, of ten functions at most
    stack = room + sizes["WG_ROW"] + max([0, *functions]) + frames
    return Cost(
        at_worst={kind: worst[kind] for kind in KINDS},
        usual={kind: often[kind] for kind in KINDS},
        evaluations_usual=usual,
        evaluations_worst=alone + whole,
        tables=table_numbers * number,
        memory=memory * number,
        stack=stack * number,
    )
