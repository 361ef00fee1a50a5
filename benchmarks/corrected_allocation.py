"""What a corrected allocation gains in the loop of an engine that shares no code with it, alone and with compensation.

For each hidden effect and seed: fly `train` with the PD controller, write the log, name what is missing (`explain`) and
fit it (`add`), as a user would. Then fly a figure-8 with another seed, allocated nominally, by the corrected
allocation, nominally with a torque GP learnt from `train`, and by the corrected allocation with a torque GP learnt from
a `train` that was flown with it (from the commanded wrench: the model that learns has no rotors). "ideal" is the
nominal allocation of the vehicle without the effect: the floor. Reported are RMS of the attitude error |e_R| and of the
position error after `SETTLE` seconds.

    python -m benchmarks.corrected_allocation --seed 21 22 23 --json rows.json --page
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.compensation_in_the_loop import SETTLE
from benchmarks.hidden_effects.airframe import C_F, SPEED_MAX
from benchmarks.hidden_effects.engine import CONTROL_RATE, Allocate, Compensate, Truth, fly
from benchmarks.hidden_effects.trajectories import reference
from benchmarks.pages import Row, renew
from wrenchgap.compensate import Compensator, Settings
from wrenchgap.compensate.allocator import Allocator
from wrenchgap.flight import so3, write
from wrenchgap.flight.errors import WrenchgapError
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.learn.data.opening import OpenFlight, open_flight
from wrenchgap.learn.identify.learning import TORQUE, learn_process
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.plant.allocation_problem import allocation_problem
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import load
from wrenchgap.replay import api
from wrenchgap.replay.compensation.compensators import all_refused

PAGE = Path(__file__).parents[1] / "docs" / "effectiveness.md"
EFFECTS = ("weak_rotor", "tilt_offset", "com_offset", "coaxial_loss", "wake", "servo_lag")
RUNS = ("nominal", "corrected", "compensated", "both", "ideal")
HEADS = ("hidden", "named", "nominal", "corrected allocation", "compensation", "both", "ideal")
POINTS = 100


def errors(truth: Truth) -> tuple[float, float]:
    """RMS of the attitude error [mrad] and of the position error [mm] after `SETTLE`."""
    asked = reference(truth.trajectory, len(truth.time) / CONTROL_RATE, CONTROL_RATE, truth.seed)
    late = truth.time >= SETTLE
    e_R = so3.vee(np.swapaxes(asked.R_ED, 1, 2) @ so3.matrix(truth.quat_EB))[late]
    off = (truth.position_E - asked.position_E)[late]
    return tuple(1e3 * float(np.sqrt(np.mean(np.sum(x**2, axis=1)))) for x in (e_R, off))  # type: ignore[return-value]


def opened(flight: Flight, model: Model) -> OpenFlight:
    """A flight, written and read as a log."""
    with tempfile.TemporaryDirectory() as folder:
        return open_flight(write(flight, Path(folder) / "train.mcap"), model)


def fitted(flight: OpenFlight, model: Model) -> Model:
    """The model with what `explain` names on a flight, fitted; as it is where nothing is named."""
    found = api.explain(flight, model, injections=0)
    try:
        return api.add(model, found).model
    except WrenchgapError:
        return model


def compensating(flight: OpenFlight, model: Model) -> Compensate | None:
    """Compensation with a torque GP of the commanded wrench; None where the GP is refused: too little is left."""
    gp = learn_process([flight], model, TORQUE, FitSettings(points=POINTS)).gp
    settings = Settings(dt=1.0 / CONTROL_RATE)
    if all_refused(gp, settings):
        return None
    compensator = Compensator(gp, settings)
    return lambda wrench, state: compensator.step(wrench).wrench_cmd


def allocating(model: Model) -> Allocate:
    """The corrected allocation of a model."""
    allocator = Allocator(allocation_problem(model))

    def allocate(wrench: Array) -> tuple[Array, Array]:
        made = allocator.step(wrench)
        return made.tilt, np.minimum(np.sqrt(made.thrust / C_F), SPEED_MAX)

    return allocate


def outcome(effect: str, seed: int, seconds: float) -> Row:
    """Errors of every run on an unseen figure-8 of so many `seconds`."""
    nominal = load("tilt_hexarotor")
    recorded, truth = fly(effect, None, "train", seed=seed, integral=0.0)
    hidden, train = truth.parameters[effect], opened(recorded, nominal)
    known = fitted(train, nominal)
    bare = replace(nominal, vehicle=replace(nominal.vehicle, arms=None, rotors=None))
    again, _ = fly(effect, hidden, "train", seed=seed, integral=0.0, allocate=allocating(known))
    runs: dict[str, dict[str, Any]] = {
        "nominal": {},
        "corrected": {"allocate": allocating(known)},
        "compensated": {"compensate": compensating(train, nominal)},
        "both": {"allocate": allocating(known), "compensate": compensating(opened(again, bare), bare)},
    }
    row: Row = {"effect": effect, "seed": seed, "named": [e.name for e in known.effects]}
    row["nothing_left"] = runs["both"]["compensate"] is None
    for name, how in runs.items():
        row[name] = errors(fly(effect, hidden, "figure8", seconds, seed=seed + 100, integral=0.0, **how)[1])
    row["ideal"] = errors(fly("none", None, "figure8", seconds, seed=seed + 100, integral=0.0)[1])
    return row


def table(rows: Sequence[Row]) -> str:
    """Medians over the seeds: attitude [mrad], position [mm]."""
    lines = ["| " + " | ".join(HEADS) + " |", "|---|---|" + "---:|" * len(RUNS)]
    for effect in dict.fromkeys(row["effect"] for row in rows):
        some = [row for row in rows if row["effect"] == effect]
        sets = dict.fromkeys(", ".join(row["named"]) or "nothing" for row in some)
        middle = [np.median([row[run] for row in some], axis=0) for run in RUNS]
        lines.append(f"| {effect} | {'; '.join(sets)} | " + " | ".join(f"{a:.1f}, {p:.1f}" for a, p in middle) + " |")
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> None:
    """Fly, print rows and the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--effect", nargs="*", default=list(EFFECTS))
    parser.add_argument("--seed", nargs="*", type=int, default=[21, 22, 23])
    parser.add_argument("--seconds", type=float, default=15.0, help="of the figure-8")
    parser.add_argument("--json", type=Path, help="rows are kept here, and what is there is not flown again")
    parser.add_argument("--page", action="store_true", help="write the table into docs/effectiveness.md")
    a = parser.parse_args(argv)
    kept = a.json is not None and a.json.exists()
    rows: list[Row] = json.loads(a.json.read_text(encoding="utf-8")) if kept else []
    for effect in a.effect:
        for seed in a.seed:
            if any((row["effect"], row["seed"]) == (effect, seed) for row in rows):
                continue
            rows.append(outcome(effect, seed, a.seconds))
            print(json.dumps(rows[-1]), flush=True)
            if a.json is not None:
                a.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print(table(rows))
    if a.page:
        renew(PAGE, {"loop": table(rows)})


if __name__ == "__main__":
    main()
