"""Prints the kernels of `compensate` as C99: the functions that are `printed`, and the structs of their tables.

The functions say little that C does not say in the same words: assignments, `for` over `range`, `if`, arithmetic,
`math`, calls of each other, arrays whose shapes the annotations give. Tuples of constants become static tables
(`wg_...`) and macros (`WG_...`), and vanish from the arguments; tuples that change become structs, handed over by
pointer. Anything else raises `Unprintable`, with the line.
"""

import ast
import inspect
import re
from dataclasses import dataclass, field
from textwrap import wrap
from types import ModuleType
from typing import Any

from wrenchgap.compensate import allocation_kernels, kernels, tables
from wrenchgap.compensate.c_expressions import (
    ATOM,
    CONSTANT,
    INT,
    OPERATORS,
    REAL,
    Expressions,
    Type,
    Unprintable,
    Written,
    bounds,
    fields_of,
    name_of_constant,
    type_of,
)
from wrenchgap.compensate.compiling import PRINTED

STRUCTS = {"Memory": "wg_memory", "Observed": "wg_memory", "ReachRoom": "wg_reach_room", "Room": "wg_room"}
STRUCTS |= {"AllocationRoom": "wg_room", "AllocationMemory": "wg_memory", "AllocationCommand": "wg_command"}
"""Tuples that change, and their structs; a `Tape` has none."""


def is_tuple(kind: Type) -> bool:
    """Whether it is one of `tables`."""
    return kind.name in CONSTANT or kind.name in STRUCTS or kind.name == "Tape"


def is_constant(kind: Type) -> bool:
    """Whether it vanishes from the arguments."""
    return kind.name in CONSTANT or kind.name == "Tape"


def members(name: str) -> str:
    """The members of a struct, one a line, for a tuple that changes."""
    lines = []
    for part, kind in fields_of(name).items():
        sizes = () if kind.sizes == ("1",) else kind.sizes
        lines.append(f"    {STRUCTS.get(kind.name, kind.name)} {part}{bounds(sizes)};")
    return "\n".join(lines)


@dataclass
class Function:
    """A function of the module: its arguments, and which of them it writes to."""

    node: ast.FunctionDef
    arguments: dict[str, Type]
    result: str
    written: set[str] = field(default_factory=set)


