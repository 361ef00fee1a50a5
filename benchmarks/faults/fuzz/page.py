"""The section of docs/reliability.md: every number in its table is one of the run's."""

from __future__ import annotations

from collections.abc import Mapping

HEADING = "## Fuzzing"
TEXT = """{heading}

`make fuzz` ([decision](decisions/0024-atheris.md)) searches with atheris, guided by coverage. `python -m
benchmarks.faults.fuzz --minutes {processor:.0f} --json docs/fuzz.json --page docs/reliability.md`: {processor:.0f}
minutes of processor time, {minutes:.0f} by the clock, one process at a time; {findings}
([what](../benchmarks/notes/reliability.md#what-damaged-files-showed)).

*Branches*: places passed in the instrumented code (readers, plant, stored GPs, rosbags, pyulog, tomlkit) with the kept
corpus. *New inputs*: those that passed a new branch, or one a new number of times; the small ones are kept.

"""
HEADS = ("target", "processor minutes", "executions", "branches at the beginning", "branches at the end", "new inputs")


def section(total: Mapping[str, Mapping[str, float]]) -> str:
    """Heading, words and table."""
    minutes = sum(sums["seconds"] for sums in total.values()) / 60.0
    processor = sum(sums["processor_s"] for sums in total.values()) / 60.0
    findings = int(sum(sums["found"] for sums in total.values()))
    said = {0: "no fault was found", 1: "one fault was found"}.get(findings, f"{findings} faults were found")
    text = TEXT.format(heading=HEADING, minutes=minutes, processor=processor, findings=said)
    lines = [f"| {' | '.join(HEADS)} |", "|---" + "|---:" * (len(HEADS) - 1) + "|"]
    for target, sums in total.items():
        counts = (f"{int(sums[key]):,}" for key in ("executions", "branches_before", "branches", "new_inputs"))
        lines.append(f"| {target} | {sums['processor_s'] / 60.0:.0f} | {' | '.join(counts)} |")
    return text + "\n".join(lines) + "\n"


def with_section(text: str, total: Mapping[str, Mapping[str, float]]) -> str:
    """A page with this section in the place of an older one."""
    before, _, rest = text.partition(f"{HEADING}\n")
    return before + section(total) + rest[rest.index("\n## ") :]
