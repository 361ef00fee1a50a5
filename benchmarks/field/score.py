"""Scores of the field's rows, docs/field.md that shows them, and the page with every flight behind it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.field.hidden import HIDDEN
from benchmarks.field.judge import FIRM
from benchmarks.hidden_effects.score import BY_HAND, share
from benchmarks.hidden_effects.score import _percent as percent
from benchmarks.hidden_effects.score import _table as table

Row = dict[str, Any]
EDGES = (0.0, 0.5, 0.65, 0.8, 0.9, 1.01)
"""Of the bins of stated confidence."""
GOALS = {
    "true_in_class": ">= 95 %",
    "firm_wrong": "<= 1 %",
    "stated_wrong": "<= 1 %",
    "none_firm": "0 %",
    "none_nothing": ">= 90 %",
    "outside_unknown": ">= 90 %",
    "minute": "< 10 s",
}


def score(rows: list[Row]) -> dict[str, Any]:
    """What issue 10 asks for, over all rows: shares with their counts, by name."""
    fine = [r for r in rows if "error" not in r]
    none, outside = _kind(fine, "none"), _kind(fine, "outside")
    hidden = _kind(fine, "one", "several")
    told = [r for r in hidden if r["told"]]
    return {
        "flights": dict(Counter(r["kind"] for r in fine)),
        "errors": [r["case"] for r in rows if "error" in r],
        "true_in_class": _share(told, lambda r: r["in_class"]),
        "true_in_class_one": _share(_kind(told, "one"), lambda r: r["in_class"]),
        "true_in_class_several": _share(_kind(told, "several"), lambda r: r["in_class"]),
        "true_in_class_all": _share(hidden, lambda r: r["in_class"]),
        "firm_wrong": _names(fine),
        "flights_firm_wrong": _share(fine, lambda r: bool(r["firm_wrong"])),
        "stated_wrong": _stated(fine),
        "none_firm": _share(none, lambda r: bool(r["firm_wrong"])),
        "none_nothing": _share(none, lambda r: r["verdict"] != "unknown" and not r["named_beside"]),
        "none_named": _share(none, lambda r: bool(r["named_beside"])),
        "outside_unknown": _share(outside, lambda r: r["verdict"] == "unknown"),
        "calibration": calibration(fine),
        "cpu_per_minute_median": round(float(np.median([r["cpu_per_minute"] for r in fine])), 1) if fine else None,
        "cpu_per_minute_most": round(max(r["cpu_per_minute"] for r in fine), 1) if fine else None,
    }


def _kind(rows: Iterable[Row], *kinds: str) -> list[Row]:
    return [r for r in rows if r["kind"] in kinds]


def _share(rows: list[Row], true: Callable[[Row], bool]) -> dict[str, Any]:
    return {"share": share(sum(bool(true(r)) for r in rows), len(rows)), "of": len(rows)}


def _names(rows: list[Row]) -> dict[str, Any]:
    """Firm names that are wrong, of all firm names."""
    firm = sum(len(r["firm"]) for r in rows)
    return {"share": share(sum(len(r["firm_wrong"]) for r in rows), firm), "of": firm}


def _stated(rows: list[Row]) -> dict[str, Any]:
    """Names stated at `FIRM` or more of which neither they nor anything of their group is there."""
    sure = [right for r in rows for _, p, right in r["stated"] if p >= FIRM]
    return {"share": share(len(sure) - sum(sure), len(sure)), "of": len(sure)}


def calibration(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """Stated confidence against how often the name was true, by bins of `EDGES`; empty bins are left out."""
    listed = [(p, right) for r in rows for _, p, right in r["stated"]]
    out = []
    for low, high in pairwise(EDGES):
        inside = [(p, right) for p, right in listed if low <= p < high]
        if inside:
            p, right = np.array(inside, dtype=float).T
            label = f"{100 * low:.0f}-{min(100.0, 100 * high):.0f} %"
            out.append({"bin": label, "names": len(p), "stated": float(p.mean()), "true": float(right.mean())})
    return out


HEAD = """# The field: other vehicles, another engine, other flying

Five vehicles (quadrotors of 30 g and 1.5 kg, a coaxial X8, one of which the wrench alone is known, the tilting
hexarotor), three kinds of flying (excited; hovers, lines and turns; hover in turbulence under a controller with
integrals), a good and a cheap IMU; one to five hidden effects, nothing hidden, and what is in no catalogue. All but the
hexarotor are flown by RotorPy, a simulator that somebody else wrote, with effects made in its own parameters
([decision 0016](decisions/0016-field-benchmark.md); its parts: [benchmarks/field](../benchmarks/field/README.md)).

    python -m benchmarks.field --json docs/field.json --page docs/field.md --notes benchmarks/notes/field.md

Flights with other first seeds (`--seed 7000`) are there for tuning. {flights} of {all} flights are below; each of them,
sizes, and what is accepted for what: [notes](../benchmarks/notes/field.md).

