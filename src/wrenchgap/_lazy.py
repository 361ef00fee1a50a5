"""Packages that offer names of their modules without importing them before they are asked for (PEP 562).

`wrenchgap --help` must answer at once, and whoever reads a log needs no Gaussian process.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any


def names_of(package: str, modules: Mapping[str, tuple[str, ...]]) -> tuple[Callable[[str], Any], list[str]]:
    """`__getattr__` and `__all__` of a package that offers these names of these modules."""
    places = {name: module for module, names in modules.items() for name in names}

    def get(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}; it offers {', '.join(sorted(places))}")
        return getattr(import_module(places[name]), name)

    return get, sorted(places)


def callable_as(package: str, module: str, function: str) -> None:
    """Let a package be called: `wrenchgap.learn(train, model)` is `learn_gp(train, model)` of the public functions.

    Two packages, learn and replay, bear the names of two steps of the loop; so a user may type either.
    """

    class CallablePackage(ModuleType):
        def __call__(self, *arguments: Any, **options: Any) -> Any:
            return getattr(import_module(module), function)(*arguments, **options)

    sys.modules[package].__class__ = CallablePackage


@contextmanager
def uncollected() -> Iterator[None]:
    """For imports: modules are no garbage, so it is not looked for in them meanwhile, nor in any later collection."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
