"""What benchmarks share: rows that are kept as they come, and tables between `<!-- name -->` and `<!-- /name -->`."""

from __future__ import annotations

import argparse
import json
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from time import process_time
from typing import Any, TypeVar

PERFORMANCE = Path(__file__).parents[1] / "docs" / "performance.md"
NOTES = Path(__file__).parent / "notes"
"""What was tried when, and tables of single runs; what is measured now is in docs."""
Row = dict[str, Any]
T = TypeVar("T")


def renewed(text: str, tables: Mapping[str, str]) -> str:
    """The text of a page with these tables between their marks. Raises ValueError for marks that it does not have."""
    for name, table in tables.items():
        text, count = re.subn(
            rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)",
            lambda m, table=table: f"{m[1]}{table}\n{m[2]}",  # type: ignore[misc]
            text,
            flags=re.DOTALL,
        )
        if count != 1:
            raise ValueError(f"expected <!-- {name} --> and <!-- /{name} --> once, got them {count} times")
    return text


def renew(page: Path, tables: Mapping[str, str]) -> None:
    """Write the page with these tables between their marks."""
    page.write_text(renewed(page.read_text(encoding="utf-8"), tables), encoding="utf-8")


def options(words: str) -> argparse.ArgumentParser:
    """Of a benchmark of docs/performance.md; `words` is its docstring."""
    parser = argparse.ArgumentParser(description=words.splitlines()[0])
    parser.add_argument("--json", type=Path, help="write the rows, as they come")
    parser.add_argument("--page", action="store_true", help="write the tables into docs/performance.md")
    return parser


def timed(act: Callable[[], T]) -> tuple[float, T]:
    """Processor time of an act [s], and what it gave."""
    start = process_time()
    found = act()
    return process_time() - start, found


def markdown(heads: Sequence[str], lines: Iterable[Sequence[str]], load: str, left: int = 1) -> str:
    """A table, its first `left` columns to the left, the others to the right; under it what is said of the load."""
    out = ["| " + " | ".join(heads) + " |", "|" + " --- |" * left + " ---: |" * (len(heads) - left)]
    return "\n".join([*out, *("| " + " | ".join(cells) + " |" for cells in lines), "", load])


def measure(
    asked: argparse.Namespace,
    name: str,
    rows: Iterable[Row],
    table: Callable[[list[Row], str], str],
    earlier: Iterable[Row] = (),
) -> None:
    """Print the rows as they come, then the table; with --json and --page, keep them, behind the `earlier` ones.

    `table(rows, load)` is Markdown, which stands between the marks `name` of the page.
    """
    found: list[Row] = list(earlier)
    before = os.getloadavg()[0]
    for row in rows:
        found.append(row)
        print(json.dumps(row), flush=True)
        if asked.json:
            asked.json.parent.mkdir(parents=True, exist_ok=True)
            asked.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    load = f"Load while measured: {before:.1f} to {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    text = table(found, load)
    print(text)
    if asked.page:
        renew(PERFORMANCE, {name: text})
