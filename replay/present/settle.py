"""What is open, and what would settle it: classes of sets in words; checks as lines of text and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from wrenchgap.learn.posterior.classes import Class
from wrenchgap.learn.posterior.settle import Check
from wrenchgap.replay.present.numbers import share
from wrenchgap.replay.present.tables import Line

MOST_SETS, LIGHT = 5, 0.02
"""Sets of a class that are put in words; those of less weight than that are not."""
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


def in_words(one: Class) -> str:
    """The sets of a class with their weights, and on what all of them agree."""
    shown = [s for s in one.sets[:MOST_SETS] if s.weight >= LIGHT or s is one.sets[0]]
    listed = [f"{' + '.join(s.names) or 'nothing'} ({share(s.weight)})" for s in shown]
    if len(listed) == 1:
        return f"{share(one.weight)} of the weight: {listed[0]}"
    common = f"; in all of them: {', '.join(one.established)}" if one.established else ""
    return f"{share(one.weight)} of the weight, indistinguishable here: {' or '.join(listed)}{common}"
