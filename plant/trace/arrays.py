"""Arrays that record every operation on a tape, so that an effect's own `apply` yields its program.

A `Traced` is a numpy array of `Node`; numpy hands its functions over (NEP 13 and 18), so that code written for numbers
runs unchanged. A branch on a value (`if thrust > 0`) cannot be recorded and raises `Untraceable`.

`traced_model` has the effects of a model traced; the memory of effects is taken apart and put together again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from wrenchgap.plant.effects.effect import AnyEffect
from wrenchgap.plant.trace.operations import Op
from wrenchgap.plant.trace.tape import Tape
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel


class Untraceable(Exception):
    """Code that branches on a value, or uses a function that a tape does not have."""


class Node:
    """One number on a tape."""

    __slots__ = ("line", "tape")
    __array_priority__ = 1000

    def __init__(self, tape: Tape, line: int) -> None:
        self.tape, self.line = tape, line

    def _as(self, other: Any) -> Node:
        return other if isinstance(other, Node) else Node(self.tape, self.tape.constant(float(other)))

    def _do(self, op: Op, *others: Any) -> Node:
        return Node(self.tape, self.tape.write(op, self.line, *(self._as(o).line for o in others)))

    def __add__(self, other: Any) -> Node:
        return NotImplemented if isinstance(other, np.ndarray) else self._do(Op.ADD, other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Node:
        return NotImplemented if isinstance(other, np.ndarray) else self._do(Op.SUB, other)

    def __rsub__(self, other: Any) -> Node:
        return self._as(other)._do(Op.SUB, self)

    def __mul__(self, other: Any) -> Node:
        return NotImplemented if isinstance(other, np.ndarray) else self._do(Op.MUL, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Node:
        return NotImplemented if isinstance(other, np.ndarray) else self._do(Op.DIV, other)

    def __rtruediv__(self, other: Any) -> Node:
        return self._as(other)._do(Op.DIV, self)

    def __neg__(self) -> Node:
        return self._do(Op.NEG)

    def __abs__(self) -> Node:
        return self._do(Op.ABS)

    def __pow__(self, power: Any) -> Node:
        if power == 0.5:
            return self._do(Op.SQRT)
        whole = int(power) if isinstance(power, int | float | np.number) and power == np.floor(power) else 0
        if 1 <= abs(whole) <= 16:  # by products: a logarithm would know no negative base
            found = self
            for _ in range(abs(whole) - 1):
                found = found * self
            return found if whole > 0 else 1.0 / found
        return self._do(Op.LOG)._do(Op.MUL, power)._do(Op.EXP)

    def sqrt(self) -> Node:
        """Square root, as numpy asks it of objects; likewise the next ones."""
        return self._do(Op.SQRT)

    def exp(self) -> Node:  # noqa: D102
        return self._do(Op.EXP)

    def sin(self) -> Node:  # noqa: D102
        return self._do(Op.SIN)

    def cos(self) -> Node:  # noqa: D102
        return self._do(Op.COS)

    def __bool__(self) -> bool:
        constant = self.tape.constants.get(self.line)
        if constant is None:
            raise Untraceable("decides by a value")
        return bool(constant)

    def __float__(self) -> float:
        raise Untraceable("asks for a value as a plain number")

    __index__ = __int__ = __float__


def _binary(op: Op) -> Callable[[Any, Any], Any]:
    def apply(a: Any, b: Any) -> Any:
        return (a if isinstance(a, Node) else b._as(a))._do(op, b) if isinstance(b, Node) else a._do(op, b)

    return apply


def _either(numbers: Callable[..., Any], nodes: Callable[..., Any]) -> Callable[..., Any]:
    """`nodes` where one of the arguments is a Node, else `numbers`: arrays may hold both."""

    def apply(*given: Any) -> Any:
        return nodes(*given) if any(isinstance(g, Node) for g in given) else numbers(*given)

    return apply


_less, _at_most = _binary(Op.LESS), _binary(Op.LESS_EQUAL)
_TABLE: dict[Any, Callable[..., Any]] = {
    np.add: lambda a, b: a + b,
    np.subtract: lambda a, b: a - b,
    np.multiply: lambda a, b: a * b,
    np.divide: lambda a, b: a / b,
    np.negative: lambda a: -a,
    np.positive: lambda a: a,
    np.power: lambda a, b: a**b,
    np.square: lambda a: a * a,
    np.sqrt: _either(math.sqrt, lambda a: a.sqrt()),
    np.exp: _either(math.exp, lambda a: a.exp()),
    np.log: _either(math.log, lambda a: a._do(Op.LOG)),
    np.sin: _either(math.sin, lambda a: a.sin()),
    np.cos: _either(math.cos, lambda a: a.cos()),
    np.floor: _either(math.floor, lambda a: a._do(Op.FLOOR)),
    np.ceil: _either(math.ceil, lambda a: -(-a)._do(Op.FLOOR)),
    np.arccos: _either(math.acos, lambda a: _binary(Op.ATAN2)((1.0 - a * a) ** 0.5, a)),
    np.absolute: abs,
    np.sign: _either(np.sign, lambda a: a._do(Op.SIGN)),
    np.arctan2: _either(math.atan2, _binary(Op.ATAN2)),
    np.hypot: _either(math.hypot, lambda a, b: (a * a + b * b) ** 0.5),
    np.maximum: _either(max, _binary(Op.MAX)),
    np.minimum: _either(min, _binary(Op.MIN)),
    np.less: _either(lambda a, b: a < b, _less),
    np.less_equal: _either(lambda a, b: a <= b, _at_most),
    np.greater: _either(lambda a, b: a > b, lambda a, b: _less(b, a)),
    np.greater_equal: _either(lambda a, b: a >= b, lambda a, b: _at_most(b, a)),
    np.equal: _either(lambda a, b: a == b, lambda a, b: _at_most(a, b) * _at_most(b, a)),
    np.logical_or: _either(lambda a, b: a or b, _binary(Op.MAX)),
    np.bitwise_or: _either(lambda a, b: a or b, _binary(Op.MAX)),
    np.logical_and: lambda a, b: a * b,
    np.bitwise_and: lambda a, b: a * b,
    np.logical_not: lambda a: 1.0 - a,
    np.invert: lambda a: 1.0 - a,
}


class Traced(np.ndarray[Any, Any]):
    """An array of nodes; numbers may stand among them."""

    @classmethod
    def of(cls, values: Any) -> Traced:
        """These values as an array that records its operations."""
        return np.asarray(values, dtype=object).view(cls)

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **kwargs: Any) -> Any:
        if ufunc not in _TABLE and ufunc is not np.matmul:
            raise Untraceable(f"uses numpy.{ufunc.__name__}")
        plain = [np.asarray(i, dtype=object) for i in inputs]
        if method == "__call__" and ufunc is not np.matmul:
            found = np.frompyfunc(_TABLE[ufunc], len(plain), 1)(*plain)
        else:
            found = getattr(ufunc, method)(*plain, **kwargs)
        if out is not None:
            out[0][...] = found
            return out[0]
        return Traced.of(found) if isinstance(found, np.ndarray) else found

    def __array_function__(self, func: Any, types: Any, args: Any, kwargs: Any) -> Any:
        if func in _FUNCTIONS:
            return _FUNCTIONS[func](*args, **kwargs)
        found = super().__array_function__(func, types, args, kwargs)
        return Traced.of(found) if isinstance(found, np.ndarray) and found.dtype == object else found

    def __setitem__(self, key: Any, value: Any) -> None:
        if isinstance(key, Traced):
            value = _where(key, value, self)
            key = ...
        super().__setitem__(key, value)


def _where(condition: Any, yes: Any, no: Any) -> Traced:
    def choice(which: Any, a: Any, b: Any) -> Any:
        if isinstance(which, Node):
            return which._do(Op.SELECT, a, b)
        return a if which else b

    return Traced.of(np.frompyfunc(choice, 3, 1)(*(np.asarray(x, dtype=object) for x in (condition, yes, no))))


_FUNCTIONS: dict[Any, Callable[..., Any]] = {
    np.where: _where,
    np.clip: lambda values, low, high, **_: np.minimum(np.maximum(Traced.of(values), low), high),
    np.linalg.norm: lambda v, axis=None, keepdims=False: np.sqrt(np.sum(v * v, axis=axis, keepdims=keepdims)),
    np.einsum: lambda form, *given: Traced.of(np.einsum(form, *(np.asarray(one, dtype=object) for one in given))),
    np.zeros_like: lambda like, shape=None, **_: Traced.of(np.zeros(np.shape(like) if shape is None else shape)),
    np.ones_like: lambda like, **_: Traced.of(np.ones(np.shape(like))),
    np.empty: lambda shape, *_, **__: Traced.of(np.zeros(shape)),
    np.zeros: lambda shape, *_, **__: Traced.of(np.zeros(shape)),
    np.empty_like: lambda like, shape=None, **_: Traced.of(np.zeros(np.shape(like) if shape is None else shape)),
}
"""Functions of numpy that would branch on a value, or return an array of numbers."""


# -- effects --

CATALOGUE = "wrenchgap.plant.effects."
"""Package of the effects whose `apply` depends on nothing but its arguments."""


def traced_model(model: WrenchModel) -> WrenchModel:
    """The model with traced effects.

    Raises Untraceable for effects of a user's own, which may depend on more than their arguments.
    """
    for item in model.effects:
        if not type(item.effect).__module__.startswith(CATALOGUE):
            raise Untraceable(f"effect {item.name} is not of the catalogue")
    return WrenchModel(model.vehicle, tuple(traced_effect(item) for item in model.effects))


def traced_effect(item: ModelEffect) -> ModelEffect:
    """The effect with `Traced` results; its name is in the section of the tape and in errors."""
    effect = item.effect

    def apply(_: Any, *arguments: Any) -> Any:
        tape = _tape_of(arguments)
        section = None if tape is None else tape.section
        if tape is not None:
            tape.section = item.name
        try:
            return _traced(effect.apply(*arguments))
        except Untraceable as error:
            raise Untraceable(f"effect {item.name} {error}") from None
        except (TypeError, AttributeError, ValueError) as error:
            words = " ".join(str(error).split())
            raise Untraceable(f"effect {item.name} is not plain arithmetic: {words}") from None
        finally:
            if tape is not None:
                tape.section = section or ""

    kind: Any = type(f"Traced{type(effect).__name__}", (type(effect),), {"apply": apply})
    traced: AnyEffect = object.__new__(kind)
    traced.__dict__.update(getattr(effect, "__dict__", {}))
    return ModelEffect(traced, item.theta)


def _tape_of(arguments: Sequence[Any]) -> Tape | None:
    """The tape of the first node among arguments of an effect."""
    for one in arguments:
        for array in vars(one).values() if hasattr(one, "__dataclass_fields__") else (one,):
            if isinstance(array, np.ndarray) and array.dtype == object:
                for node in array.flat:
                    if isinstance(node, Node):
                        return node.tape
    return None


def _traced(result: Any) -> Any:
    """Arrays of nodes among the results of an effect as `Traced`."""
    if isinstance(result, np.ndarray) and result.dtype == object:
        return Traced.of(result)
    if isinstance(result, tuple):
        return tuple(_traced(part) for part in result)
    if isinstance(result, dict):
        return {key: _traced(part) for key, part in result.items()}
    return result


def memory_arrays(memory: Any) -> Iterator[Any]:
    """The arrays in the memory of effects, in a fixed order."""
    if isinstance(memory, dict):
        for key in sorted(memory):
            yield from memory_arrays(memory[key])
    elif isinstance(memory, tuple):
        for part in memory:
            yield from memory_arrays(part)
    elif memory is not None:
        yield np.asarray(memory)


def memory_of_arrays(memory: Any, make: Callable[[Any], Any]) -> Any:
    """The same structure with other arrays, called for in the order of `memory_arrays`."""
    if isinstance(memory, dict):
        built = {key: memory_of_arrays(memory[key], make) for key in sorted(memory)}
        return {key: built[key] for key in memory}
    if isinstance(memory, tuple):
        return tuple(memory_of_arrays(part, make) for part in memory)
    return None if memory is None else make(memory)
