"""docs/reliability.md, and the table behind it, from the rows of the suite: every number is one of theirs."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.meaning.judge import Row

CALM = "quad, calm"
HEAD = """# Reliability

## Meaning: wrong units, frames, signs, orders, clocks, stuck channels

`python -m benchmarks.meaning{option} --json docs/reliability.json --page docs/reliability.md` (seed {seed}): logs of
MuJoCo with one fault each, opened for their model; thresholds of the [checks](checks.md) were set on other seeds and on
recorded logs. By fault and vehicle: [table](../benchmarks/notes/meaning.md).

- *named*: a check of this fault refuses the log, or warns where samples are left out;
- *silent*: nothing is said: an upper bound of what may be silently wrong;
- *mended*: the log passes with the proposed option (and a second one, if the first reveals another fault).

"""
DETAIL = """# Notes: logs with one fault

Written by `python -m benchmarks.meaning{option} --page docs/reliability.md` (seed {seed}); what is measured, and the
scores: [reliability](../../docs/reliability.md). *Seen*: some check refuses or warns, but none that means this fault.

"""


def page(faults: Sequence[Row], healthy: Sequence[Row], seed: int) -> str:
    """The section of docs/reliability.md."""
    usual = [row for row in faults if row.vehicle != CALM]
    calm = [row for row in faults if row.vehicle == CALM]
    return "".join((HEAD.format(seed=seed, option=_option(faults)), _scores(usual, healthy), _calm(calm)))


def detail(faults: Sequence[Row], healthy: Sequence[Row], seed: int) -> str:
    """The page behind it: each fault on each vehicle, answers, healthy logs."""
    head = DETAIL.format(seed=seed, option=_option(faults))
    usual = [row for row in faults if row.vehicle != CALM]
    answers = _answers(faults, healthy)
    return f"{head}## By fault\n\n{_table(usual)}{answers}\n## Healthy logs\n\n{_healthy(healthy)}"


def _option(faults: Sequence[Row]) -> str:
    return "" if any(row.firm is not None for row in faults) else " --open-only"


def _scores(usual: Sequence[Row], healthy: Sequence[Row]) -> str:
    offered = [row for row in usual if row.mended is not None]
    flagged = [row for row in healthy if row.seen]
    rows = (
        ("logs with a fault", str(len(usual)), "60 at least"),
        ("vehicles", str(len({row.vehicle for row in usual})), "3"),
        ("named", _share([row.named for row in usual]), "95 %"),
        ("silent", str(sum(not row.seen for row in usual)), "0"),
        ("mended by the proposed option", _share([bool(row.mended) for row in offered]), "-"),
        ("healthy logs flagged", f"{len(flagged)} of {len(healthy)}", "0"),
    )
    lines = ["| | found | goal |", "|---|---|---|", *(f"| {a} | {b} | {c} |" for a, b, c in rows)]
    return "\n".join(lines) + "\n"


def _share(values: Sequence[bool]) -> str:
    return f"{sum(values)} of {len(values)} ({100 * sum(values) / max(len(values), 1):.0f} %)"


def _table(rows: Sequence[Row]) -> str:
    vehicles = list(dict.fromkeys(row.vehicle for row in rows))
    lines = [f"| fault | {' | '.join(vehicles)} | proposed |", "|---" * (len(vehicles) + 2) + "|"]
    for fault in dict.fromkeys(row.fault for row in rows):
        own = {row.vehicle: row for row in rows if row.fault == fault}
        cells = [_cell(own[v]) if v in own else "-" for v in vehicles]
        mend = next((row.mend for row in own.values() if row.mend), None)
        lines.append(f"| {fault} | {' | '.join(cells)} | {f'`{mend}`' if mend else '-'} |")
    return "\n".join(lines) + "\n"


def _cell(row: Row) -> str:
    said = "named" if row.named else "seen" if row.seen else "**silent**"
    return said + ("" if row.mended is None else ", mended" if row.mended else ", not mended")


def _calm(rows: Sequence[Row]) -> str:
    if not rows:
        return ""
    silent = [row.fault for row in rows if not row.seen]
    text = (
        "\nA flight that hardly excites anything, the quadrotor with a fifth of the excitation and half the motion: "
        f"named {_share([row.named for row in rows])}, silent {len(silent)}"
    )
    return f"{text}{': ' + ', '.join(silent) if silent else ''}.\n"


def _answers(faults: Sequence[Row], healthy: Sequence[Row]) -> str:
    """What `explain` said of logs that were not refused: firm, and off, with or without a warning."""
    asked, fine = ([row for row in rows if row.firm is not None] for rows in (faults, healthy))
    if not asked:
        return ""
    wrong = [row for row in asked if row.wrong]
    silently = [row for row in wrong if not row.seen]
    lines = [
        "\n## Answers on logs that are not refused\n",
        "`explain`, with the effects of `benchmarks/meaning/answers.py`, on vehicles whose lag and drag are known.",
        "*Wrong* is a firm effect that is not there, or a lag or drag off by more than three standard deviations as",
        "stated; *silently wrong* is that without any warning.\n",
        "| | found | goal |\n|---|---|---|",
        f"| logs with a fault that were explained | {len(asked)} | - |",
        f"| silently wrong | {len(silently)} | 0 |",
        f"| wrong below a warning | {len(wrong) - len(silently)} | - |",
        f"| healthy logs that were explained, wrong of them | {len(fine)}, {sum(bool(r.wrong) for r in fine)} | 0 |",
    ]
    lines += [f"\n- {row.vehicle}, {row.fault} ({', '.join(row.found)}): {row.wrong}" for row in wrong]
    return "\n".join(lines) + "\n"


def _healthy(rows: Sequence[Row]) -> str:
    vehicles = list(dict.fromkeys(row.vehicle for row in rows))
    lines = ["| vehicle | logs | flagged |", "|---|---|---|"]
    for vehicle in vehicles:
        own = [row for row in rows if row.vehicle == vehicle]
        flagged = [f"{row.fault} ({', '.join(row.found)})" for row in own if row.seen]
        names = ", ".join(row.fault for row in own)
        lines.append(f"| {vehicle} | {names} | {', '.join(flagged) or 'none'} |")
    return "\n".join(lines) + "\n"
