"""The catalogue: every effect in this folder, and those that other packages offer.

An effect is one file here with one subclass of `Effect`; it is found by being here. Another package offers effects
through the entry point group `wrenchgap.effects`. A user's own file is checked by `plant.own_effects` and registered
here for the running process.
"""

import importlib
import inspect
import pkgutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.metadata import entry_points

from wrenchgap.flight.errors import ModelError, meant
from wrenchgap.plant.effects.effect import AirEffect as AirEffect
from wrenchgap.plant.effects.effect import AnyEffect as AnyEffect
from wrenchgap.plant.effects.effect import BodyEffect as BodyEffect
from wrenchgap.plant.effects.effect import CommandEffect as CommandEffect
from wrenchgap.plant.effects.effect import Context as Context
from wrenchgap.plant.effects.effect import Effect as Effect
from wrenchgap.plant.effects.effect import Parameter as Parameter
from wrenchgap.plant.effects.effect import SensorEffect as SensorEffect
from wrenchgap.plant.effects.effect import Source as Source
from wrenchgap.plant.effects.effect import ThrustEffect as ThrustEffect
from wrenchgap.plant.effects.effect import WrenchEffect as WrenchEffect

_PLACES = (CommandEffect, ThrustEffect, WrenchEffect, BodyEffect, SensorEffect, AirEffect)
_own: dict[str, tuple[AnyEffect, Source]] = {}


def register(effect: AnyEffect, source: Source) -> None:
    """Put a user's own effect into the catalogue; raises ModelError where its name is taken."""
    if effect.name in catalogue():
        raise ModelError(f"{source.file}: effect {effect.name!r} exists already; rename yours")
    _own[effect.name] = (effect, source)
    _renew()


def forget() -> None:
    """Remove all user effects from the catalogue."""
    _own.clear()
    _renew()


def _renew() -> None:
    for made in (catalogue, part_effects, _known):
        made.cache_clear()


@contextmanager
def registered(found: Iterable[tuple[AnyEffect, Source]]) -> Iterator[None]:
    """These effects are in the catalogue meanwhile; raises ModelError where a name is taken."""
    before = dict(_own)
    try:
        for effect, source in found:
            register(effect, source)
        yield
    finally:
        _own.clear()
        _own.update(before)
        _renew()


def sources() -> dict[str, Source]:
    """Files of the user effects, by name of the effect."""
    return {name: source for name, (_, source) in _own.items()}


@cache
def catalogue() -> dict[str, AnyEffect]:
    """Every known effect by name, sorted, without those of single parts (`by_part`)."""
    return {name: effect for name, effect in _known().items() if not effect.of_parts}


@cache
def part_effects() -> dict[str, AnyEffect]:
    """Effects with a number for each rotor or arm, by name: `trend` fits them, no search tries them."""
    return {name: effect for name, effect in _known().items() if effect.of_parts}


@cache
def _known() -> dict[str, AnyEffect]:
    classes: list[type[Effect]] = []
    for module in pkgutil.iter_modules(__path__):
        members = inspect.getmembers(importlib.import_module(f"{__name__}.{module.name}"), inspect.isclass)
        classes += [c for _, c in members if c.__module__ == f"{__name__}.{module.name}" and issubclass(c, _PLACES)]
    classes += [point.load() for point in entry_points(group="wrenchgap.effects")]
    found: dict[str, AnyEffect] = {}
    for cls in classes:
        if inspect.isabstract(cls):
            continue
        if not issubclass(cls, _PLACES):
            raise ModelError(f"effect {cls.__name__}: expected a subclass of one of the six kinds of plant.effects")
        if cls.name in found:
            raise ModelError(f"effect {cls.name}: two classes have this name; rename one")
        found[cls.name] = cls()
    found |= {name: effect for name, (effect, _) in _own.items()}
    return dict(sorted(found.items()))


def family(name: str) -> str:
    """The name of the family of an effect; its own name where there is one form."""
    known = catalogue().get(name)
    return name if known is None else known.family or name


def families() -> dict[str, tuple[str, ...]]:
    """Effects of several forms: the names of their forms, by family. A set of effects has one of them at most."""
    forms: dict[str, list[str]] = {}
    for name in catalogue():
        forms.setdefault(family(name), []).append(name)
    return {shared: tuple(names) for shared, names in forms.items() if len(names) > 1}


def find(name: str) -> AnyEffect:
    """The effect of this name; raises ModelError that lists the others."""
    known = catalogue()
    if name in part_effects():
        return part_effects()[name]
    if name not in known:
        raise ModelError(
            f"effect {name!r} is not in the catalogue{meant(name, known)}; known effects: {', '.join(known)}; "
            "a file of your own is passed with --effects FILE.py"
        )
    return known[name]


def is_air(name: str) -> bool:
    """Whether an effect describes the motion of the air."""
    return isinstance(find(name), AirEffect)


def is_drag(name: str) -> bool:
    """Whether moving air exerts a force on a vehicle at rest through this effect."""
    effect = find(name)
    return effect.aerodynamic and effect.place == "wrench"


def acting_effects(names: Iterable[str], among: Iterable[str] = ()) -> list[str]:
    """`names` without effects of the air, unless one of `names` or `among` depends on the air."""
    listed = list(names)
    seen = any(find(n).aerodynamic for n in (*listed, *among))
    return [n for n in listed if seen or not is_air(n)]


def require_force(names: Sequence[str]) -> None:
    """Raise ModelError for a set with moving air in which no effect depends on the air."""
    for name in names:
        if name not in acting_effects(names):
            through = ", ".join(n for n in catalogue() if is_drag(n))
            raise ModelError(
                f"effect {name}: has no force of its own; add it together with an effect through which the air acts: "
                f"{through}"
            )
