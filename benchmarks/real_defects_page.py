"""docs/real-defects.md and the notes behind it, from the rows of `benchmarks.real_defects`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Row = dict[str, Any]
BOTH = 2.0
"""Cut of both blades [mm] from which on the rotor is to be named."""
SURE = 0.9
RIGHT = {"cut": {"rotor_thrust"}, "tape": {"rotor_thrust"}, "weight": {"mass", "com_offset", "payload", "inertia"}}
"""Names that are not wrong, by what was done to the vehicle."""
EVERY = {"motor_lag", "asymmetric_motor_lag", "thrust_curve"}
"""True of every Crazyflie, and not in the model file: its motors follow within some 70 ms, its thrust is no square."""
SHOWN = 3
"""Sets of effects that are shown."""

HEAD = """# Real defects: what `changed` finds on CrazyPAD

`python -m benchmarks.real_defects FOLDER --json docs/real-defects.json --page docs/real-defects.md --notes
benchmarks/notes/real-defects.md` calls what [`wrenchgap changed`](changed.md) calls. Flights: CrazyPAD (Data 2024, 9,
79; MIT licence), drone E8, a Crazyflie 2.1 in hover, five normal flights and two of each defect, converted to MCAP: two
times 7 s in the air, 100 Hz, no excitation, lateral acceleration not measured (`--unmeasured force_x,force_y`), so that
four means are all that a flight has to say: F_z, M_x, M_y, M_z. All answers are with the full catalogue; the nominal
model was calibrated on two of the normal flights. Single flights, and what `explain` says without healthy flights:
[notes](../benchmarks/notes/real-defects.md).

"""
DETAIL = """# Notes: single flights of CrazyPAD

Written by `python -m benchmarks.real_defects FOLDER --notes benchmarks/notes/real-defects.md`; what was reached:
[real defects](../../docs/real-defects.md).

"""

LIMITS = """
## What is not visible, and why

- A change has to exceed what normal flights differ by (one standard deviation: M_x 0.30 mNm, M_y 0.17 mNm, M_z 13 uNm,
  F_z 5 mN; they are of two sessions, between which the centre of mass moved by 1.8 mm). Weights, tape and small cuts do
  not. "Nothing changed" on a flight with a defect says that these flights cannot show it.
- A cut propeller shows by its yaw torque first, together with roll, pitch and thrust. The size is the loss of thrust at
  equal command. Without clear roll and pitch, M1, which turns the same way round, stays possible.
- Both flights of a case count as one for what differs between days.
"""
REASONS = """
## What is not visible, and why

- The normal flights differ among themselves by 0.30 mNm in M_x, 0.17 mNm in M_y, 13 uNm in M_z and 5 mN in F_z (one
  standard deviation): they are of two sessions, between which the centre of mass moved by 1.8 mm. A change has to
  exceed that, whatever it is; that is why weights, tape and small cuts are called what they are here, within what
  healthy flights differ by. "Nothing changed" on a flight with a defect does not say that the vehicle is well; it
  says that these flights cannot show it.
- Weights: with the one near M4 the means lie 0.39 mNm nose down of the normal ones (1.2 mm of a centre of mass), and
  in roll and thrust where the second session of normal flights does. In pitch the five normal flights agree within 12
  uNm, but they are two sessions, and in roll these differ by 0.55 mNm: two sessions do not say that pitch is so much
  steadier than roll. With the weights near M3 and M4, roll and thrust (0.67 mNm, 13 mN) lie on the line on which the
  two sessions differ, only further out. What comes nearest points to the right side in both cases.
- A cut propeller shows by its yaw torque first (M_z differs least between sessions), together with roll, pitch and
  thrust. Of M3 cut by 2 mm and 2 mm the yaw torque says a loss of 20 % of the drag torque, roll 11 % of the thrust,
  pitch 3 %, the whole thrust nothing: a shorter propeller on a brushed motor turns faster. The change of a rotor
  therefore takes one to two and a half times as large a share of drag torque as of thrust; the size is the loss of
  thrust at equal command. Without clear roll and pitch, M1, which turns the same way round, stays possible.
- Both flights of a case are taken to be of one day, and count as one for what differs between days.
"""


EXPLAINED = """
## What `explain` says, without healthy flights beside

