"""Writes what pages say of the catalogue: docs/effects/README.md, the number of effects, the checks on the bench."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from pathlib import Path

from wrenchgap.learn.posterior.bench_tests import NO_CHECK, TRIALS
from wrenchgap.plant.effects import catalogue, families, find

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "effects"

HEAD = """\
# Effects

Written by `make docs` from the catalogue in `plant/effects`; do not edit. The five places at which an effect may act
are explained in [the design](../design.md#five-places). [How to write one](your-own.md).

| effect | acts on | what shows it |
|---|---|---|
"""


FAMILIES = """
## Families

Some effects come in several [forms](../design.md#families): one name, of which a search takes one form at most.

| family | forms |
|---|---|
"""


def missing_pages(folder: Path = FOLDER) -> list[str]:
    """Effects of the catalogue that no page describes."""
    return [name for name in catalogue() if not (folder / f"{name}.md").exists()]


def index() -> str:
    """The index as Markdown, one row for each effect."""
    rows = []
    for name, effect in catalogue().items():
        shown = effect.excited_by.replace("|", r"\|")
        rows.append(f"| [{name}]({name}.md) | {effect.place} | {shown} |\n")
    forms = [
        f"| {family} | {'; '.join(f'[{n}]({n}.md): {find(n).form}' for n in names)} |\n".replace("|v|", r"\|v\|")
        for family, names in families().items()
    ]
    return HEAD + "".join(rows) + FAMILIES + "".join(forms)


CHECKS = "docs/settle.md"


def checks() -> str:
    """The text of the page of bench checks, with its table as `TRIALS` and `NO_CHECK` are."""
    rows = ["| check | minutes | measured | resolves | shown | unclear |", "|---|---|---|---|---|---|"]
    for t in TRIALS:
        shows, unclear = _linked(t.shows), _linked(t.unclear) or "-"
        rows.append(f"| {t.name} | {t.minutes} | {t.measures} | {t.resolves} | {shows} | {unclear} |")
    rows += ["", "No check shows these:", "", *(f"- {_linked([name])}: {why}." for name, why in NO_CHECK.items())]
    before, _, rest = (ROOT / CHECKS).read_text(encoding="utf-8").partition("<!-- checks -->")
    return "\n".join([f"{before}<!-- checks -->", *rows, f"<!-- /checks -->{rest.partition('<!-- /checks -->')[2]}"])


def _linked(names: Iterable[str]) -> str:
    return ", ".join(f"[{name}](effects/{name}.md)" for name in names)


COUNTED = ("README.md", "docs/index.md")
"""Pages that say how many effects there are."""


def counted(page: str) -> str:
    """The text of a page, with the number of effects as it is."""
    return re.sub(r"\[\d+ effects\]", f"[{len(catalogue())} effects]", (ROOT / page).read_text(encoding="utf-8"))


def main() -> int:
    """Writes index, numbers and checks; fails, with their names, if effects have no page."""
    (FOLDER / "README.md").write_text(index(), encoding="utf-8")
    (ROOT / CHECKS).write_text(checks(), encoding="utf-8")
    for page in COUNTED:
        (ROOT / page).write_text(counted(page), encoding="utf-8")
    missing = missing_pages()
    if missing:
        print(f"docs/effects: no page for {', '.join(missing)}", file=sys.stderr)
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