class Printer:
    """Prints the functions of a module in its order; those decorated with `external` are only declared elsewhere."""

    def __init__(self, module: ModuleType) -> None:
        self.module = module
        tree = ast.parse(inspect.getsource(module))
        self.functions: dict[str, Function] = {}
        self.printed: list[str] = []
        for node in tree.body:
            if isinstance(node, ast.FunctionDef):
                decorators = {_called(d) for d in node.decorator_list}
                if decorators & {*PRINTED, "external"}:
                    self.functions[node.name] = self._function(node)
                    if not decorators & {"external"}:
                        self.printed.append(node.name)
        self._find_written()

    def _function(self, node: ast.FunctionDef) -> Function:
        def hint(text: ast.expr | None) -> Any:
            name = ast.unparse(text) if text else "None"
            known = {"int": int, "float": float, "bool": bool, "None": None}
            return known[name] if name in known else getattr(self.module, name, None) or getattr(tables, name)

        arguments = {a.arg: type_of(hint(a.annotation)) for a in node.args.args}
        result = {"None": "void", "float": "wg_real"}.get(ast.unparse(node.returns) if node.returns else "None", "int")
        return Function(node, arguments, result)

    def _find_written(self) -> None:
        """Arguments through which something is written, by a function or by one that it calls."""
        changed = True
        while changed:
            changed = False
            for one in self.functions.values():
                before = len(one.written)
                one.written |= self._written_in(one)
                changed = changed or len(one.written) > before

    def _written_in(self, one: Function) -> set[str]:
        calls = [d for d in one.node.decorator_list if isinstance(d, ast.Call) and _called(d) == "external"]
        found = {str(ast.literal_eval(argument)) for call in calls for argument in call.args}
        for node in ast.walk(one.node):
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            for target in targets:
                if isinstance(target, ast.Subscript):
                    found.add(_root(target))
            if isinstance(node, ast.Call) and ast.unparse(node.func) in self.functions:
                called = self.functions[ast.unparse(node.func)]
                for argument, name in zip(node.args, called.arguments, strict=True):
                    if name in called.written:
                        found.add(_root(argument))
        return found & set(one.arguments)

    def signature(self, name: str) -> str:
        """The head of a function."""
        one, parts = self.functions[name], []
        for argument, kind in one.arguments.items():
            if is_constant(kind):
                continue
            if kind.name in STRUCTS:
                parts.append(f"{'' if argument in one.written else 'const '}{STRUCTS[kind.name]} *{argument}")
            elif len(kind.sizes) > 1:
                parts.append(f"{kind.name} {argument}{bounds(kind.sizes)}")
            elif kind.sizes:
                parts.append(f"{'' if argument in one.written else 'const '}{kind.name} *{argument}")
            else:
                parts.append(f"{kind.name} {argument}")
        return f"static {one.result} wg_{name}({', '.join(parts) or 'void'})"

    def text(self, names: list[str] | None = None) -> str:
        """The functions, each with its docstring as a comment."""
        return "\n\n".join(self._text(name) for name in self.printed if names is None or name in names)

    def _text(self, name: str) -> str:
        one = self.functions[name]
        note = " ".join(f"{ast.get_docstring(one.node) or ''} */".replace("`", "").split())
        comment = wrap(note, 120, initial_indent="/* ", subsequent_indent=" * ", break_on_hyphens=False)
        body = _Body(self, one)
        statements = body.block(one.node.body[1:], 1)
        declared = [f"    {kind}{name};" for name, kind in body.declared.items()]
        return "\n".join([*comment, self.signature(name), "{", *declared, *statements, "}"])

    def constants(self) -> str:
        """Constants of the module that the functions name: whole numbers as an enum, the others as macros."""
        used = {n.id for f in self.printed for n in ast.walk(self.functions[f].node) if isinstance(n, ast.Name)}
        named = {n: v for n, v in vars(self.module).items() if n in used and isinstance(v, int | float | tuple)}
        whole = [f"    WG_{n} = {v}" for n, v in named.items() if isinstance(v, int)]
        lines = ["enum {", ",\n".join(whole), "};"]
        lines += [f"#define WG_{n} WG({v!r})" for n, v in named.items() if isinstance(v, float)]
        for n, v in named.items():
            if isinstance(v, tuple):
                values = ", ".join(f"WG({x!r})" for x in v)
                lines.append(f"static const wg_real wg_{n.lower()}[{len(v)}] = {{{values}}};")
        return "\n".join(lines)


def _called(node: ast.expr) -> str:
    return ast.unparse(node.func if isinstance(node, ast.Call) else node)


def _root(node: ast.expr) -> str:
    while isinstance(node, ast.Subscript | ast.Attribute):
        node = node.value
    return node.id if isinstance(node, ast.Name) else ""


