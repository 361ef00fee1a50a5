"""Traced effects: their own `apply`, called on arrays that record every operation (`plant.trace.arrays`)."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from wrenchgap.plant.effects.effect import AnyEffect
from wrenchgap.plant.trace.arrays import Node, Traced, Untraceable
from wrenchgap.plant.trace.tape import Tape
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel

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
