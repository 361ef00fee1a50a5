"""Rows of an experiment as lines of JSON, kept as they come, so that an interrupted run counts and goes on later."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from time import monotonic
from typing import Any

from wrenchgap.flight.atomic import atomic

RESULTS = Path(__file__).parent / "results"
DIGITS = 5


def kept(path: Path) -> dict[str, dict[str, Any]]:
    """Rows by their key; a last line that was cut off is left out."""
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        found[row["key"]] = row
    return found


def keep_on(path: Path, keys: Iterable[str], make: Callable[[str], dict[str, Any]], minutes: float) -> None:
    """Make the rows that are not there yet, in order, until the time is over; every row is written at once."""
    path.parent.mkdir(parents=True, exist_ok=True)
    done, end = kept(path), monotonic() + 60.0 * minutes
    for key in keys:
        if key in done:
            continue
        if monotonic() > end:
            return
        row = {"key": key, **rounded(make(key))}
        with path.open("a", encoding="utf-8") as out:
            out.write(json.dumps(row) + "\n")
            out.flush()
            os.fsync(out.fileno())
        print(row, flush=True)


def complete(
    path: Path, lacking: Callable[[dict[str, Any]], bool], make: Callable[[dict[str, Any]], dict[str, Any]]
) -> None:
    """Add to the kept rows that lack something what `make` makes of them; the file is written after each."""
    rows = kept(path)
    for key, row in rows.items():
        if lacking(row):
            rows[key] = row | rounded(make(row))
            print(rows[key], flush=True)
            with atomic(path) as written:
                written.write_text("".join(json.dumps(one) + "\n" for one in rows.values()), encoding="utf-8")


def rounded(value: Any) -> Any:
    """Floats with `DIGITS` significant digits, in plain types."""
    if isinstance(value, dict):
        return {k: rounded(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(v) for v in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
