"""The tables of docs/paper.md, renewed from the results: what stands between `<!-- name -->` and `<!-- /name -->`."""

from __future__ import annotations

from pathlib import Path

from benchmarks import pages
from benchmarks.paper.running import EXPERIMENTS, PAGE, Output, experiment


def renew(page: Path, out: Output) -> None:
    """Write the page with the tables of every experiment that has results."""
    page.write_text(renewed(page.read_text(encoding="utf-8"), out), encoding="utf-8")


def renewed(text: str, out: Output) -> str:
    """The text with the tables of every experiment that has results."""
    bodies = {name: out.read(name) for name in EXPERIMENTS}
    return pages.renewed(text, {n: experiment(n).tables(body) for n, body in bodies.items() if body is not None})


if __name__ == "__main__":
    renew(PAGE, Output())
