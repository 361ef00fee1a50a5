"""The tables of docs/paper.md, renewed from the results: what stands between `<!-- name -->` and `<!-- /name -->`."""

from __future__ import annotations

import re
from pathlib import Path

from benchmarks.paper.running import EXPERIMENTS, PAGE, Output, experiment


def renew(page: Path, out: Output) -> None:
    """Write the page with the tables of every experiment that has results."""
    page.write_text(renewed(page.read_text(encoding="utf-8"), out), encoding="utf-8")


def renewed(text: str, out: Output) -> str:
    """The text with the tables of every experiment that has results."""
    for name in EXPERIMENTS:
        body = out.read(name)
        if body is None:
            continue
        pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
        tables = experiment(name).tables(body)
        text = pattern.sub(lambda m, tables=tables: f"{m.group(1)}{tables}\n{m.group(2)}", text)  # type: ignore[misc]
    return text


if __name__ == "__main__":
    renew(PAGE, Output())
