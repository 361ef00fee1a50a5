"""A model file's history: every version that a command writes is added to it, and so is a change by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from wrenchgap.plant.history import BY_HAND, GIVEN, Trial, Version
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file.writing import content_hash


def next_version(
    parent: Model,
    model: Model,
    *,
    command: str,
    path: Path,
    flights: Sequence[tuple[str, str]] = (),
    trial: Trial | None = None,
) -> Model:
    """`model` with `parent`'s history and one version more: itself, as made by `command` and written to `path`.

    A parent without history becomes the first version; one that was changed since its last version gets a version
    for that.
    """
    versions = list(parent.history)
    content = content_hash(parent)
    if not versions or versions[-1].content != content:
        reason, before = (BY_HAND, versions[-1].content) if versions else (GIVEN, "")
        number, file = versions[-1].number + 1 if versions else 1, "" if parent.path is None else str(parent.path)
        versions.append(Version(number, reason, content, file, before, effects=parent.snapshot))
    last = versions[-1]
    made = Version(
        last.number + 1,
        command,
        content_hash(model),
        str(path),
        last.content,
        datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        tool_version(),
        tuple(flights),
        trial,
        model.snapshot,
    )
    return replace(model, history=(*versions, made))


def changed_since(model: Model) -> bool:
    """Whether the file was changed by hand after its last version was written."""
    return bool(model.history) and model.history[-1].content != content_hash(model)


def tool_version() -> str:
    """Version of wrenchgap, for provenance."""
    try:
        return version("wrenchgap")
    except PackageNotFoundError:
        return "unknown"
