"""The section of docs/reliability.md, and the table behind it: every number is one of the run's."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.faults.cases import files_of
from benchmarks.faults.opening import Outcome
from benchmarks.faults.valid import FORMS, LOGS
from benchmarks.faults.workers import MEGABYTES, SECONDS, Row

HEADING = "## Damaged files"
TEXT = """{heading}

`python -m benchmarks.faults --rows FILE --json docs/faults.json --page docs/reliability.md`: {total} files, each a
small valid one with seeded damage: bytes cut, flipped, doubled, swapped, and damage that knows the format (records
out of order, wrong checksums, chunks that claim terabytes, recursive definitions). Each is opened as by `wrenchgap
inspect`, every tenth log with a model, in a child process with {seconds:g} s of processor time and {megabytes} MB
above an idle one. By form: [table](../benchmarks/notes/faults.md).

- *whole*: the same numbers as of the intact file;
- *recovered*: other or fewer numbers, and a note, count or check says so;
- *altered*: other numbers, as plausible, and nothing is said;
- *shorter*: the file ends between two samples, and its format has no count of them;
- *refused*: in one line;
- *faults*: a traceback, several lines, a hang, memory, death of the process, a file changed by opening it.

"""


def summary(found: Sequence[Row]) -> dict[str, Any]:
    """The run as JSON: counts by form, and every fault."""
    forms = {}
    for form in dict.fromkeys(row.form for row in found):
        own = [row for row in found if row.form == form]
        counts = Counter(row.outcome for row in own)
        forms[form] = {"files": len(own), **{kind.value: counts[kind.value] for kind in Outcome}}
        forms[form]["slowest_s"] = max(row.seconds for row in own)
    faults = [vars(row) for row in found if row.outcome == Outcome.FAULT]
    return {
        "files": len(found),
        "processor_s": round(sum(row.seconds for row in found)),
        "forms": forms,
        "faults": faults,
    }


DETAIL = """# Notes: damaged files by form

Written by `python -m benchmarks.faults --page docs/reliability.md`; what the columns mean:
[reliability](../../docs/reliability.md#damaged-files).

"""


def section(result: Mapping[str, Any]) -> str:
    """Heading, words, and the sums of the table."""
    text = TEXT.format(heading=HEADING, total=f"{result['files']:,}", seconds=SECONDS, megabytes=MEGABYTES)
    whole = sum(map(files_of, FORMS))
    if result["files"] < whole:
        minutes = result["processor_s"] / result["files"] * whole / 60.0
        text += f"The whole run has {whole:,} files, {minutes:.0f} minutes of one core at this pace; this one was\n"
        text += "stopped before, at idle priority on a busy machine; with the same `--rows` it goes on.\n\n"
    return text + _table("form", _sums(result))


def detail(result: Mapping[str, Any]) -> str:
    """The page behind it: every form."""
    return DETAIL + _table("form", result["forms"])


def _sums(result: Mapping[str, Any]) -> dict[str, dict[str, int]]:
    """Of all logs, and of all other files."""
    found = {}
    for title, logs in (("all logs", True), ("all others", False)):
        part = [counts for form, counts in result["forms"].items() if (form in LOGS) == logs]
        if part:
            kinds = ("files", *(kind.value for kind in Outcome))
            found[title] = {key: sum(counts[key] for counts in part) for key in kinds}
    return found


def _table(head: str, counted: Mapping[str, Mapping[str, Any]]) -> str:
    kinds = [kind.value for kind in Outcome]
    lines = [f"| {head} | files | {' | '.join(kinds[:-1])} | faults |", "|---" * (len(kinds) + 2) + "|"]
    return "\n".join([*lines, *(_row(name, counts, kinds) for name, counts in counted.items())]) + "\n"


def _row(name: str, counts: Mapping[str, Any], kinds: Sequence[str]) -> str:
    return f"| {name} | {counts['files']} | {' | '.join(str(counts[kind]) for kind in kinds)} |"


def with_section(text: str, result: Mapping[str, Any]) -> str:
    """A page with this section in the place of an older one, or behind everything else."""
    before, found, rest = text.partition(f"{HEADING}\n")
    after = rest[rest.index("\n## ") :] if found and "\n## " in rest else ""
    return before.rstrip("\n") + ("\n\n" if before else "") + section(result) + after
