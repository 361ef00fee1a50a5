"""Scores of the benchmark's rows, and the page that shows them."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.hidden_effects import stated
from benchmarks.hidden_effects.cases import SMALL
from benchmarks.hidden_effects.hidden import HIDDEN

Row = dict[str, Any]
GOOD = ("name", "group")


def share(hits: int, count: int) -> float | None:
    """A fraction, None of nothing."""
    return round(hits / count, 4) if count else None


def score(rows: list[Row]) -> dict[str, Any]:
    """Everything the issue asks for, over all rows."""
    fine = [r for r in rows if "error" not in r]
    of = {kind: [r for r in fine if r["kind"] == kind] for kind in ("one", "two", "none", "outside")}
    singles = of["one"]
    of["one"] = [r for r in singles if r["scales"][0] >= SMALL]
    return {
        "flights": {kind: len(listed) for kind, listed in of.items()},
        "errors": [r["case"] for r in rows if "error" in r],
        "one": _outcomes(of["one"]),
        "one_by_size": {
            f"{s:g}": _outcomes([r for r in singles if r["scales"][0] == s])
            for s in sorted({r["scales"][0] for r in singles})
        },
        "two": _outcomes(of["two"]),
        "false_alarms": share(sum(r["right"] == "wrong" for r in of["none"]), len(of["none"])),
        "unknown_outside": share(sum(r["right"] == "unknown" for r in of["outside"]), len(of["outside"])),
        "outside": _outcomes(of["outside"]),
        "firm_and_wrong": share(len(stated.firm_and_wrong(fine)), len(fine)),
        "firm_and_wrong_cases": stated.firm_and_wrong(fine),
        "group_sizes": dict(sorted(Counter(len(g) for r in fine for g in r["groups"]).items())),
        "parameters": _parameters([r for r in of["one"] if r["right"] in GOOD]),
        "unseen": {what: _unseen(of["one"] + of["two"], what) for what in ("force", "torque")},
        "cpu_seconds_median": round(float(np.median([r["cpu_seconds"] for r in fine])), 1) if fine else None,
    }


def _outcomes(rows: list[Row]) -> dict[str, Any]:
    counts = Counter(r["right"] for r in rows)
    right = sum(counts[k] for k in counts if k.split(",")[0] in GOOD)
    named = sum(v for k, v in counts.items() if k not in ("missed", "unknown"))
    return {
        "flights": len(rows),
        "right": share(right, len(rows)),
        "right_and_verdict": share(counts["name"] + counts["group"], len(rows)),
        "right_of_named": share(right, named),
        "wrong": share(counts["wrong"], len(rows)),
        "outcomes": dict(counts),
    }


def _parameters(rows: list[Row]) -> dict[str, Any]:
    listed = [p for r in rows for p in r["parameters"]]
    z = np.array([abs(p["value"] - p["true"]) / max(p["std"], 1e-30) for p in listed])
    both = []
    for r in rows:
        if r["parameters"]:
            value, true, std = (np.array([p[k] for p in r["parameters"]]) for k in ("value", "true", "std"))
            if np.linalg.norm(std) > 0.2 * np.linalg.norm(true):
                continue  # a combination that this flight leaves open
            within = np.abs(value - true) <= 3.0 * std
            close = np.linalg.norm(value - true) <= 0.1 * np.linalg.norm(true)
            both.append((bool(within.all()), bool(close)))
    return {
        "effects": len(both),
        "within_3_sigma": share(sum(w for w, _ in both), len(both)),
        "within_10_percent": share(sum(c for _, c in both), len(both)),
        "both": share(sum(w and c for w, c in both), len(both)),
        "values": len(z),
        "coverage_95": share(int((z <= 1.96).sum()), len(z)),
    }


def _unseen(rows: list[Row], what: str) -> dict[str, Any]:
    shares = [r["unseen"][what] for r in rows if r["unseen"] and r["unseen"][what] is not None and r["right"] in GOOD]
    if not shares:
        return {"flights": 0}
    q = np.percentile(shares, (25, 50, 75))
    return {"flights": len(shares), "median": round(float(q[1]), 3), "quartiles": [round(float(x), 3) for x in q[::2]]}


BY_HAND = "<!-- by hand from here -->"
HEAD = """# Hidden effects: how often the name is right

