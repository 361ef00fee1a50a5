"""How modules come in: without the collector's attention, and, for one more release, as functions."""

from __future__ import annotations

import gc
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any


def callable_as(package: str, function: str) -> None:
    """Let `wrenchgap.learn` and `wrenchgap.replay` be called as a public function: until 0.2, with a warning."""

    class CallablePackage(ModuleType):
        def __call__(self, *arguments: Any, **options: Any) -> Any:
            said = f"{package} is a package; call wrenchgap.{function}, which wrenchgap 0.2 knows alone"
            warnings.warn(said, DeprecationWarning, stacklevel=2)
            return getattr(sys.modules["wrenchgap"], function)(*arguments, **options)

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
