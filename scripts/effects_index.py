"""Writes docs/effects/README.md, the index of the effects, and their number elsewhere, from the catalogue itself."""

from __future__ import annotations

import re
import sys
from pathlib import Path

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


COUNTED = ("README.md", "docs/index.md")
"""Pages that say how many effects there are."""


def counted(page: str) -> str:
    """The text of a page, with the number of effects as it is."""
    return re.sub(r"\[\d+ effects\]", f"[{len(catalogue())} effects]", (ROOT / page).read_text(encoding="utf-8"))


def main() -> int:
    """Writes the index and the number of effects; fails, with their names, if effects have no page."""
    (FOLDER / "README.md").write_text(index(), encoding="utf-8")
    for page in COUNTED:
        (ROOT / page).write_text(counted(page), encoding="utf-8")
    missing = missing_pages()
    if missing:
        print(f"docs/effects: no page for {', '.join(missing)}", file=sys.stderr)
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