Flights of an independent engine (MuJoCo: a hull with six hinged arms, position servos, its own integrator, formulas
that are not the catalogue's) with an effect that the model lacks; each is given to `explain` as a user would.

    python -m benchmarks.hidden_effects --json docs/hidden-effects.json --page docs/hidden-effects.md \\
        --notes benchmarks/notes/hidden-effects.md

Every vehicle has servos that lag by about 15 ms and arms with inertia, which the model lacks too: naming `servo_lag`
and `arm_reaction` is right on all flights but the "crisp" ones. Sizes are multiples of a typical size. "Right": the
first effect named, those two aside, is the hidden one or an accepted alias, or the hidden one stands in its group; of
two hidden effects both must be found. Every flight, and what is accepted for what:
[notes](../benchmarks/notes/hidden-effects.md).
"""
DETAIL = """# Notes: every flight with a hidden effect

Written by `python -m benchmarks.hidden_effects --notes benchmarks/notes/hidden-effects.md`; the scores:
[hidden effects](../../docs/hidden-effects.md).
"""


def page(rows: list[Row], by_hand: str = "") -> str:
    """docs/hidden-effects.md."""
    s = score(rows)
    parts = [HEAD, _headline(s), _calibration(rows), _smallest(rows)]
    return "\n".join(parts) + f"\n{BY_HAND}\n{by_hand}"


def detail(rows: list[Row], by_hand: str = "") -> str:
    """The page behind it: every flight, and what is accepted for what."""
    parts = [DETAIL, _by_effect(rows), _listed(rows), _sizes()]
    return "\n".join(parts) + f"\n{BY_HAND}\n{by_hand}"


def written_by_hand(path: Path) -> str:
    """What stands behind the mark on a page that may be there."""
    kept = path.read_text(encoding="utf-8").split(BY_HAND, 1)[1:] if path.exists() else []
    return kept[0].lstrip("\n") if kept else ""


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.0f} %"


def _table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [" | ".join(r) for r in (heads, tuple("---" for _ in heads), *rows)]
    return "\n".join(f"| {line} |" for line in lines) + "\n"


def _headline(s: dict[str, Any]) -> str:
    one, two, p, flown = s["one"], s["two"], s["parameters"], sum(s["flights"].values())
    rows = [
        ("one hidden effect: right name or group first", "95 %, at least 90", _percent(one["right"]), one["flights"]),
        ("... and the verdict not `unknown`", "-", _percent(one["right_and_verdict"]), one["flights"]),
        ("... a wrong name, with a verdict that trusts it", "0", _percent(one["wrong"]), one["flights"]),
        ("two at once: both", "75 %", _percent(two["right"]), two["flights"]),
        ("nothing hidden: false alarms", "0, at most 5 %", _percent(s["false_alarms"]), s["flights"]["none"]),
        ("not in the catalogue: `unknown`", "80 %", _percent(s["unknown_outside"]), s["flights"]["outside"]),
        ("an effect stated at 80 % or more that is not there", "1 %", _percent(s["firm_and_wrong"]), flown),
        ("parameters within 3 sigma and 10 % of truth", "-", _percent(p["both"]), p["effects"]),
        ("... within 3 sigma", "-", _percent(p["within_3_sigma"]), p["effects"]),
        ("... within 10 %", "-", _percent(p["within_10_percent"]), p["effects"]),
        ("coverage of the 95 % intervals, values", "90-99 %", _percent(p["coverage_95"]), p["values"]),
    ]
    for what in ("force", "torque"):
        u = s["unseen"][what]
        if u["flights"]:
            label = f"removable {what} error gone on an unseen trajectory, median"
            rows.append((label, "90 %", _percent(u["median"]), u["flights"]))
    groups = ", ".join(f"{n} of {size}" for size, n in s["group_sizes"].items()) or "none"
    text = _table(("what", "goal", "reached", "of"), [(a, b, c, str(d)) for a, b, c, d in rows])
    sizes = s["one_by_size"].values()
    by_size = _table(
        ("size", *s["one_by_size"]),
        [
            ("flights", *(str(v["flights"]) for v in sizes)),
            ("right", *(_percent(v["right"]) for v in sizes)),
            ("missed", *(str(v["outcomes"].get("missed", 0)) for v in sizes)),
            ("wrong", *(str(v["outcomes"].get("wrong", 0)) for v in sizes)),
        ],
    )
    return f"## Scores\n\n{text}\nBy size of a single hidden effect:\n\n{by_size}\nGroups that were given: {groups}.\n"


def _named_by_size(rows: list[Row]) -> dict[str, dict[float, str]]:
    """By hidden effect and size."""
    mark = {"name": "name", "group": "group", "missed": "-", "unknown": "unknown", "wrong": "**wrong**"}
    by: dict[str, dict[float, str]] = {}
    for r in rows:
        if "error" not in r and r["kind"] in ("one", "outside"):
            right = r["right"]
            extra = f" ({', '.join(r['main'][:2])})" if right in ("wrong", "unknown") and r["main"] else ""
            by.setdefault(r["hidden"][0], {})[r["scales"][0]] = mark.get(right, right) + extra
    return by


def _smallest(rows: list[Row]) -> str:
    """The smallest size at which each effect of the catalogue was named."""
    listed: dict[float, list[str]] = {}
    for effect, found in _named_by_size(rows).items():
        named = [x for x in found if found[x].split(",")[0] in ("name", "group")]
        if named:
            listed.setdefault(min(named), []).append(effect)
    table = _table(("size", "effects"), [(f"{size:g}", ", ".join(listed[size])) for size in sorted(listed)])
    return f"## The smallest size that was named\n\nOf 0.03, 0.1, 0.25, 0.5, 1 and 2 typical sizes:\n\n{table}"


def _by_effect(rows: list[Row]) -> str:
    listed = []
    for effect, found in _named_by_size(rows).items():
        sizes = sorted(found)
        named = [x for x in sizes if found[x].split(",")[0] in ("name", "group")]
        smallest = f"{min(named):g}" if named else "-"
        listed.append((effect, ", ".join(f"{x:g}: {found[x]}" for x in sizes), smallest))
    table = _table(("hidden", "size: outcome (what was named)", "smallest named"), listed)
    return f"## By effect\n\n{table}"


def _listed(rows: list[Row]) -> str:
    out = []
    for kind, title in (("two", "Two at once"), ("none", "Nothing hidden"), ("outside", "Not in the catalogue")):
        listed = [
            (
                r["case"],
                r["right"],
                r["verdict"],
                ", ".join(r["effects"]) or "-",
                r.get("swing") or ", ".join(r.get("depends") or []) or "-",
            )
            for r in rows
            if r["kind"] == kind and "error" not in r
        ]
        out.append(f"## {title}\n\n" + _table(("flight", "outcome", "verdict", "named", "residual"), listed))
    return "\n".join(out)


def _calibration(rows: list[Row]) -> str:
    listed = [(a, str(n), f"{100 * p:.0f} %", f"{100 * q:.0f} %") for a, n, p, q in stated.bins(rows)]
    table = _table(("stated", "effects named", "stated, mean", "right"), listed)
    return (
        "## Confidence\n\nThe probability that `explain` states for each effect it names, against how often it, or one "
        f"of its group, was there. Nothing was fitted to these flights:\n\n{table}"
    )


def _sizes() -> str:
    listed = [(name, f"{cls.size:g} {cls.unit}", " or ".join(cls.answers)) for name, cls in HIDDEN.items()]
    return "## Sizes\n\n" + _table(("hidden", "typical size (1)", "accepted answers"), listed)
