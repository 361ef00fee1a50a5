"""Damaged files.

python -m benchmarks.faults --json docs/faults.json --page docs/reliability.md     # the published 20,000 files
python -m benchmarks.faults --form ulog --files 500                                # one form, printed
python -m benchmarks.faults --form ulog --case 317 --keep /tmp/here                # one file again, kept
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from pathlib import Path

from benchmarks.faults.cases import Case
from benchmarks.faults.page import summary, with_section
from benchmarks.faults.valid import FORMS
from benchmarks.faults.workers import Row, rows

FILES = 800
"""Of each form, in the published run."""


def run(forms: list[str], files: int, first: int = 0) -> list[Row]:
    """Open `files` of each form; faults are printed as they come."""
    found = []
    for form in forms:
        start, counts = time.monotonic(), Counter[str]()
        for row in rows([Case(form, number) for number in range(first, first + files)]):
            found.append(row)
            counts[row.outcome] += 1
            if row.outcome == "fault":
                print(f"{form} {row.number} ({row.damage}): {row.error}", flush=True)
        print(f"{form}: {dict(counts)} in {time.monotonic() - start:.0f} s", flush=True)
    return found


def again(form: str, number: int, folder: Path) -> None:
    """Make one damaged file again, and open it here."""
    (folder / "valid").mkdir(parents=True)
    (folder / "case").mkdir()
    valid = FORMS[form](folder / "valid")
    path, damage = Case(form, number).make(valid, folder / "case")
    print(f"{path}: {damage}", flush=True)
    from benchmarks.faults.opening import opened

    print(opened(form, path))


def main() -> None:
    """Run, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--form", action="append", choices=sorted(FORMS))
    parser.add_argument("--files", type=int, default=FILES)
    parser.add_argument("--first", type=int, default=0, help="number of the first file of each form")
    parser.add_argument("--case", type=int, help="one file again")
    parser.add_argument("--keep", type=Path, help="folder for --case")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--page", type=Path)
    asked = parser.parse_args()
    if asked.case is not None:
        again(asked.form[0], asked.case, asked.keep)
        return
    result = summary(run(asked.form or list(FORMS), asked.files, asked.first))
    if asked.json is not None:
        asked.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    if asked.page is not None:
        text = asked.page.read_text(encoding="utf-8") if asked.page.exists() else ""
        asked.page.write_text(with_section(text, result), encoding="utf-8")


if __name__ == "__main__":
    main()
