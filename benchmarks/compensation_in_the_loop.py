"""The method in the loop, judged by an engine that shares no code with it.

For each hidden effect and seed: fly `train` with the PD controller, write the log, open it as a user would, learn a
torque GP from it, then fly a trajectory that the GP has not seen with PD alone, with PD and compensation, and with the
paper's integral instead. Reported is mean |e_R| per axis, e_R = 1/2 (R_ED^T R_EB - R_EB^T R_ED)^vee, of the true
attitude after the first `SETTLE` seconds. Columns "ideal" are PD on the vehicle without the effect: the floor.

    python -m benchmarks.compensation_in_the_loop --effect com_offset wake --seed 1 2 --json result.json
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.hidden_effects.engine import CONTROL_RATE, Truth, fly
from benchmarks.hidden_effects.trajectories import TRAJECTORIES, reference
from wrenchgap.compensate import Compensator, Settings
from wrenchgap.flight import so3, write
from wrenchgap.flight.errors import WrenchgapError
from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.learn.identify.learning import TORQUE, learn_process
from wrenchgap.learn.process.gp import FitSettings, GaussianProcess
from wrenchgap.plant.mismatch import conditioning
from wrenchgap.plant.model_file import load

SETTLE = 3.0
"""Seconds at the start that do not count: the references fade in."""
WORTH_IT = 5e-3
"""Mean |e_R| [rad] below which there is nothing to take away and a fall means nothing."""
EFFECTS = ("com_offset", "wake", "weak_rotor", "tilt_offset", "coaxial_loss", "payload", "tether", "servo_lag")


@dataclass(frozen=True)
class Outcome:
    """Mean |e_R| (3,) [rad] of each flight, and how the compensator fared; `pd` is without it."""

    effect: str
    seed: int
    trajectory: str
    parameters: dict[str, Any]
    pd: Array
    integral: Array
    compensated: Array
    ideal: Array
    beta_mean: float
    accepted: float
    solve_ms: float
    conditioning_min: float

    @property
    def fall(self) -> Array:
        """Share (3,) of the error that the compensation takes away; nan where PD alone is within `WORTH_IT`."""
        return np.where(self.pd > WORTH_IT, 1.0 - self.compensated / np.maximum(self.pd, WORTH_IT), np.nan)


def attitude_error(truth: Truth) -> Array:
    """Mean |e_R| (3,) [rad] of a flight after `SETTLE`."""
    asked = reference(truth.trajectory, len(truth.time) / CONTROL_RATE, CONTROL_RATE, truth.seed)
    R_DB = np.swapaxes(asked.R_ED, 1, 2) @ so3.matrix(truth.quat_EB)
    error = so3.vee(R_DB)  # vee takes the skew part, 1/2 (S - S^T)
    return np.asarray(np.abs(error[truth.time >= SETTLE]).mean(axis=0))


def learnt(effect: str, seed: int, points: int, integral: float) -> tuple[GaussianProcess, Mapping[str, Any]]:
    """A torque GP from the log of a training flight, and the parameters that were hidden."""
    recorded, truth = fly(effect, None, "train", seed=seed, integral=integral)
    with tempfile.TemporaryDirectory() as folder:
        model = load("tilt_hexarotor")
        opened = open_flight(write(recorded, Path(folder) / "train.mcap"), model)
    return learn_process([opened], model, TORQUE, FitSettings(points=points)).gp, truth.parameters[effect]


def outcome(
    effect: str,
    seed: int,
    *,
    trajectory: str = "figure8",
    seconds: float | None = None,
    points: int = 200,
    train_integral: float = 0.0,
) -> Outcome:
    """Train, learn, and fly `trajectory` with another seed with and without compensation; same noise for all.

    `seconds` shortens the unseen flights; `train_integral` is the controller's on the training flight.
    """
    gp, hidden = learnt(effect, seed, points, train_integral)
    compensator = Compensator(gp, Settings(dt=1.0 / CONTROL_RATE))
    steps = []

    def compensate(wrench_des: Array, state: Array) -> Array:
        del state  # this GP knows the command alone
        steps.append(compensator.step(wrench_des))
        return steps[-1].wrench_cmd

    unseen = seed + 100
    plain, pd = fly(effect, hidden, trajectory, seconds, seed=unseen, integral=0.0)
    _, with_integral = fly(effect, hidden, trajectory, seconds, seed=unseen, integral=0.3)
    _, compensated = fly(effect, hidden, trajectory, seconds, seed=unseen, integral=0.0, compensate=compensate)
    _, ideal = fly("none", None, trajectory, seconds, seed=unseen, integral=0.0)
    assert plain.commanded is not None
    return Outcome(
        effect=effect,
        seed=seed,
        trajectory=trajectory,
        parameters=dict(hidden),
        pd=attitude_error(pd),
        integral=attitude_error(with_integral),
        compensated=attitude_error(compensated),
        ideal=attitude_error(ideal),
        beta_mean=float(np.mean([s.beta for s in steps])),
        accepted=float(np.mean([s.accepted for s in steps])),
        solve_ms=1e3 * float(np.mean([s.solve_time for s in steps])),
        conditioning_min=float(conditioning(gp, plain.commanded.wrench_B[::10]).real_min.min()),
    )


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Attitude error with and without the learnt compensation.")
    parser.add_argument("--effect", nargs="*", default=list(EFFECTS))
    parser.add_argument("--seed", nargs="*", type=int, default=[1, 2])
    parser.add_argument("--trajectory", default="figure8", choices=list(TRAJECTORIES))
    parser.add_argument("--points", type=int, default=200)
    parser.add_argument("--train-integral", type=float, default=0.0, help="integral gain on the training flight")
    parser.add_argument("--json", type=Path, help="write the numbers here")
    a = parser.parse_args(argv)
    print(f"mean |e_R| x y z [mrad] on the unseen trajectory {a.trajectory}, torque GP of {a.points} points")
    print(f"{'effect':14s} seed {'PD':>21s} {'PD + integral':>21s} {'PD + GP':>21s} {'ideal PD':>21s} {'fall %':>21s}")
    rows = []
    for effect in a.effect:
        for seed in a.seed:
            try:
                one = outcome(effect, seed, trajectory=a.trajectory, points=a.points, train_integral=a.train_integral)
            except WrenchgapError as error:
                print(f"{effect:14s} {seed:4d} {error}")
                continue
            errors = (one.pd, one.integral, one.compensated, one.ideal)
            cells = " ".join("".join(f"{1e3 * v:7.2f}" for v in e) for e in errors)
            print(f"{effect:14s} {seed:4d} {cells} {''.join(f'{100 * v:7.1f}' for v in one.fall)}", flush=True)
            rows.append(asdict(one) | {"fall": one.fall})
    if a.json is not None:
        a.json.write_text(json.dumps({"trajectory": a.trajectory, "rows": rows}, indent=1, default=np.ndarray.tolist))


if __name__ == "__main__":
    main()
