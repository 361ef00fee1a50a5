"""A model in the terms of another program: parameters with their intervals, and what those terms cannot say."""

from typing import Any

from wrenchgap.plant.targets.written import Written
from wrenchgap.replay.present.numbers import number
from wrenchgap.replay.present.tables import Line, Part, note_lines, table

CHECK = "check every value before it flies: hover low and short with it first"


def parts(made: Written) -> list[Part]:
    """How much is in it, the parameters, what is not in it."""
    if not made.parameters:
        return [Line(f"{made.vehicle} for {made.target}"), *note_lines(made.lost, "not in it")]
    known = [row.before is not None for row in made.parameters]
    rows = [
        (row.name, number(row.value), number(row.std, 2), number(was), ", ".join(row.effects))
        for row in made.parameters
        for was in (row.nominal if row.before is None else row.before,)
    ]
    heads = ("parameter", "value", "+-", "was" if all(known) else "was, or nominal", "from")
    words = f"{made.vehicle} for {made.target}: {len(rows)} parameters were identified; {CHECK}"
    return [Line(words), table("", heads, rows, texts=(-1,)), *note_lines(made.lost, "not in it")]


def to_json(made: Written) -> dict[str, Any]:
    """See docs/json.md."""
    return {
        "vehicle": made.vehicle,
        "target": made.target,
        "parameters": frame(made),
        "not_in_it": list(made.lost),
        "text": made.text,
    }


def frame(made: Written) -> list[dict[str, Any]]:
    """One row for each parameter of an autopilot."""
    return [{**vars(row), "effects": list(row.effects)} for row in made.parameters]