class _Body(Expressions):
    """Prints the statements of one function."""

    def __init__(self, printer: Printer, one: Function) -> None:
        super().__init__()
        self.printer, self.one = printer, one
        self.known: dict[str, Type] = dict(one.arguments)
        self.constants: set[str] = set()
        self.declared: dict[str, str] = {}

    def block(self, nodes: list[ast.stmt], depth: int) -> list[str]:
        """Statements, indented."""
        return [line for node in nodes for line in self._statement(node, "    " * depth, depth)]

    def _statement(self, node: ast.stmt, pad: str, depth: int) -> list[str]:
        if isinstance(node, ast.Assign):
            return self._assign(node, pad)
        if isinstance(node, ast.AugAssign):
            sign, _ = OPERATORS[type(node.op)]
            return [f"{pad}{self.plain(node.target)} {sign}= {self.plain(node.value)};"]
        if isinstance(node, ast.Expr):
            return [f"{pad}{self.plain(node.value)};"]
        if isinstance(node, ast.Return):
            return [f"{pad}return{'' if node.value is None else ' ' + self.plain(node.value)};"]
        if isinstance(node, ast.Break | ast.Continue):
            return [f"{pad}{'break' if isinstance(node, ast.Break) else 'continue'};"]
        if isinstance(node, ast.For):
            name = ast.unparse(node.target)
            if name in self.declared:
                raise Unprintable(node, f"{name} counts a loop, and is a number outside of it")
            lines = [f"{pad}{self._head(node)} {{", *self.block(node.body, depth + 1), f"{pad}}}"]
            del self.known[name]  # in C it is known in the loop alone
            return lines
        if isinstance(node, ast.If):
            lines = [f"{pad}if ({self.plain(node.test)}) {{", *self.block(node.body, depth + 1)]
            if len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If):
                first, *rest = self._statement(node.orelse[0], pad, depth)
                return [*lines, f"{pad}}} else {first.strip()}", *rest]
            if node.orelse:
                lines += [f"{pad}}} else {{", *self.block(node.orelse, depth + 1)]
            return [*lines, f"{pad}}}"]
        raise Unprintable(node, type(node).__name__)

    def _assign(self, node: ast.Assign, pad: str) -> list[str]:
        (target,) = node.targets
        if not isinstance(target, ast.Name):
            return [f"{pad}{self.plain(target)} = {self.plain(node.value)};"]
        text, kind, _ = self.expression(node.value)
        if is_tuple(kind):  # another name of a tuple of constants
            self.known[target.id] = kind
            return []
        if target.id not in self.known:
            self.known[target.id] = kind
            constant = "const " if kind.sizes and text.startswith("wg_") else ""
            self.declared[target.id] = f"{constant}{kind.name} {'*' if kind.sizes else ''}"
        elif self.known[target.id] != kind:
            raise Unprintable(node, f"{target.id} changes its type")
        return [f"{pad}{target.id} = {text};"]

    def _head(self, node: ast.For) -> str:
        if not (
            isinstance(node.target, ast.Name) and isinstance(node.iter, ast.Call) and _called(node.iter) == "range"
        ):
            raise Unprintable(node, "a loop that is not over range")
        name = node.target.id if node.target.id != "_" else "turn"
        self.known[node.target.id] = INT
        given = [self.plain(a) for a in node.iter.args]
        first, last, by = (["0", *given, "1"] if len(given) == 1 else [*given, "1"])[:3]
        down = by == "-1"
        advance = f"{name}--" if down else f"{name}++"
        return f"for (int {name} = {first}; {name} {'>' if down else '<'} {last}; {advance})"

    def _name(self, node: ast.Name) -> Written:
        if node.id in self.known:
            return ("turn" if node.id == "_" else node.id), self.known[node.id], ATOM
        value = getattr(self.printer.module, node.id, None)
        if isinstance(value, tuple):
            return f"wg_{node.id.lower()}", Type("wg_real", (str(len(value)),)), ATOM
        if isinstance(value, int | float):
            return f"WG_{node.id}", INT if isinstance(value, int) else REAL, ATOM
        raise Unprintable(node, node.id)

    def _attribute(self, node: ast.Attribute) -> Written:
        if ast.unparse(node) in ("math.nan", "math.inf"):
            return super()._attribute(node)
        base, owner, _ = self.expression(node.value)
        if not is_tuple(owner):
            raise Unprintable(node, ast.unparse(node))
        kind = fields_of(owner.name)[node.attr]
        if is_constant(owner):
            return ("" if is_tuple(kind) else name_of_constant(owner.name, node.attr, kind)), kind, ATOM
        return f"{base}{'->' if isinstance(node.value, ast.Name) else '.'}{node.attr}", kind, ATOM

    def _subscript(self, node: ast.Subscript) -> Written:
        base, kind, _ = self.expression(node.value)
        if isinstance(node.value, ast.Attribute) and kind.sizes == ("1",):
            return base, Type(kind.name), ATOM
        places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        start = ""
        if isinstance(places[-1], ast.Slice):
            start = "" if places[-1].lower is None else self.plain(places[-1].lower)
            places = places[:-1]
        text = base + "".join(f"[{self.plain(place)}]" for place in places)
        left = Type(kind.name, kind.sizes[len(places) :])
        return (f"{text} + {start}", left, 4) if start else (text, left, ATOM)

    def _call(self, node: ast.Call) -> Written:
        name = ast.unparse(node.func)
        if name == "len":
            return self.expression(node.args[0])[1].sizes[0], INT, ATOM
        if name not in self.printer.functions:
            return super()._call(node)
        called, given = self.printer.functions[name], []
        for argument, kind in zip(node.args, called.arguments.values(), strict=True):
            if not is_constant(kind):
                inner = kind.name in STRUCTS and not isinstance(argument, ast.Name)
                given.append(f"{'&' if inner else ''}{self.plain(argument)}")
        kind = REAL if called.result == "wg_real" else INT
        return f"wg_{name}({', '.join(given)})", kind, ATOM


