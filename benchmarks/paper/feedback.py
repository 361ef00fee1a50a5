"""Cut-offs of INDI and L1, on tuning flights: the figure-8 of vehicles 1 and 2, without integral.

Bus delays of 10 and 25 ms. Of each law the lowest cut-off is taken that is within a tenth of the least error at
10 ms, among those that lose control on no tuning flight. The other tables fly it on vehicle 0 and on the independent
engine, with other seeds. INDI is told the lag that training logs of vehicle 0 showed under the same delay, or none.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from benchmarks.harm.parts import CONDITIONS, FEEDBACK, SETTLE, Condition, fly, truth
from benchmarks.paper.flying import attitude_errors
from benchmarks.paper.running import Output, Report, in_parallel, main, table
from wrenchgap.compensate import L1
from wrenchgap.learn.identify.observer import OBSERVER
from wrenchgap.plant.trajectory import named

VEHICLES, LENGTH = (1, 2), 9.0
SEED = 160
"""Of the tuning flights; the tables have 50 and 60, and those of the engine."""
DELAYS: dict[str, tuple[Condition, float]] = {"10 ms": (CONDITIONS[0], 0.07), "25 ms": (CONDITIONS[3], 0.08)}
"""Bus delay, and the lag [s] that the training log shows there (`benchmarks.harm.parts`)."""
CUTOFFS = {
    "INDI, told the lag": (4.0, 8.0, 16.0, 31.0),
    "INDI, told no lag": (0.5, 1.0, 2.0, 4.0),
    "L1": (0.5, 1.0, 2.0, 4.0, 8.0),
    "L1, A_s = -5 / s": (2.0,),
    "L1, A_s = -20 / s": (2.0,),
}
LAWS = FEEDBACK | {
    "L1, A_s = -5 / s": lambda body, dt, hz, lag: L1(body, dt, hz, gain=5.0),
    "L1, A_s = -20 / s": lambda body, dt, hz, lag: L1(body, dt, hz, gain=20.0),
}
ENOUGH = OBSERVER.enough
"""Ratio to the least error, as for the observer's bandwidth: what is gained above it is noise's."""
Case = tuple[str, float]
"""A law and its cut-off [Hz]."""


def one(case: Case, length: float) -> dict[str, float | None]:
    """Mean over vehicles and axes of |e_R| [rad] by delay; None where control was lost on one of them."""
    law, hz = case
    found: dict[str, float | None] = {}
    for delay, (condition, lag) in DELAYS.items():
        errors = []
        for number in VEHICLES:
            plant = truth(condition, number)
            helper = LAWS[law](plant.believed.vehicle, 1.0 / plant.believed.controller.rate_hz, hz, lag)
            flown = fly(plant, named("figure8", length), SEED + number, condition, helper)
            time, error = attitude_errors(flown)
            lost = any("control was lost" in str(note) for note in flown.notes)
            errors.append(np.nan if lost else float(np.abs(error[time > SETTLE]).mean()))
        found[delay] = None if np.isnan(errors).any() else float(np.mean(errors))
    return found


def run(quick: bool, out: Output, report: Report) -> dict[str, Any]:
    """All laws and cut-offs."""
    del out
    cases = [(law, hz) for law, cutoffs in CUTOFFS.items() for hz in (cutoffs[:1] if quick else cutoffs)]
    found = in_parallel(partial(one, length=4.0 if quick else LENGTH), cases, report, "figure-8s")
    rows = [{"law": law, "hz": hz, **errors} for (law, hz), errors in zip(cases, found, strict=True)]
    return {"rows": rows, "chosen": {law: chosen(rows, law) for law in FEEDBACK}}


def chosen(rows: list[dict[str, Any]], law: str) -> float | None:
    """The lowest cut-off [Hz] of a law within `ENOUGH` of the least error, of those that keep control at all delays."""
    first = next(iter(DELAYS))
    safe = {r["hz"]: r[first] for r in rows if r["law"] == law and all(r[delay] is not None for delay in DELAYS)}
    return min((hz for hz, error in safe.items() if error <= ENOUGH * min(safe.values())), default=None)


def tables(body: dict[str, Any]) -> str:
    """Errors by law, cut-off and delay."""
    head = ["tuning flights: mean abs(e_R) [mrad]", "cut-off [Hz]", *(f"{delay} of delay" for delay in DELAYS), "taken"]
    rows = []
    for row in body["rows"]:
        errors = ["lost" if row[delay] is None else f"{1e3 * row[delay]:.1f}" for delay in DELAYS]
        taken = "x" if body["chosen"].get(row["law"]) == row["hz"] else ""
        rows.append([row["law"], f"{row['hz']:g}", *errors, taken])
    return table(head, rows)


if __name__ == "__main__":
    main(("feedback",))
