"""docs/changed-benchmark.md from the rows: sizes that are found, false alarms, coverage, seasons."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.changed.fleet import BUILT, GRADED, PUBLISHED, SCATTER, SECONDS, VEHICLES
from benchmarks.changed.seasons import FLIGHTS, LOADING, MOVED, ROTOR, WORN

Row = dict[str, Any]
SIGMAS = 1.96
STEEP = np.linspace(1.0, 8.0, 15)
"""Slopes of the logistic curve over the logarithm of the size that are believed, alike."""


def page(rows: Sequence[Row], seasons: Sequence[Row], planned: int) -> str:
    """The whole page; `planned` comparisons are a full run."""
    return "".join(
        (head(), extent(len(rows), planned), alarms(rows), sizes(rows), coverage(rows), seasons_table(seasons))
    )


def head() -> str:
    """What was flown."""
    return f"""# Graded changes: what `changed` and `trend` find

Made by `python -m benchmarks.changed --rows docs/changed-benchmark.jsonl --page docs/changed-benchmark.md` (first seed
{PUBLISHED}; nobody tunes on these flights). RotorPy flies the quadrotors and the octorotor, MuJoCo the tilting
hexarotor; neither shares a formula with the fit. Flights of {SECONDS:g} s, all axes excited, each with another
trajectory. Three healthy flights are the baseline of one suspect; the whole catalogue is tried.

The model is wrong in all flights: {100 * (1 - BUILT["thrust"]):.0f} % too much thrust, centre of mass
{100 * BUILT["place"]:.0f} % of the arm off, no motor lag ({1e3 * BUILT["lag"]:.0f} ms), no rotor drag. No two flights
are alike (one standard deviation): thrust of each rotor {100 * SCATTER["rotor"]:g} %, of all rotors
{100 * SCATTER["air"]:g} %, centre of mass {100 * SCATTER["place"]:g} % of the arm forward and to the left, mounting of
the IMU {SCATTER["mount_deg"]:g} deg about each axis, wind {SCATTER["wind"]:g} m/s in each direction.
"""


def extent(count: int, planned: int) -> str:
    """How much of it was run."""
    if count >= planned:
        return f"\nRun in full: {count} comparisons.\n"
    return (
        f"\n**Not run in full: {count} of {planned} comparisons.** What stands below is of these alone"
        f"{', too few for rates, thresholds or coverage' if count < planned // 2 else ''}.\n"
    )


def alarms(rows: Sequence[Row]) -> str:
    """Healthy against healthy, and wrong firm names."""
    lines = ["\n## Healthy flights against healthy flights\n", "| vehicle | comparisons | something changed | odd |"]
    lines.append("|---|---|---|---|")
    for vehicle in VEHICLES:
        mine = [r for r in rows if r["vehicle"] == vehicle and r["effect"] == "none"]
        if mine:
            alarm = sum(r["verdict"] != "nothing" for r in mine)
            odd = len({(r["baseline"], name) for r in mine for name in r["odd"]})
            lines.append(f"| {vehicle} | {len(mine)} | {alarm} | {odd} |")
    changed = [r for r in rows if r["effect"] != "none"]
    wrong = [r for r in rows if r["wrong"]]
    said = "; ".join(f"{r['case']}: {', '.join(r['wrong'])}" for r in wrong)
    lines.append("\n*odd*: healthy flights of a baseline that were called so; they are healthy as well.")
    lines.append(
        f"\nFirm names that are wrong: on {len(wrong)} of {len(rows)} flights ({len(changed)} of them changed)"
        f"{': ' + said if said else ''}.\n"
    )
    return "\n".join(lines)


def sizes(rows: Sequence[Row]) -> str:
    """Which sizes are found."""
    if all(r["effect"] == "none" for r in rows):
        return ""
    lines = ["\n## Smallest change that is found\n"]
    lines.append(
        "Found: something changed, and a set of the heaviest class says what. 50 % and 90 %: sizes on the logistic\n"
        "curve over the logarithm of the size, mean over slopes from 1 to 8; few flights of each size are behind it.\n"
    )
    lines.append("| vehicle | changed | unit | found, by size | 50 % | 90 % |")
    lines.append("|---|---|---|---|---|---|")
    for vehicle in VEHICLES:
        for effect, unit, graded in GRADED[vehicle]:
            mine = [r for r in rows if r["vehicle"] == vehicle and r["effect"] == effect]
            if not mine:
                continue
            counts = []
            for size in graded:
                some = [r["found"] for r in mine if r["size"] == size]
                counts.append(f"{shown(size, unit)}: {sum(some)}/{len(some)}")
            half, most = thresholds([r["size"] for r in mine], [r["found"] for r in mine])
            said = [word(s, max(graded), unit) for s in (half, most)]
            lines.append(f"| {vehicle} | {effect} | {unit} | {', '.join(counts)} | {said[0]} | {said[1]} |")
    return "\n".join(lines) + "\n"


def shown(size: float, unit: str) -> str:
    """A size as it is read: shares in per cent."""
    return f"{100 * size:.3g} %" if unit.startswith("of ") else f"{size:.3g}"


def word(size: float, largest: float, unit: str) -> str:
    """A threshold, or that it is beyond what was flown."""
    return shown(size, unit) if size <= largest else f"> {shown(largest, unit)}"


def thresholds(sizes_flown: Sequence[float], found: Sequence[bool]) -> tuple[float, float]:
    """Sizes that are found in half and in nine tenths of the flights: posterior means over a grid of curves."""
    x, hit = np.log(np.array(sizes_flown)), np.array(found, dtype=bool)
    middle = np.linspace(x.min() - 1.5, x.max() + 1.5, 121)
    arm = STEEP[None, :, None] * (x - middle[:, None, None])
    log = -np.logaddexp(0.0, np.where(hit, -arm, arm)).sum(axis=2)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    far = middle[:, None] + np.log(9.0) / STEEP
    return float(np.exp((weight * middle[:, None]).sum())), float(np.exp((weight * far).sum()))


def coverage(rows: Sequence[Row]) -> str:
    """How often the stated intervals hold the truth."""
    pulls = [
        (row["answer"][name][0] - true) / row["answer"][name][1]
        for row in rows
        if row["found"]
        for name, true in row["truth"].items()
        if name in row["answer"]
    ]
    inside = sum(abs(p) < SIGMAS for p in pulls)
    if not pulls:
        return ""
    low, high = interval(inside, len(pulls))
    return (
        "\n## Coverage\n\nOf the parameters of what was hidden, where it was found, the interval of "
        f"+-{SIGMAS} standard deviations (scatter and noise together) holds the truth in {inside} of {len(pulls)} "
        f"({100 * inside / len(pulls):.0f} %; 95 % interval of that share {100 * low:.0f} to {100 * high:.0f} %).\n"
    )


def interval(hits: int, count: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share."""
    z, p = SIGMAS, hits / count
    centre, half = p + z * z / (2 * count), z * np.sqrt(p * (1 - p) / count + z * z / (4 * count**2))
    return float((centre - half) / (1 + z * z / count)), float((centre + half) / (1 + z * z / count))


