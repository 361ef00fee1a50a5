"""Attacks on whoever runs wrenchgap, and on the vehicle: what happens, and the bound that is stated.

One file an area, each with `AREA` (a heading) and `ATTACKS`. An attack does what an attacker or an unlucky operator
would do, in a folder of its own, and says what happened. `python -m benchmarks.attacks` makes them all and writes the
table of benchmarks/notes/attacks.md; tests/independent/test_attacks.py makes each of them and fails where the bound is
broken.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Outcome:
    """What came of an attack."""

    held: bool
    """Whether the stated bound held."""
    happened: str
    """What happened, in a few words, with the figures that were measured."""


@dataclass(frozen=True)
class Attack:
    """One attack, and what is promised about it."""

    what: str
    """What is done, for a reader of the table: "a data folder with a joblib.py in it, `explain`"."""
    bound: str
    """What is promised, with its figure: "never imported", "10 s and 500 MB"."""
    run: Callable[[Path], Outcome]
    """Makes it in an empty folder."""
    slow: bool = False
    """More than some 5 s: `make slow` makes it, and the everyday suite does not."""
    browser: bool = False
    """Needs Chromium."""


def areas() -> dict[str, tuple[Attack, ...]]:
    """Attacks by heading, from the files of this folder in the order of their names."""
    names = sorted(module.name for module in pkgutil.iter_modules(__path__) if not module.name.startswith("_"))
    modules = [importlib.import_module(f"{__name__}.{name}") for name in names]
    return {module.AREA: tuple(module.ATTACKS) for module in modules}
