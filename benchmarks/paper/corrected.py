"""The roll step of `benchmarks.paper.uncertainty` after smooth training, with a process that `learn` has corrected.

One flight of each of the twenty vehicles, kept as they come (`--missing` goes on). "Corrected" is the process that does
not look at what the flight does not show, with the gate on; "combined" the same with an observer. Beside them what
learns nothing: our observer, INDI and L1, whose cut-offs were chosen on the figure-8 of vehicles 1 and 2.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.signal import detrend

from benchmarks.paper.flying import Flown, fly
from benchmarks.paper.methods import FEEDBACK, OBSERVER, Knowledge
from benchmarks.paper.plants import vehicle
from benchmarks.paper.prediction import knowledge
from benchmarks.paper.running import table
from wrenchgap.compensate import Compensator
from wrenchgap.plant.trajectory import Step
from wrenchgap.replay.compensation.compensators import combined

NOTHING = "no compensation"
CORRECTED = "GP, smooth training, corrected"
COMBINED = "combined: that GP and an observer"
SWINGING = 0.02
VARIANTS: dict[str, Callable[[Knowledge], Any]] = {
    NOTHING: lambda known: None,
    CORRECTED: lambda known: Compensator(known.gp(guarded=True), known.settings),
    COMBINED: lambda known: combined(known.gp(guarded=True), known.model, known.settings),
} | {row.name: row.build for row in (OBSERVER, *FEEDBACK) if row.build is not None}
Outcomes = dict[str, dict[str, float]]


def one(number: int, training: float, length: float, moment: float, late: float, kept: Outcomes) -> Outcomes:
    """Outcome of every variant on one vehicle: lost, late error [rad], swing [rad]; as `kept` where it has flown."""
    known = knowledge(300 + number, number, training, 0.0)
    found = dict(kept)
    for name, build in VARIANTS.items():
        if name in kept:
            continue
        flown = fly(vehicle(number), Step(length, moment=moment), 1000 * number, compensator=build(known))
        found[name] = outcome(flown, late)
    return found


def outcome(flown: Flown, late: float) -> dict[str, float]:
    """Of a flight; what is lost has no other number."""
    after = flown.error[flown.time > late]
    if flown.lost or len(after) < 2:
        return {"lost": 1.0, "late": float("inf"), "swing": float("inf")}
    size = float(np.linalg.norm(after, axis=1).mean())
    return {"lost": 0.0, "late": size, "swing": float(detrend(after, axis=0).std(axis=0).max())}


def tables(vehicles: dict[str, Outcomes]) -> str:
    """Losses, swings and late errors of the vehicles that have flown."""
    head = [
        f"{len(vehicles)} roll steps, a vehicle each",
        "lost",
        f"swinging by more than {1e3 * SWINGING:.0f} mrad",
        "largest late error, to that without",
        "late error, median [rad]",
    ]
    rows = []
    for name in VARIANTS:
        some = [v[name] for v in vehicles.values()]
        flown = [o["late"] for o in some if not o["lost"]]
        ratios = [v[name]["late"] / v[NOTHING]["late"] for v in vehicles.values() if not v[name]["lost"]]
        swinging = sum(not o["lost"] and o["swing"] > SWINGING for o in some)
        lost = int(sum(o["lost"] for o in some))
        rows.append([name, str(lost), str(swinging), f"{max(ratios, default=0):.2f}", f"{np.median(flown):.3f}"])
    return table(head, rows)