def seasons_table(seasons: Sequence[Row]) -> str:
    """What `trend` says of seasons."""
    if not seasons:
        return ""
    lines = [f"\n## Seasons: `trend` over {FLIGHTS} flights of the hexarotor\n"]
    lines.append(
        f"Scatter between flights {1e3 * LOADING:g} mm of the centre of mass and {100 * ROTOR:g} % of one rotor's "
        f"thrust. The centre\nof mass moves before flight {MOVED + 1}; rotor {WORN} wears in proportion to the\n"
        "flights.\n"
    )
    lines.append("| what happens | size | seasons | found | at the right flight | another change claimed |")
    lines.append("|---|---|---|---|---|---|")
    for kind, size in dict.fromkeys((s["kind"], s["size"]) for s in seasons):
        mine = [s for s in seasons if (s["kind"], s["size"]) == (kind, size)]
        right = {"moved": "com_offset y", "wearing": f"rotor_thrust rotor_{WORN}"}.get(kind, "")
        hits = [next((p for p in s["said"] if p["parameter"] == right), None) for s in mine]
        steps = [h for h in hits if h and any(step[0] == MOVED + 1 for step in h["steps"])]
        others = sum(any(p["parameter"] != right for p in s["said"]) for s in mine)
        unit = {"moved": f"{1e3 * size:g} mm", "wearing": f"{100 * size:g} % at the end"}.get(kind, "-")
        found = "-" if kind == "none" else str(sum(h is not None for h in hits))
        at = str(len(steps)) if kind == "moved" else "-"
        lines.append(f"| {kind} | {unit} | {len(mine)} | {found} | {at} | {others} |")
    return "\n".join(lines) + "\n"