"In the class": the heaviest class of the answer has a set that says everything that was hidden and nothing else (but
for `constant_wrench`, which is what an IMU's bias looks like; it must not be firm). It is counted where a regression
with the true laws could tell each hidden effect with five standard deviations (not computed for the hexarotor).
"Firm": listed as firm by the answer, or where it lists none, stated with at least 80 %; wrong where the name is neither
hidden nor there anyway. A stated confidence speaks for the name or its group, so it is right where one of them is.
"""
DETAIL = """# Notes: every flight of the field

Written by `python -m benchmarks.field --notes benchmarks/notes/field.md`; the scores: [field](../../docs/field.md).
"""


def page(rows: list[Row], everything: int, by_hand: str = "") -> str:
    """docs/field.md; `everything` is how many flights the field has."""
    s = score(rows)
    head = HEAD.format(flights=sum(s["flights"].values()), all=everything)
    parts = [head, _headline(s), _calibration(s), _breakdown(rows)]
    return "\n".join(parts) + f"\n{BY_HAND}\n{by_hand}"


def detail(rows: list[Row], by_hand: str = "") -> str:
    """The page behind it: every flight, sizes, and what is accepted for what."""
    return "\n".join([DETAIL, _listed(rows), _sizes()]) + f"\n{BY_HAND}\n{by_hand}"


def _headline(s: dict[str, Any]) -> str:
    words = [
        ("true set in the answer's class, where it could be told", "true_in_class"),
        ("... one effect", "true_in_class_one"),
        ("... two to five effects", "true_in_class_several"),
        ("... on all flights with effects of the catalogue", "true_in_class_all"),
        ("firm names that are wrong", "firm_wrong"),
        ("flights with a firm name that is wrong", "flights_firm_wrong"),
        ("names stated at 80 % or more that are wrong, and so is their group", "stated_wrong"),
        ("nothing hidden: anything firm", "none_firm"),
        ("nothing hidden: `nothing`, or names of what is there anyway", "none_nothing"),
        ("... anything else named, firm or not", "none_named"),
        ("not in the catalogue: `unknown`", "outside_unknown"),
    ]
    rows = [(text, GOALS.get(key, "-"), percent(s[key]["share"]), str(s[key]["of"])) for text, key in words]
    time = f"{s['cpu_per_minute_median']} s, at most {s['cpu_per_minute_most']} s"
    rows.append(("CPU time per minute of flight, median", GOALS["minute"], time, str(sum(s["flights"].values()))))
    lost = f"\nFlights that ended in an error: {', '.join(s['errors'])}.\n" if s["errors"] else ""
    return "## Scores\n\n" + table(("what", "goal", "reached", "of"), rows) + lost


def _calibration(s: dict[str, Any]) -> str:
    rows = [(b["bin"], str(b["names"]), percent(b["stated"]), percent(b["true"])) for b in s["calibration"]]
    goal = "Stated confidence of every name against how often it was true; the goal is within 5 points.\n\n"
    return "## Confidence\n\n" + goal + table(("stated", "names", "stated, mean", "true"), rows)


def _breakdown(rows: list[Row]) -> str:
    out = []
    for key in ("vehicle", "flying", "imu"):
        for value in dict.fromkeys(r[key] for r in rows if "error" not in r):
            s = score([r for r in rows if "error" not in r and r[key] == value])
            cells = [s[k] for k in ("true_in_class", "firm_wrong", "none_nothing", "outside_unknown")]
            shown = [f"{percent(c['share'])} of {c['of']}" if c["of"] else "-" for c in cells]
            out.append((value, str(sum(s["flights"].values())), *shown))
    heads = ("", "flights", "true set in the class", "firm names wrong", "nothing hidden: nothing", "outside: unknown")
    return "## By vehicle, flying and IMU\n\n" + table(heads, out)


def _listed(rows: list[Row]) -> str:
    titles = {
        "none": "Nothing hidden",
        "one": "One effect",
        "several": "Two to five",
        "outside": "Not in the catalogue",
    }
    parts = []
    for kind, title in titles.items():
        listed = [_cells(r) for r in rows if "error" not in r and r["kind"] == kind]
        if listed:
            heads = ("flight", "verdict", "named", "firm and wrong", "in the class", "could be told")
            parts.append(f"## {title}\n\n" + table(heads, listed))
    return "\n".join(parts)


def _cells(r: Row) -> tuple[str, ...]:
    groups = {g[0]: f" (or {', '.join(g[1:])})" for g in r["groups"]}
    named = ", ".join(name + groups.get(name, "") for name in r["effects"]) or "-"
    yes = {True: "yes", False: "**no**", None: "-"}
    told = {True: "yes", False: "no", None: "-"}
    wrong = ", ".join(r["firm_wrong"]) or "-"
    return (r["case"], r["verdict"], named, wrong, yes[r["in_class"]], told[r["told"]])


def _sizes() -> str:
    """What is hidden in RotorPy's vehicles; that of the hexarotor is on the page of `hidden_effects`."""
    listed = []
    for name, hidden in HIDDEN.items():
        answers = " or ".join(" with ".join(sorted(s)) for s in hidden.answers)
        listed.append((name, hidden.size, answers or "unknown"))
    text = "Size 1 of what is hidden in RotorPy's vehicles; for the hexarotor see [there](hidden-effects.md#sizes).\n\n"
    return "## Sizes\n\n" + text + table(("hidden", "size 1", "accepted sets of names"), listed)
