"""Damaged files.

    python -m benchmarks.faults --json docs/faults.json --page docs/reliability.md     # the whole run, 20,000 files
    python -m benchmarks.faults --form ulog --files 500                                # one form, printed
    python -m benchmarks.faults --form ulog --case 317 --keep /tmp/here                # one file again, kept

With `--rows FILE` what came of each file is written as it comes, and an interrupted run goes on where it was.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from benchmarks.faults.cases import Case, files_of
from benchmarks.faults.opening import Outcome, opened
from benchmarks.faults.page import detail, summary, with_section
from benchmarks.faults.valid import FORMS
from benchmarks.faults.workers import Row, rows
from benchmarks.pages import NOTES

TURN = 25
"""Files of a form before it is the next one's turn."""


def run(forms: Sequence[str], files: int | None, first: int, kept: Path | None) -> list[Row]:
    """Open `files` of each form, some of every form in turn; faults are printed as they come."""
    known = [] if kept is None or not kept.exists() else kept.read_text(encoding="utf-8").splitlines()
    found = {(row.form, row.number): row for row in (Row(**json.loads(line)) for line in known)}
    cases = [Case(form, number) for form in forms for number in range(first, first + (files or files_of(form)))]
    left = [case for case in cases if (case.form, case.number) not in found]
    for row in rows(sorted(left, key=lambda case: case.number // TURN)):
        found[row.form, row.number] = row
        if kept is not None:
            with kept.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(vars(row)) + "\n")
        if row.outcome == Outcome.FAULT:
            print(f"{row.form} {row.number} ({row.damage}): {row.error}", flush=True)
    for form in forms:
        own = [row for row in found.values() if row.form == form]
        slow, total = max(own, key=lambda row: row.seconds), sum(row.seconds for row in own)
        said = f"{dict(Counter(row.outcome for row in own))}; {total:.0f} s"
        print(f"{form}: {said}, longest {slow.number} ({slow.damage}) {slow.seconds:.2f} s", flush=True)
    return list(found.values())


def again(form: str, number: int, folder: Path) -> None:
    """Make one damaged file again, and open it here."""
    (folder / "valid").mkdir(parents=True)
    (folder / "case").mkdir()
    valid = FORMS[form](folder / "valid")
    path, damage = Case(form, number).make(valid, folder / "case")
    print(f"{path}: {damage}", flush=True)
    print(opened(form, path))


def main() -> None:
    """Run, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--form", action="append", choices=sorted(FORMS))
    parser.add_argument("--files", type=int, help="of each form")
    parser.add_argument("--first", type=int, default=0, help="number of the first file of each form")
    parser.add_argument("--case", type=int, help="one file again")
    parser.add_argument("--keep", type=Path, help="folder for --case")
    parser.add_argument("--rows", type=Path, help="a file to which rows are added, and from which they are taken")
    parser.add_argument("--so-far", action="store_true", help="open nothing more: what is in --rows")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--page", type=Path)
    asked = parser.parse_args()
    if asked.case is not None:
        again(asked.form[0], asked.case, asked.keep)
        return
    if asked.so_far:
        found = [Row(**json.loads(line)) for line in asked.rows.read_text(encoding="utf-8").splitlines()]
        result = summary(sorted(found, key=lambda row: (list(FORMS).index(row.form), row.number)))
    else:
        result = summary(run(asked.form or list(FORMS), asked.files, asked.first, asked.rows))
    if asked.json is not None:
        asked.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    if asked.page is not None:
        text = asked.page.read_text(encoding="utf-8") if asked.page.exists() else ""
        asked.page.write_text(with_section(text, result), encoding="utf-8")
        (NOTES / "faults.md").write_text(detail(result), encoding="utf-8")


if __name__ == "__main__":
    main()
