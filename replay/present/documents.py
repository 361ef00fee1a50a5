"""Results on disk: JSON with a schema and the inputs' hashes; every file appears whole or not at all.

The schemas are documented in docs/json.md and are part of the interface.
"""

from __future__ import annotations

import hashlib
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wrenchgap._escaping import csv_cell, json_text
from wrenchgap.flight import Flight, UsageError
from wrenchgap.flight.atomic import atomic, check_writable, resolved, write_text
from wrenchgap.flight.extras import needed_for
from wrenchgap.plant.model_file import tool_version

if TYPE_CHECKING:
    import pandas as pd

FIRST_VERSION = (
    *("check", "simulate", "compare", "changed", "where", "add", "remove", "history", "report", "learn", "replay"),
    *("counterfactual", "design", "convert", "model", "calibrate", "export", "batch", "predict", "ready", "discover"),
    *("write", "effectiveness"),
)
VERSIONS = dict.fromkeys(FIRST_VERSION, 1) | {"inspect": 2, "explain": 2, "replay-export": 2, "trend": 2}
"""Version of each command's JSON: a number that grows when a key changes its meaning or goes away."""


def schema(command: str) -> str:
    """Name and version of a command's JSON, e.g. `wrenchgap.compare/1`."""
    return f"wrenchgap.{command}/{VERSIONS.get(command, 1)}"


def claim(outputs: Mapping[str, Path | None], *, force: bool, inputs: Iterable[Path | str] = ()) -> None:
    """Check, before any work, that these files may be written. `outputs` by the option that names them.

    Raises UsageError for a file that exists (unless `force`), a folder that does not, an output that is a folder, is
    named twice, is one of the inputs or stands in a folder of them, and for a picture that is not called so.
    """
    read = {resolved(Path(p)) for p in inputs}
    folders = {p for p in read if p.is_dir()}
    seen: dict[Path, str] = {}
    for option, path in outputs.items():
        if path is None:
            continue
        if str(path) == "-":
            raise UsageError(f"{option} -: --json alone writes to standard output; expected the name of a file")
        target, exists = resolved(path), path.exists()
        suffix, page = path.suffix.lower(), option == "--page"
        own = read & {target} or (exists and folders & set(target.parents))
        checks = (
            (own, "is one of the inputs; choose another name"),
            (target in seen, f"is already the file of {seen.get(target)}; choose another name"),
            (path.is_dir(), "is a folder; expected the name of a file"),
            (exists and not path.is_file(), "is no ordinary file; expected the name of a file to write"),
            (path.is_symlink() and not exists, "is a link to nothing; choose another name"),
            (exists and not force, "exists already; choose another name or overwrite it with --force"),
            (not path.parent.is_dir(), f"the folder {path.parent} does not exist; create it first"),
            (option == "--figure" and suffix != ".png", "is written as .png and nothing else; name it so"),
            (page and suffix not in (".html", ".htm"), "the page is a web page; expected a name that ends in .html"),
        )
        for wrong, words in checks:
            if wrong:
                raise UsageError(f"{option} {path}: {words}")
        seen[target] = option
        check_writable(path.parent, f"{option} {path}")


def sha256(path: Path) -> str:
    """Hash of a file's content."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def log_input(flight: Flight, role: str = "log") -> dict[str, Any]:
    """A log as an input of a result, with the shifts of its stamps where the user asked for some."""
    shifts = {"shift_s": dict(flight.shifts)} if flight.shifts else {}
    return {"role": role, "file": str(flight.path), "sha256": flight.content_hash, **shifts}


def document(command: str, content: Mapping[str, Any], inputs: Sequence[Mapping[str, Any]] = ()) -> dict[str, Any]:
    """A result with its schema, the version of wrenchgap and its inputs; plain types only."""
    head = {"schema": schema(command), "version": tool_version(), "inputs": [dict(i) for i in inputs]}
    return plain({**head, **content})  # type: ignore[no-any-return]


def write_json(path: Path | None, result: Mapping[str, Any], *, force: bool) -> None:
    """Write a `document`, all of it or nothing; to standard output where there is no path."""
    text = json_text(result, indent=1) + "\n"
    if path is None:
        sys.stdout.buffer.write(text.encode())
        return
    claim({"--json": path}, force=force)
    write_text(path, text)


def plain(value: Any) -> Any:
    """The same value in types that JSON knows; what is not a finite number becomes null."""
    if is_dataclass(value):
        value = vars(value)
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set):
        return [plain(v) for v in value]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def check_tables(*tables: Path | None) -> None:
    """Raise UsageError, before any work, where a table is to be written and what writes it is not installed."""
    if any(tables):
        with needed_for("tables"):
            import pandas as pd  # noqa: F401
            import pyarrow  # noqa: F401


def write_parquet(frame: pd.DataFrame, path: Path) -> None:
    """A table as Parquet, all of it or nothing."""
    with atomic(path) as partial:
        frame.to_parquet(partial, index=False)


def write_csv(frame: pd.DataFrame, path: Path, digits: str | None = "%.9g") -> None:
    """A table as CSV, all of it or nothing."""
    texts = frame.select_dtypes(exclude="number").columns
    frame = frame.assign(**{name: frame[name].map(csv_cell) for name in texts}).rename(columns=csv_cell)
    with atomic(path) as partial:
        frame.to_csv(partial, index=False, float_format=digits)
