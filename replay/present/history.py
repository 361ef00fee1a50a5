"""The history of a model file, as tables and in plain types."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from wrenchgap.flight.flight import AXES
from wrenchgap.plant.history import Changes, Value, Version, changes
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import changed_since
from wrenchgap.replay.present.addition import effects_json, trial_json
from wrenchgap.replay.present.numbers import AXIS_HEADS, entries, label, number
from wrenchgap.replay.present.tables import Line, Part, Table, note_lines, reductions, table

BEFORE_AND_AFTER = ("before=before.value", "before_std=before.std", "after=after.value", "after_std=after.std")
_Row = tuple[str, Value, float | None, float | None, float | None, float | None]


def parts(model: Model) -> list[Part]:
    """Versions, parameters that moved, notes."""
    if not model.history:
        none = Line(f"{model.name}: no history; wrenchgap add and wrenchgap remove write one")
        return [none, *note_lines(notes(model))]
    moved = table_of_changes(model)
    return [table_of_versions(model), *([moved] if moved.row_count else []), *note_lines(notes(model))]


def steps(model: Model) -> Iterator[tuple[Version, Changes]]:
    """Each version with what it changed, oldest first."""
    before: Version | None = None
    for version in model.history:
        yield version, changes(before, version)
        before = version


def table_of_versions(model: Model) -> Table:
    """One row for each version: what changed, from which flights, and the change of the error by axis."""
    rows = []
    for version, changed in steps(model):
        falls = reductions(version.trial.rms_reduction) if version.trial is not None else ["-"] * 6
        flights = ", ".join(Path(file).stem for file, _ in version.flights) or "-"
        rows.append((version.number, version.date[:10] or "-", words(version, changed), flights, *falls))
    heads, caption = ("", "date", "what changed", "from", *AXIS_HEADS), "F, M: change of rms on held-out time"
    return table(f"{model.name}: versions", heads, rows, left=4, caption=caption)


def words(version: Version, changed: Changes) -> str:
    """`+ com_offset, - mass, ~ servo_lag`: added, removed, with other values."""
    parts = [f"+ {e.effect}" for e in changed.added] + [f"- {e.effect}" for e in changed.removed]
    parts += [f"~ {name}" for name in dict.fromkeys(c.effect for c in changed.moved)]
    if version.parent == "":
        return f"{version.command}: {', '.join(version.names) or 'no effects'}"
    if version.date:
        return ", ".join(parts) or "no effect"
    return f"{version.command}: {', '.join(parts) or 'the vehicle'}"


def table_of_changes(model: Model) -> Table:
    """Parameters by version: value before and after, with standard deviations."""
    cells = []
    for version, changed in steps(model):
        rows: list[_Row] = [(e.effect, v, None, v.value, v.std, None) for e in changed.added for v in e.values]
        rows += [(e.effect, v, v.value, None, None, None) for e in changed.removed for v in e.values]
        rows += [(c.effect, c.after, c.before.value, c.after.value, c.after.std, c.sigmas) for c in changed.moved]
        for effect, v, before, after, std, sigmas in rows:
            numbers = (number(before, 4), number(after, 4), number(std, 2))
            shift = "-" if sigmas is None else f"{sigmas:+.1f}"
            cells.append((version.number, effect, label(v.name, model.vehicle), *numbers, v.unit, shift))
    heads = ("", "effect", "parameter", "before", "after", "+-", "unit", "sigmas")
    return table("parameters", heads, cells, left=3, texts=(6,))


def notes(model: Model) -> list[str]:
    """What a user should know about the file."""
    found = list(model.notes)
    if changed_since(model):
        last = model.history[-1].number
        found.append(f"{model.name} was changed by hand after version {last}; the next version will say so.")
    return found


def to_json(model: Model) -> dict[str, Any]:
    """The body of the `history` schema."""
    return {
        "model": model.name,
        "axes": list(AXES),
        "changed_by_hand_since": changed_since(model),
        "versions": [_version(version, changed) for version, changed in steps(model)],
        "notes": notes(model),
    }


def _version(version: Version, changed: Changes) -> dict[str, Any]:
    return {
        **entries(version, "version=number", "command", "file", "content_sha256=content"),
        "date": version.date or None,
        "wrenchgap": version.tool or None,
        "parent_sha256": version.parent or None,
        "flights": [{"file": file, "sha256": sha} for file, sha in version.flights],
        "held_out": trial_json(version.trial),
        "added": [e.effect for e in changed.added],
        "removed": [e.effect for e in changed.removed],
        "changed": [
            entries(c, "effect", "parameter=after.name", *BEFORE_AND_AFTER, "unit=after.unit") for c in changed.moved
        ],
        "effects": effects_json(version.effects),
    }