OBSERVING = ("torque_made", "observe", "remember_asked", "stop_watching", "take_back", "estimate_kept")
"""Functions that only an observer needs."""


def struct(*names: str) -> str:
    """The struct of a tuple that changes; the members of a second one are there with an observer alone."""
    parts = [members(names[0]), *(f"#if WG_OBSERVER\n{members(name)}\n#endif" for name in names[1:])]
    return "\n".join(["typedef struct {", *parts, f"}} {STRUCTS[names[0]]};"])


def period_text() -> str:
    """The generated part of an exported compensation: constants, room to work in, and the functions of a period."""
    printer = Printer(kernels)
    parts = [
        "/* Printed from compensate/kernels.py of wrenchgap (`make generated`); not to be edited. */",
        printer.constants(),
        *map(struct, ("ReachRoom", "Room")),
        *(f"{printer.signature(name)};" for name in ("physics_fixed", "physics_moving", "physics_sent")),
        printer.text([name for name in printer.printed if name not in OBSERVING]),
        "#if WG_OBSERVER",
        printer.text(list(OBSERVING)),
        "#endif",
    ]
    return "\n\n".join(parts) + "\n"


def memory_text() -> str:
    """The struct of what is remembered, for the header of an exported compensation."""
    return struct("Memory", "Observed") + "\n"


ANSWER = """
/* Thrusts [N] of the nominal rotors, tilts [rad] of the arms, each within its limits; the wrench that they make by the
 * model, which an integrator should be told of; the smallest distance of a rotor from its limits, as a share of half its
 * range (of its thrust where the arm tilts); status. */"""  # noqa: E501


def allocation_names(text: str) -> str:
    """Names of the exported allocation: it may stand beside the compensation."""
    return re.sub(r"\bWG(?=[_(])", "WGA", re.sub(r"\bwg_", "wga_", text))


def allocation_header() -> str:
    """The generated part of an exported allocation's header: statuses, what is remembered, the answer."""
    statuses, _, _ = Printer(allocation_kernels).constants().partition("#define")
    parts = [statuses, "/* What is remembered: the command before. */", struct("AllocationMemory")]
    return allocation_names("\n".join([*parts, ANSWER, struct("AllocationCommand")]))


def allocation_text() -> str:
    """The generated part of an exported allocation: constants, room to work in, functions."""
    printer = Printer(allocation_kernels)
    macros = printer.constants().partition("};\n")[2]
    note = "/* Printed from compensate/allocation_kernels.py of wrenchgap. */"
    return allocation_names("\n\n".join([macros, struct("AllocationRoom"), note, printer.text()]))
