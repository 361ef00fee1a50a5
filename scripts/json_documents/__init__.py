"""What each command writes with `--json FILE`, as types, and the JSON schemas that are made of them.

docs/json.md says what the keys mean. The tests validate every JSON that a command writes.
"""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter

from scripts.json_documents import comparison, compensation, explanation, flights, models, summaries
from wrenchgap.replay.present.documents import VERSIONS
from wrenchgap.replay.present.documents import schema as name_of

MODULES = (comparison, compensation, explanation, flights, models, summaries)


def schema(command: str, *, strict: bool = False) -> dict[str, Any]:
    """JSON schema (draft 2020-12) of a command's document; a strict one forbids keys that it does not list."""
    title = command.title().replace("-", "")
    (kind,) = (getattr(module, title) for module in MODULES if hasattr(module, title))
    found = TypeAdapter(kind).json_schema()
    found["properties"]["schema"]["const"] = name_of(command)
    if strict:
        for part in (found, *found.get("$defs", {}).values()):
            if "properties" in part:
                part["additionalProperties"] = False
    dialect = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": name_of(command)}
    return dialect | found


def schemas() -> dict[str, dict[str, Any]]:
    """The schema of every command's document, by the command."""
    return {command: schema(command) for command in VERSIONS}
