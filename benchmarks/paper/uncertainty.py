"""A 40 deg roll step from hover with a GP that has seen smooth pitching only, uncertainty filter on and off.

A hundred flights: vehicles that differ in their mismatch, and sensor noise. For each vehicle the GP is learnt from its
own smooth (unexcited) pitch flight, as the paper says of its training data. Besides the paper's zero mean, which
returns to zero off the data, a GP with a linear mean, which does not, and so shows what the filter is for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.paper import methods as m
from benchmarks.paper.figures import step_figure
from benchmarks.paper.flying import Flown, fly
from benchmarks.paper.methods import Knowledge
from benchmarks.paper.plants import vehicle
from benchmarks.paper.prediction import knowledge
from benchmarks.paper.running import Output, Report, in_parallel, main, table
from compensate import Compensator
from plant.trajectory import Step

Array = NDArray[np.float64]

VEHICLES, NOISES = 20, 5
TRAINING, LENGTH, MOMENT = 40.0, 4.5, 1.0
LATE = 3.5
"""From here on [s] the step should be over."""
WORSE = 1.5
"""Ratio of the late error to that without compensation above which the compensation did harm."""
NOTHING = "no compensation"
Build = Callable[[Knowledge], Any]


def _gp(mean: str, on: bool, bounded: bool) -> Build:
    def build(known: Knowledge) -> Compensator:
        bound = None if bounded else (np.inf,) * 6
        settings = replace(known.settings, filter_uncertain=on, correction_max=bound)
        return Compensator(known.gp(mean=mean), settings)

    return build


VARIANTS: dict[str, Build | None] = {
    NOTHING: None,
    "GP, zero mean, filter on": _gp("zero", True, True),
    "GP, zero mean, filter off": _gp("zero", False, True),
    "GP, zero mean, filter off, unbounded": _gp("zero", False, False),
    "GP, linear mean, filter on": _gp("linear", True, True),
    "GP, linear mean, filter off": _gp("linear", False, True),
    "GP, linear mean, filter off, unbounded": _gp("linear", False, False),
    m.LINEAR.name: m.LINEAR.build,
    m.OBSERVER.name: m.OBSERVER.build,
}
SHOWN = (NOTHING, "GP, zero mean, filter on", "GP, linear mean, filter on", "GP, linear mean, filter off, unbounded")


def one(number: int, noises: int, training: float) -> dict[str, Any]:
    """All variants on one vehicle, and what the figure shows of the first."""
    known, plant = knowledge(300 + number, number, training, excitation=0.0), vehicle(number)
    found: dict[str, Any] = {name: [] for name in VARIANTS}
    traces = {}
    for noise in range(noises):
        for name, build in VARIANTS.items():
            compensator = None if build is None else build(known)
            flown = fly(plant, Step(LENGTH, moment=MOMENT), 1000 * number + noise, compensator=compensator)
            found[name].append(_outcome(flown))
            if number == noise == 0 and name in SHOWN:
                threshold = getattr(getattr(compensator, "uncertainty", None), "threshold", np.nan)
                traces[name] = _traces(flown, threshold)
    return {"outcomes": found, "traces": traces}


def _outcome(flown: Flown) -> dict[str, float]:
    late = np.linalg.norm(flown.error[flown.time > LATE], axis=1)
    before, after = (
        max((r.sigma for r in flown.results[rows]), default=0.0) for rows in (slice(100, 200), slice(200, None))
    )
    return {
        "lost": float(flown.lost),
        "late": float(late.mean()) if not flown.lost and len(late) else np.inf,
        "largest": float(np.linalg.norm(flown.error, axis=1).max()),
        "sigma_before": before,
        "sigma_after": after,
        "correction": max((float(np.abs(r.correction).max()) for r in flown.results), default=0.0),
    }


def _traces(flown: Flown, threshold: float) -> dict[str, Any]:
    found: dict[str, Any] = {"pose_time": flown.time, "error": flown.error}
    if flown.results:
        found["time"] = np.arange(len(flown.results)) * float(flown.flight.commanded.time[1])  # type: ignore[union-attr]
        found["correction"] = np.array([r.correction[3:] for r in flown.results])
        found["sigma"] = np.array([r.sigma for r in flown.results])
        found["threshold"] = threshold
    return found


def run(quick: bool, out: Output, report: Report) -> dict[str, Any]:
    """Losses and late errors of every variant, and the paper's plots."""
    vehicles, noises, training = (1, 1, 20.0) if quick else (VEHICLES, NOISES, TRAINING)
    parts = in_parallel(partial(one, noises=noises, training=training), range(vehicles), report, "roll steps")
    step_figure(out.image("uncertainty"), parts[0]["traces"])
    plain = [o for p in parts for o in p["outcomes"][NOTHING]]
    rows = {}
    for name in VARIANTS:
        outcomes = [o for p in parts for o in p["outcomes"][name]]
        rows[name] = {
            "lost": int(sum(o["lost"] for o in outcomes)),
            "worse": sum(o["late"] > WORSE * p["late"] for o, p in zip(outcomes, plain, strict=True)),
            **{k: float(np.median([o[k] for o in outcomes])) for k in outcomes[0] if k != "lost"},
            "late_most": float(np.max([o["late"] for o in outcomes])),
            "correction_most": float(np.max([o["correction"] for o in outcomes])),
        }
    return {"flights": len(plain), "vehicles": vehicles, "rows": rows}


def tables(body: dict[str, Any]) -> str:
    """Losses of control and late errors."""
    count = body["flights"]
    head = [
        f"{count} roll steps",
        "lost",
        f"late error > {WORSE:g} x that without",
        "late error, median [rad]",
        "largest late error [rad]",
        "largest correction [Nm]",
        "sigma before, after the step [Nm]",
    ]
    rows = []
    for name, row in body["rows"].items():
        sigma = f"{row['sigma_before']:.2f}, {row['sigma_after']:.2f}" if row["sigma_after"] else "-"
        most = "-" if row["late_most"] is None else f"{row['late_most']:.2f}"
        bound = f"{row['correction_most']:.1f}" if row["correction_most"] else "-"
        late = "-" if row["late"] is None else f"{row['late']:.3f}"
        rows.append([name, str(row["lost"]), str(row["worse"]), late, most, bound, sigma])
    return table(head, rows)


if __name__ == "__main__":
    main(("uncertainty",))
