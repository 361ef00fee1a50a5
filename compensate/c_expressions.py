"""Expressions of Python as C99, and what the parts of `compensate.tables` and `allocation_tables` are called in C."""

import ast
from dataclasses import dataclass
from typing import Any, get_args, get_type_hints

from wrenchgap.compensate import allocation_tables, tables

CALLS = {
    "math.sqrt": "wg_sqrt",
    "math.exp": "wg_exp",
    "math.sin": "wg_sin",
    "math.cos": "wg_cos",
    "math.atan2": "wg_atan2",
    "math.log": "wg_log",
    "math.floor": "wg_floor",
    "np.floor": "wg_floor",
    "abs": "wg_fabs",
    "math.isfinite": "isfinite",
    "math.isinf": "isinf",
    "math.isnan": "isnan",
}
TRUTHS = ("isfinite", "isinf", "isnan")
OPERATORS: dict[type, tuple[str, int]] = {
    ast.Mult: ("*", 5), ast.Div: ("/", 5), ast.Mod: ("%", 5), ast.Add: ("+", 4), ast.Sub: ("-", 4),
    ast.Lt: ("<", 3), ast.LtE: ("<=", 3), ast.Gt: (">", 3), ast.GtE: (">=", 3), ast.Eq: ("==", 3), ast.NotEq: ("!=", 3),
    ast.And: ("&&", 2), ast.Or: ("||", 1),
}  # fmt: skip
"""How each is written, and how tightly it binds."""
ATOM, UNARY, PRODUCT, CHOICE = 9, 6, 5, 0


class Unprintable(Exception):
    """Something that the printer does not know, and where."""

    def __init__(self, node: ast.AST, what: str) -> None:
        super().__init__(f"line {getattr(node, 'lineno', '?')}: {what}")


@dataclass(frozen=True)
class Type:
    """Of an expression: `wg_real`, `int`, or the name of a tuple; with the sizes of an array."""

    name: str
    sizes: tuple[str, ...] = ()


REAL, INT = Type("wg_real"), Type("int")
Written = tuple[str, Type, int]
"""Text, type, and how tightly it binds."""


class Expressions:
    """Prints expressions; `names` has the texts of numbers by their names."""

    def __init__(self, names: dict[str, str] | None = None) -> None:
        self.names = names or {}

    def plain(self, node: ast.expr) -> str:
        """The text of an expression."""
        return self.expression(node)[0]

    def _within(self, node: ast.expr, binding: int) -> str:
        """The text of a part, in brackets where it binds less tightly."""
        text, _, own = self.expression(node)
        return f"({text})" if own < binding else text

    def expression(self, node: ast.expr) -> Written:
        """Text, type, and how tightly it binds."""
        kind = type(node).__name__
        known = getattr(self, f"_{kind.lower()}", None)
        if known is None:
            raise Unprintable(node, kind)
        found: Written = known(node)
        return found

    def _constant(self, node: ast.Constant) -> Written:
        if isinstance(node.value, int):  # or bool
            return str(int(node.value)), INT, ATOM
        return f"WG({node.value!r})", REAL, ATOM

    def _binop(self, node: ast.BinOp) -> Written:
        sign, binding = OPERATORS[type(node.op)]
        types = {self.expression(part)[1] for part in (node.left, node.right)}
        text = f"{self._within(node.left, binding)} {sign} {self._within(node.right, binding + 1)}"
        return text, INT if types == {INT} else REAL, binding

    def _unaryop(self, node: ast.UnaryOp) -> Written:
        _, kind, _ = self.expression(node.operand)
        sign = {ast.Not: "!", ast.USub: "-"}[type(node.op)]
        return f"{sign}{self._within(node.operand, UNARY)}", INT if sign == "!" else kind, UNARY

    def _compare(self, node: ast.Compare) -> Written:
        if len(node.ops) > 1:
            raise Unprintable(node, "a chain of comparisons")
        sign, binding = OPERATORS[type(node.ops[0])]
        parts = (self._within(node.left, binding + 1), self._within(node.comparators[0], binding + 1))
        return f"{parts[0]} {sign} {parts[1]}", INT, binding

    def _boolop(self, node: ast.BoolOp) -> Written:
        sign, binding = OPERATORS[type(node.op)]
        inner = binding if isinstance(node.op, ast.And) else 3  # what && binds is put in brackets behind ||
        return f" {sign} ".join(self._within(value, inner) for value in node.values), INT, binding

    def _ifexp(self, node: ast.IfExp) -> Written:
        yes, kind, _ = self.expression(node.body)
        no, other, _ = self.expression(node.orelse)
        if kind != other:
            raise Unprintable(node, "a choice between two types")
        return f"{self._within(node.test, 1)} ? {yes} : {no}", kind, CHOICE

    def _name(self, node: ast.Name) -> Written:
        if node.id not in self.names:
            raise Unprintable(node, node.id)
        return self.names[node.id], REAL, ATOM

    def _attribute(self, node: ast.Attribute) -> Written:
        known = {"math.nan": "WG_NAN", "math.inf": "WG_INFINITY"}
        if ast.unparse(node) not in known:
            raise Unprintable(node, ast.unparse(node))
        return known[ast.unparse(node)], REAL, ATOM

    def _call(self, node: ast.Call) -> Written:
        name = ast.unparse(node.func)
        if name not in CALLS:
            raise Unprintable(node, f"a call of {name}")
        kind = INT if CALLS[name] in TRUTHS else REAL
        return f"{CALLS[name]}({', '.join(map(self.plain, node.args))})", kind, ATOM


CONSTANT = {
    "Compensation": "",
    "Gate": "",
    "ReachTable": "reach_",
    "Process": "process_",
    "Observer": "observer_",
    "AllocationTable": "",
}
"""Tuples whose parts are tables and macros, with what stands before their names."""
MAYBE_NONE = ("WG_POINTS", "WG_WHITENER", "WG_TILTING", "WG_ACTUATORS", "WG_FIXED")
"""Sizes that may be zero, where C has no array."""


def type_of(hint: Any) -> Type:
    """The type of an annotation of `tables`, or of an argument."""
    if hint in (int, bool):
        return INT
    if hint is float:
        return REAL
    if hasattr(hint, "_fields"):
        return Type(hint.__name__)
    sizes = [str(size) for size in getattr(hint, "__metadata__", ("?",)) if size != "int"]
    whole = get_args(hint)[:1] == (tables.Ints,) or "int" in getattr(hint, "__metadata__", ())
    return Type("int" if whole else "wg_real", tuple(sizes))


def fields_of(name: str) -> dict[str, Type]:
    """Fields of a tuple with their types."""
    owner = tables if hasattr(tables, name) else allocation_tables
    hints = get_type_hints(getattr(owner, name), include_extras=True)
    return {field: type_of(hint) for field, hint in hints.items()}


def bounds(sizes: tuple[str, ...]) -> str:
    """The brackets of a declaration."""
    return "".join(f"[WG_SIZE({size})]" if size in MAYBE_NONE else f"[{size}]" for size in sizes)


def name_of_constant(owner: str, part: str, kind: Type) -> str:
    """What a part of a tuple of constants is called in C."""
    name = CONSTANT[owner] + part
    return f"wg_{name}" if kind.sizes else f"WG_{name.upper()}"
