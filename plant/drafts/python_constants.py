"""Numbers that a Python file assigns, read from its text: nothing of it is run or imported.

What counts, and no more: numbers, texts, lists, dicts with keys of text; the array of a list, `np.array([...])`; names
of numbers that were assigned above; + - * / of numbers, and of a number with an array. `import numpy as np` and texts
that stand alone (docstrings) are skipped. So nothing grows: an array has as many entries as the text writes out.
"""

import ast
import operator
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.reader import quoted, text_of

LONGEST = 2**16
"""Characters: files of parameters have some thousands, and a parser needs a hundred times as many bytes."""
OPERATIONS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
READ = "numbers, texts, lists, dicts, np.array([...]) and + - * / of numbers are read, and nothing is run"

Constant = float | str | Array | list[Any] | dict[str, Any]


class _Unread(Exception):
    """An expression that is none of a constant; its node is the argument."""


def constants(path: Path) -> dict[str, Constant]:
    """What the file assigns at its top level, by name, later assignments in place of earlier ones.

    Raises ModelError, in one line, for a file that cannot be read or has anything else in it.
    """
    text = text_of(path, "as Python")
    if len(text) > LONGEST:
        raise ModelError(
            f"{path.name}: is longer than {LONGEST:,} characters; leave the assignment of parameters alone"
        )
    found: dict[str, Constant] = {}
    numpy: set[str] = set()
    for statement in _statements(text, path.name):
        try:
            match statement:
                case ast.Expr(value=ast.Constant(value=str())):
                    pass
                case ast.Import(names=[ast.alias(name="numpy", asname=asname)]):
                    numpy.add(asname or "numpy")
                case ast.Assign(targets=[ast.Name(id=name)], value=value):
                    found[name] = _evaluated(value, found, numpy)
                case _:
                    raise _Unread(statement)
        except _Unread as error:
            line = error.args[0].lineno
            said = quoted(repr(text.split("\n")[line - 1].strip()))
            raise ModelError(
                f"{path.name}, line {line}: got {said}; {READ}: write the number there, or take the line out"
            ) from None
    return found


def _statements(text: str, where: str) -> list[ast.stmt]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what runs
            return ast.parse(text).body
    except SyntaxError as error:
        raise ModelError(f"{where}, line {error.lineno or 1}: is not Python: {error.msg}") from None
    except ValueError:  # a zero byte
        raise ModelError(f"{where}: is not Python: it has a zero byte") from None
    except (RecursionError, MemoryError):
        raise ModelError(
            f"{where}: is not Python that is read here: expressions within one another without end"
        ) from None


def _evaluated(node: ast.expr, known: Mapping[str, Constant], numpy: set[str], levels: int = 20) -> Constant:
    """The constant that an expression is; raises `_Unread` for any other, and for more `levels` within one another."""
    if levels < 0:
        raise _Unread(node)

    def inner(one: ast.expr) -> Constant:
        return _evaluated(one, known, numpy, levels - 1)

    match node:
        case ast.Constant(value=str() as text):
            return text
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return _finite(node, lambda: float(number))
        case ast.Name(id=name) if isinstance(value := known.get(name), float):
            return value
        case ast.List(elts=entries) | ast.Tuple(elts=entries):
            return [inner(one) for one in entries]
        case ast.Dict(keys=keys, values=values):
            names = [key.value if isinstance(key, ast.Constant) and isinstance(key.value, str) else "" for key in keys]
            if not all(names) or len(set(names)) < len(names):
                raise _Unread(node)
            return {name: inner(one) for name, one in zip(names, values, strict=True)}
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=operand):
            value = inner(operand)
            return _finite(node, lambda: _computed(operator.mul, -1.0 if isinstance(sign, ast.USub) else 1.0, value))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATIONS:
            first, second = inner(left), inner(right)
            return _finite(node, lambda: _computed(OPERATIONS[type(op)], first, second))
        case ast.Call(
            func=ast.Attribute(value=ast.Name(id=module), attr="array"), args=[ast.List() as entries], keywords=[]
        ) if module in numpy:
            listed = inner(entries)
            return _finite(node, lambda: np.array(_numbers(listed), dtype=float))
    raise _Unread(node)


def _numbers(value: Constant) -> Constant:
    """The value, of which every entry is a number; TypeError for others: numpy takes texts for numbers."""
    if isinstance(value, list):
        return [_numbers(one) for one in value]
    if not isinstance(value, float):
        raise TypeError
    return value


def _computed(operation: Callable[[Any, Any], Any], first: Constant, second: Constant) -> float | Array:
    """The operation on two numbers, or on a number and an array; TypeError for others."""
    kinds = [isinstance(one, float) for one in (first, second)]
    arrays = [isinstance(one, np.ndarray) for one in (first, second)]
    if not any(kinds) or not all(a or b for a, b in zip(kinds, arrays, strict=True)):
        raise TypeError
    with np.errstate(all="ignore"):
        return operation(np.float64(first) if kinds[0] else first, second)  # type: ignore[no-any-return, arg-type]


def _finite(node: ast.expr, compute: Callable[[], float | Array]) -> float | Array:
    """The finite number or array that is computed; raises `_Unread` where it is none."""
    try:
        out = compute()
    except (TypeError, ValueError, ArithmeticError):
        raise _Unread(node) from None
    if not np.all(np.isfinite(out)):
        raise _Unread(node)
    return out if isinstance(out, np.ndarray) else float(out)