All flights of a case together, against the model file, which was calibrated on two of the normal flights. Motors that
lag and a thrust that is not the square of the command are true of every Crazyflie and not in the file; they do not
count as wrong. In a hover, a weak rotor, a rope, a weight and a constant wrench differ by little: this is what
`changed` is for.

"""


def page(rows: Sequence[Row]) -> str:
    """The page for docs."""
    together, single, healthy = _kinds(rows)
    return "".join(
        (
            HEAD,
            goals(together, single, healthy),
            "\n## Cases: both flights of each against five normal ones\n\n",
            table(sorted(together, key=_order)),
            "\n*Confidence* is the weight of the sets in which something changed. Where nothing is established, the "
            "last column is the change that comes nearest, with the log odds of it against none.\n",
            LIMITS,
        )
    )


def detail(rows: Sequence[Row], alone: Sequence[Row] = ()) -> str:
    """The page behind it; `alone` is what `explain` says."""
    together, single, _ = _kinds(rows)
    return "".join(
        (
            DETAIL,
            "## Single flights against five normal ones\n\n",
            singles(single),
            "\n## Weights: where the centre of mass by itself would have moved\n\n",
            weights(together + single),
            explained(sorted(alone, key=_order)),
            REASONS,
        )
    )


def _kinds(rows: Sequence[Row]) -> tuple[list[Row], list[Row], list[Row]]:
    """Cases with both of their flights, those with one, and normal flights against each other."""
    together = [r for r in rows if r["kind"] != "healthy" and len(r["suspect"]) > 1]
    single = [r for r in rows if r["kind"] != "healthy" and len(r["suspect"]) == 1]
    return together, single, [r for r in rows if r["kind"] == "healthy"]


def _order(row: Row) -> tuple[str, float, float]:
    blades = [*row["blades"], 0.0, 0.0]
    return row["kind"], min(blades[:2]), max(blades)


def is_rotor(row: Row) -> bool:
    """Whether rotor M3 is firm."""
    return "rotor_thrust" in row["firm"] and row["where"] == "M3" and row["probability"] >= SURE


def wrong(row: Row) -> bool:
    """Whether a firm name, or a rotor that is sure, is not what was done to the vehicle."""
    if set(row["firm"]) - RIGHT.get(row["kind"], set()):
        return True
    return row["kind"] == "cut" and bool(row["firm"]) and row["where"] != "M3" and row["probability"] >= SURE


def goals(together: Sequence[Row], single: Sequence[Row], healthy: Sequence[Row]) -> str:
    """What was to be reached, and what was."""
    large = [r for r in together if r["kind"] == "cut" and min(r["blades"]) >= BOTH]
    large_single = [r for r in single if r["kind"] == "cut" and min(r["blades"]) >= BOTH]
    pairs = [r for r in healthy if len(r["healthy"]) == 1]
    rest = [r for r in healthy if len(r["healthy"]) > 1]
    missed = ", ".join(sorted({_truth(r) for r in (*large, *large_single) if not is_rotor(r)})) or "none"
    loads = [r for r in together if r["kind"] == "weight"]
    said = "; ".join(f"{_truth(r)}: {r['verdict']}" for r in loads)
    where = ", ".join(f"towards {r['com_towards']} ({_truth(r)})" for r in loads) or "nowhere"
    lines = (
        ("goal", "reached"),
        ("---", "---"),
        (
            "M3 cut by 2 mm or more on both blades: rotor M3 firm",
            f"{_count(large, is_rotor)} cases, {_count(large_single, is_rotor)} single flights; missed: {missed}",
        ),
        (
            "wrong firm names: 0",
            _count((*together, *single, *healthy), wrong),
        ),
        (
            "weights: centre of mass towards them",
            f"not established ({said}); a centre of mass by itself would have moved {where}",
        ),
        (
            "healthy against healthy: nothing changed",
            f"{_count(pairs, _nothing)} ordered pairs, {_count(rest, _nothing)} of one against the other four",
        ),
    )
    return "\n".join(f"| {a} | {b} |" for a, b in lines) + "\n"


def _nothing(row: Row) -> bool:
    return bool(row["verdict"] == "nothing")


def _count(rows: Sequence[Row], test: Any) -> str:
    return f"{sum(map(test, rows))} of {len(rows)}"


def _truth(row: Row) -> str:
    if row["kind"] == "cut":
        a, b = row["blades"]
        series = "" if row["case"].count("mm") > 1 else " (second series)"
        return f"M3 cut {a:g} mm" + (f" and {b:g} mm" if b else f", one blade{series}")
    words = row["case"].split("_")
    if row["kind"] == "healthy":
        return "normal flights"
    if row["kind"] == "weight":
        return f"weight near {' and '.join(w for w in words if w.startswith('M'))}"
    return f"tape on {', '.join(w for w in words if w.startswith('M'))}"


def _answer(row: Row) -> tuple[str, str, str]:
    """What is named, how large, and what comes nearest where nothing is."""
    if row["verdict"] == "nothing":
        return "nothing beyond scatter", "-", f"{row['alone']} ({row['log_odds']:.1f})"
    place = f" {row['where']} ({100 * row['probability']:.0f} %)" if row["where"] else ""
    firm = "**" if row["firm"] else ""
    size = f"{100 * row['change']:.1f} +- {100 * row['uncertain']:.1f} %" if row["effect"] == "rotor_thrust" else "-"
    name = row["effect"] if row["verdict"] == "changed" else "something without a name"
    return f"{firm}{name}{place}{firm}", f"{size}, {row['significance']:.1f} sigma", "-"


def table(rows: Sequence[Row]) -> str:
    """One line for each case."""
    lines = ["| truth | answer (bold: firm) | size | confidence | nearest, not established |", "|---|---|---|---|---|"]
    for r in rows:
        answer, size, near = _answer(r)
        lines.append(f"| {_truth(r)} | {answer} | {size} | {abs(100 * (1 - r['nothing'])):.0f} % | {near} |")
    return "\n".join(lines) + "\n"


def singles(rows: Sequence[Row]) -> str:
    """One line for each kind of truth: how many of its flights have which answer."""
    lines = [
        "| truth | flights | rotor M3 firm | something else named | nothing beyond scatter |",
        "|---|---|---|---|---|",
    ]
    for truth in dict.fromkeys(_truth(r) for r in sorted(rows, key=_order)):
        mine = [r for r in rows if _truth(r) == truth]
        named, none = sum(map(is_rotor, mine)), sum(map(_nothing, mine))
        lines.append(f"| {truth} | {len(mine)} | {named} | {len(mine) - named - none} | {none} |")
    return "\n".join(lines) + "\n"


def weights(rows: Sequence[Row]) -> str:
    """Direction of a change of the centre of mass by itself, established or not."""
    lines = ["| truth | flights | towards | distance | significance |", "|---|---|---|---|---|"]
    for r in rows:
        if r["kind"] == "weight":
            numbers = f"{r['com_mm']:.1f} mm | {r['com_significance']:.1f} sigma"
            lines.append(f"| {_truth(r)} | {len(r['suspect'])} | {r['com_towards']} | {numbers} |")
    return "\n".join(lines) + "\n"


def explained(rows: Sequence[Row]) -> str:
    """What `explain` says of each case, without healthy flights beside."""
    if not rows:
        return ""
    out = [
        "| truth | verdict | firm | likely sets of effects | least thrust, where rotors were fitted |",
        "|---|---|---|---|---|",
    ]
    for r in rows:
        shown = [(" + ".join(names) or "nothing", weight) for names, weight in r["sets"][:SHOWN]]
        sets = "; ".join(f"{words} {100 * weight:.0f} %" for words, weight in shown) or "-"
        weakest = min(r["rotors"].items(), key=lambda rotor: rotor[1], default=None)
        least = f"{weakest[0]}, {100 * weakest[1]:+.0f} %" if weakest else "-"
        out.append(f"| {_truth(r)} | {r['verdict']} | {', '.join(r['firm']) or '-'} | {sets} | {least} |")
    wrong_firm = [r for r in rows if set(r["firm"]) - RIGHT.get(r["kind"], set()) - EVERY]
    large = [r for r in rows if r["kind"] == "cut" and min(r["blades"]) >= BOTH]
    there = [r for r in large if any("rotor_thrust" in names for names, _ in r["sets"])]
    said = f"Firm names that are wrong: {len(wrong_firm)} of {len(rows)} cases"
    said += f" ({'; '.join(map(_truth, wrong_firm))})" if wrong_firm else ""
    said += f". Rotor thrust in a likely set: {len(there)} of {len(large)} cases with 2 mm or more cut off both blades."
    return EXPLAINED + "\n".join(out) + f"\n\n{said}\n"
