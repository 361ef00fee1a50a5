"""The tables of docs/paper.md and benchmarks/notes/paper.md, renewed from the results.

What stands between `<!-- name -->` and `<!-- /name -->` is the table of that experiment, on one of the two pages.
"""

from __future__ import annotations

from benchmarks import pages
from benchmarks.paper.running import EXPERIMENTS, PAGES, Output, experiment


def renew(out: Output) -> None:
    """Write the pages with the tables of every experiment that has results."""
    for page in PAGES:
        page.write_text(renewed(page.read_text(encoding="utf-8"), out), encoding="utf-8")


def renewed(text: str, out: Output) -> str:
    """The text with the tables of the experiments that it shows, as far as they have results."""
    bodies = {name: out.read(name) for name in EXPERIMENTS if f"<!-- /{name} -->" in text}
    return pages.renewed(text, {n: experiment(n).tables(body) for n, body in bodies.items() if body is not None})


if __name__ == "__main__":
    renew(Output())
