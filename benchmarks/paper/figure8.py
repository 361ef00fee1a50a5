"""Figure-8 to 63 deg, 200 points, no integral: on our own plant and on the independent engine of hidden_effects.

Train: tilts to 70 deg about eight azimuths with excitation. Reported is mean |e_R| after the start.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from benchmarks.compensation_in_the_loop import attitude_error
from benchmarks.hidden_effects import engine
from benchmarks.paper import methods as m
from benchmarks.paper.figures import error_figure
from benchmarks.paper.flying import as_log, fly
from benchmarks.paper.methods import Knowledge, Method
from benchmarks.paper.plants import Plant, vehicle
from benchmarks.paper.running import Keep, Output, Report, change, falls, in_parallel, main, mrad, percent, table
from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.opening import opened
from wrenchgap.plant.model_file import load
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory import named

POINTS = 200
TRAINING, LENGTH, SETTLE = 80.0, 40.0, 3.0
PAPER = (0.945, 0.879, 0.837)
ROWS = (*m.EVERYWHERE, m.ON_A_LINE, m.SPARSE, m.PAST, m.LEADING_BOTH, m.JUDGED, m.TOGETHER, m.ALL_TOGETHER, *m.FEEDBACK)
ENGINE_ROWS = (*m.EVERYWHERE, m.ON_A_LINE, m.JUDGED, m.TOGETHER, m.ALL_TOGETHER, *m.FEEDBACK)
QUICK = (m.PD, m.LINEAR, m.GP)
HIDDEN = (
    ("com_offset", "tilt_offset", "weak_rotor"),
    ("com_offset", "wake", "payload"),
    ("tilt_offset", "coaxial_loss", "tether"),
)
"""What the engine's vehicles hide, one mix per vehicle, at the benchmark's middling sizes; servo lag they all have."""


def knowledge(seconds: float = TRAINING) -> Knowledge:
    """What is learnt from tilts about many axes, flown without the integral."""
    plant = vehicle()
    flown = fly(plant, named("multi_axis", seconds, 1.0, 0), 20, integral=False, name="training")
    return Knowledge(plant.believed, (as_log(flown, plant),), POINTS)


def own(method: Method, known: Knowledge | None, length: float) -> tuple[Array, Array]:
    """Times and e_R of a figure-8 on our plant; without the mismatch where there is no knowledge."""
    plant = vehicle()
    plant = plant if known is not None else Plant(plant.believed, plant.believed)
    compensator = None if method.build is None or known is None else method.build(known)
    flown = fly(plant, named("figure8", length), 60, compensator=compensator, integral=method.integral is True)
    return flown.time, flown.error


def engine_knowledge(effects: Sequence[str], seed: int) -> tuple[Knowledge, Any]:
    """What is learnt from the engine's training flight, and what was hidden."""
    flight, truth = engine.fly(effects, None, "train", seed=seed, integral=0.0)
    model = load("tilt_hexarotor")
    return Knowledge(model, (opened(flight, model),), POINTS), truth.parameters


def on_engine(index: int, quick: bool, only: Sequence[Method] | None = None) -> dict[str, Array]:
    """Mean |e_R| (3,) by method on one vehicle of the engine."""
    effects, rows = HIDDEN[index], only or (QUICK if quick else ENGINE_ROWS)
    known, hidden = engine_knowledge(effects, 1 + index)
    found = {}
    for method in rows:
        compensator = None if method.build is None else method.build(known)

        def compensate(wrench: Array, row: Array, compensator: Any = compensator) -> Array:
            state = State(np.zeros(1), row[None, :3], row[None, 3:7], row[None, 7:10], row[None, 10:13])
            return np.asarray(compensator.step(wrench, state).wrench_cmd)

        _, truth = engine.fly(
            effects,
            [hidden[e] for e in effects],
            "figure8",
            12.0 if quick else 20.0,
            seed=101 + index,
            integral=0.3 if method.integral else 0.0,
            compensate=None if compensator is None else compensate,
        )
        found[method.name] = attitude_error(truth)
    return found


def run(quick: bool, out: Output, report: Report) -> dict[str, Any]:
    """Both plants, and the figure of ours."""
    report(0.0, "training")
    known = knowledge(40.0 if quick else TRAINING)
    rows, length = (QUICK, 15.0) if quick else (ROWS, LENGTH)
    if not quick:
        report(0.0, "explaining")
        _ = known.physics
    flights = in_parallel(partial(own, known=known, length=length), rows, report, "our plant")
    ideal = own(m.PD, None, length)
    shown = {r.name: f for r, f in zip(rows, flights, strict=True)}
    error_figure(out.image("figure8"), {n: shown[n] for n in (m.PD.name, m.LINEAR.name, m.GP.name)})
    vehicles = range(1 if quick else len(HIDDEN))
    others = in_parallel(partial(on_engine, quick=quick), vehicles, report, "independent engine")
    return {
        "points": POINTS,
        "own": {n: np.abs(e[t > SETTLE]).mean(axis=0) for n, (t, e) in shown.items()}
        | {"no mismatch (floor)": np.abs(ideal[1][ideal[0] > SETTLE]).mean(axis=0)},
        "named_by_explain": [] if quick else list(known.explanation.effects),
        "engine": [{"hidden": list(HIDDEN[k]), "rows": o} for k, o in zip(vehicles, others, strict=True)],
    }


def missing(kept: dict[str, Any], report: Report, keep: Keep) -> None:
    """The rows that the results lack on both plants, one after the other, each kept at once."""
    rows = [r for r in ROWS if r.name not in kept["own"]]
    known = knowledge() if rows else None
    for k, row in enumerate(rows):
        report(k / len(rows), f"our plant: {row.name}")
        time, error = own(row, known, LENGTH)
        kept["own"][row.name] = np.abs(error[time > SETTLE]).mean(axis=0)
        keep(kept)
    for index, vehicle_rows in enumerate(v["rows"] for v in kept["engine"]):
        only = [r for r in ENGINE_ROWS if r.name not in vehicle_rows]
        report(index / len(HIDDEN), f"engine: vehicle {index}")
        vehicle_rows |= on_engine(index, quick=False, only=only) if only else {}
        keep(kept)


def tables(body: dict[str, Any]) -> str:
    """Our plant, then the engine's vehicles."""
    base = body["own"][m.PD.name]
    rows = [["paper, GP", "-", percent(PAPER)]]
    for name, error in body["own"].items():
        rows.append([name, mrad(error), "-" if name == m.PD.name else change(error, base)])
    parts = [table(["our plant, mean abs(e_R) x / y / z [mrad]", "error", "change [%]"], rows)]
    vehicles = body["engine"]
    head = ["independent engine", *(" + ".join(v["hidden"]) for v in vehicles), "mean change [%]"]
    rows = []
    for name in (n for n in vehicles[0]["rows"] if all(n in v["rows"] for v in vehicles)):
        mean = float(np.mean([falls(v["rows"][name], v["rows"][m.PD.name]) for v in vehicles]))
        errors = [mrad(v["rows"][name]) for v in vehicles]
        rows.append([name, *errors, "-" if name == m.PD.name else f"{-100 * mean:+.1f}"])
    parts.append(table(head, rows))
    return "\n\n".join(parts)


if __name__ == "__main__":
    main(("figure8",))
