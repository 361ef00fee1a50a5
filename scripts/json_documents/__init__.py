"""What each command writes with `--json FILE`, as types, and the JSON schemas that are made of them.

The string below a key says what the key means where its name does not; it becomes the key's description. The tests
validate every JSON that a command writes.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import Any, get_args

from pydantic import TypeAdapter
from typing_extensions import get_original_bases, get_type_hints, is_typeddict

from scripts.json_documents import (
    changes,
    comparison,
    compensation,
    explanation,
    flights,
    health,
    laws,
    models,
    summaries,
    written,
)
from wrenchgap.replay.present.documents import VERSIONS
from wrenchgap.replay.present.documents import schema as name_of

MODULES = (changes, comparison, compensation, explanation, flights, health, laws, models, summaries, written)


def schema(command: str, *, strict: bool = False) -> dict[str, Any]:
    """JSON schema (draft 2020-12) of a command's document; a strict one forbids keys that it does not list."""
    title = command.title().replace("-", "")
    (kind,) = (getattr(module, title) for module in MODULES if hasattr(module, title))
    found = TypeAdapter(kind).json_schema()
    defined = found.get("$defs", {})
    for part in (kind, *dict.fromkeys(parts(kind))):
        properties = (found if part is kind else defined[part.__name__])["properties"]
        for key, words in meanings(part).items():
            properties[key]["description"] = words
    found["properties"]["schema"]["const"] = name_of(command)
    if strict:
        for part in (found, *defined.values()):
            if "properties" in part:
                part["additionalProperties"] = False
    dialect = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": name_of(command)}
    return dialect | found


@cache
def schemas() -> dict[str, dict[str, Any]]:
    """The schema of every command's document, by the command."""
    return {command: schema(command) for command in VERSIONS}


def parts(kind: Any) -> Iterator[type]:
    """Every typed dict that a typed dict holds, however deep."""
    for inner in get_type_hints(kind).values() if is_typeddict(kind) else get_args(kind):
        if is_typeddict(inner):
            yield inner
        yield from parts(inner)


def meanings(kind: type) -> dict[str, str]:
    """The strings below the keys of a typed dict and of those that it extends, by key."""
    found: dict[str, str] = {}
    for base in get_original_bases(kind):
        if is_typeddict(base):
            found |= meanings(base)
    try:
        (made,) = ast.parse(inspect.getsource(kind)).body
    except OSError:  # made by a call, because a key is a keyword
        return found
    for key, below in pairwise(made.body if isinstance(made, ast.ClassDef) else ()):
        if isinstance(key, ast.AnnAssign) and isinstance(key.target, ast.Name) and isinstance(below, ast.Expr):
            found[key.target.id] = inspect.cleandoc(ast.literal_eval(below.value))
    return found
