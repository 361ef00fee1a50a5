"""A 40 deg roll step from hover with a GP that has seen pitching only, uncertainty filter on and off.

A hundred flights: vehicles that differ in their mismatch, and sensor noise. For each vehicle a GP is learnt from its
own pitch flight with excitation, another from one without ("smooth", as the paper says of the data of this experiment).
Besides the paper's zero mean, which returns to zero off the data, a GP with a linear mean, which does not, and so
shows what the filter is for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.signal import detrend

from benchmarks.paper import corrected
from benchmarks.paper.figures import step_figure
from benchmarks.paper.flying import Flown, fly
from benchmarks.paper.methods import Knowledge
from benchmarks.paper.plants import vehicle
from benchmarks.paper.prediction import knowledge
from benchmarks.paper.running import Keep, Output, Report, in_parallel, main, table
from wrenchgap.compensate import Compensator
from wrenchgap.plant.trajectory import Step

VEHICLES, NOISES = 20, 5
TRAINING, LENGTH, MOMENT = 30.0, 5.0, 1.5
"""Lengths of the flights and the time of the step [s]."""
LATE = 3.8
"""From here on [s] the step should be over."""
WORSE = 1.5
"""Ratio of the late error to that without compensation above which the compensation did harm."""
SWINGING = 0.02
"""Standard deviation of the late error [rad], its trend aside, above which a flight counts as swinging."""
NOTHING = "no compensation"
Learnt = dict[str, Knowledge]
"""What is known from the excited and from the smooth training flight."""
Build = Callable[[Learnt], Any]


def _gp(training: str, mean: str, words: str) -> Build:
    """With filter and bounds, without the filter, or without both."""

    def build(learnt: Learnt) -> Compensator:
        known = learnt[training]
        settings = replace(known.settings, filter_uncertain=words == ON)
        if words == UNBOUNDED:
            settings = replace(settings, correction_max=(np.inf,) * 6)
        return Compensator(known.gp(mean=mean), settings)

    return build


ON, OFF, UNBOUNDED = "filter on", "filter off", "filter off, unbounded"
"""The paper's correction is unbounded, ours ends at three times the largest mismatch seen."""
GPS = (("excited", "zero"), ("smooth", "zero"), ("smooth", "linear"))
VARIANTS: dict[str, Build | None] = {NOTHING: None} | {
    f"GP, {training} training, {mean} mean, {words}": _gp(training, mean, words)
    for training, mean in GPS
    for words in ((ON, OFF, UNBOUNDED) if mean == "linear" else (ON, UNBOUNDED))
}
SHOWN = tuple(name for name in VARIANTS if name == NOTHING or "zero" in name or UNBOUNDED in name)


def one(number: int, noises: int, training: float) -> dict[str, Any]:
    """All variants on one vehicle, and what the figure shows of the first."""
    learnt = {
        name: knowledge(300 + number, number, training, excitation)
        for name, excitation in (("excited", 1.0), ("smooth", 0.0))
    }
    plant = vehicle(number)
    found: dict[str, Any] = {name: [] for name in VARIANTS}
    traces = {}
    for noise in range(noises):
        for name, build in VARIANTS.items():
            compensator = None if build is None else build(learnt)
            flown = fly(plant, Step(LENGTH, moment=MOMENT), 1000 * number + noise, compensator=compensator)
            found[name].append(_outcome(flown))
            if number == noise == 0 and name in SHOWN:
                threshold = getattr(getattr(compensator, "uncertainty", None), "threshold", np.nan)
                traces[name] = _traces(flown, threshold)
    return {"outcomes": found, "traces": traces}


def _outcome(flown: Flown) -> dict[str, float]:
    after = flown.error[flown.time > LATE]
    late = np.linalg.norm(after, axis=1)
    step = round(MOMENT * len(flown.results) / LENGTH)
    before, highest = (
        max((r.sigma for r in flown.results[rows]), default=0.0) for rows in (slice(step // 2, step), slice(step, None))
    )
    return {
        "lost": float(flown.lost),
        "late": float(late.mean()) if not flown.lost and len(late) else np.inf,
        "swing": float(detrend(after, axis=0).std(axis=0).max()) if len(after) > 1 else np.inf,
        "sigma_before": before,
        "sigma_after": highest,
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
            "swinging": sum(o["swing"] > SWINGING for o in outcomes),
            "late_most": float(np.max([o["late"] for o in outcomes])),
            "correction_most": float(np.max([o["correction"] for o in outcomes])),
        }
    return {"flights": len(plain), "vehicles": vehicles, "rows": rows}


def missing(kept: dict[str, Any], report: Report, keep: Keep) -> None:
    """The flights after smooth training or by feedback that the results lack, each vehicle kept at once."""
    flown = kept.setdefault("corrected", {})
    for number in range(VEHICLES):
        before = flown.get(str(number), {})
        if set(corrected.VARIANTS) - set(before):
            report(number / VEHICLES, f"vehicle {number}")
            flown[str(number)] = corrected.one(number, TRAINING, LENGTH, MOMENT, LATE, before)
            keep(kept)


def tables(body: dict[str, Any]) -> str:
    """Losses of control and late errors; then those with a corrected smooth training."""
    count = body["flights"]
    head = [
        f"{count} roll steps",
        "lost",
        f"late error > {WORSE:g} x that without",
        f"swinging by more than {1e3 * SWINGING:.0f} mrad",
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
        rows.append([name, str(row["lost"]), str(row["worse"]), str(row["swinging"]), late, most, bound, sigma])
    after = corrected.tables(body["corrected"]) if body.get("corrected") else ""
    return table(head, rows) + (f"\n\n{after}" if after else "")


if __name__ == "__main__":
    main(("uncertainty",))
