"""What would settle which explanation is true: the checks as lines of text and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from wrenchgap.learn.posterior.settle import Check
from wrenchgap.replay.present.tables import Line

KINDS = {"bench": "on the bench", "flight": "in flight"}


def lines(checks: Sequence[Check]) -> list[Line]:
    """One numbered line for each check, the cheapest first; none where nothing is open."""
    if not checks:
        return []
    head = Line("What would settle it, cheapest first:", "bold")
    return [head, *(Line(f"  {k}. {KINDS[check.kind]}: {check.what}") for k, check in enumerate(checks, 1))]


def to_json(checks: Sequence[Check]) -> list[dict[str, Any]]:
    """The `settle` key of a class: groups of sets of effects, every set a list of names."""
    return [
        {"kind": c.kind, "what": c.what, "separates": [[list(names) for names in group] for group in c.separates]}
        for c in checks
    ]
