"""The whole loop on two flights: a vehicle with effects that its model file lacks, found, added, learnt, compensated.

Every step is a command line, run as a user would type it, on the logs alone. The closing table is put together from
the steps' JSON results and speaks of the test flight only, which no step fitted.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HIDDEN = ("com_offset=x:0.005,y:-0.007,z:0.004", "arm_twist=twist:0.0015")
"""What the vehicle has and its model file does not: a centre of mass 9 mm away from where it should be, and arms that
twist by 0.09 deg per newton of thrust."""
ADDED = "com_offset"
"""The effect that is added by name; a Gaussian process learns the rest, as it would if the rest had no name."""


@dataclass(frozen=True)
class Step:
    """What it is for, and the arguments of `wrenchgap`. Files are in the demo's folder."""

    title: str
    arguments: tuple[str, ...]

    @property
    def line(self) -> str:
        """The command line as a user would type it."""
        return " ".join(("wrenchgap", *self.arguments))


def steps(model: str = "tilt_hexarotor") -> list[Step]:
    """The steps of the demo, file names relative to its folder."""

    def step(title: str, line: str) -> Step:
        return Step(title, tuple(line.format(model=model, hidden=hidden, added=ADDED).split()))

    hidden = " ".join(f"--hide {effect}" for effect in HIDDEN)
    return [
        step(
            "Fly a training flight: tilts about several axes, excitation on all of them",
            "simulate -m {model} -t multi_axis --duration 40 --excitation 1 --seed 1 {hidden} -o train.mcap",
        ),
        step(
            "Fly a test flight, to which nothing is fitted",
            "simulate -m {model} -t multi_axis --duration 20 --seed 2 {hidden} -o test.mcap",
        ),
        step("What is in the log?", "inspect test.mcap -m {model}"),
        step("How large is the model's error?", "compare test.mcap -m {model} --json before.json"),
        step("Which effects are missing?", "explain train.mcap -m {model} --validate test.mcap --json explain.json"),
        step("Add one of them", "add {added} -m {model} --from train.mcap -o fitted.toml"),
        step(
            "How large is the error with it?",
            "compare test.mcap -m {model} --against fitted.toml --figure effect.png --json effect.json",
        ),
        step(
            "Learn the residual as a Gaussian process",
            "learn train.mcap -m fitted.toml --points 200 -o torque.gp --json learn.json",
        ),
        step(
            "How large is the error with the process?",
            "compare test.mcap -m fitted.toml --gp torque.gp --figure torque.png --json gp.json",
        ),
        step(
            "Re-run the compensation on the test flight's recorded wrenches",
            "replay test.mcap -m fitted.toml --gp torque.gp -o replayed.mcap --csv replayed.csv --json replay.json",
        ),
        step(
            "Re-simulate the test flight with the compensation in the loop",
            "counterfactual test.mcap -m fitted.toml --gp torque.gp -o reflown.mcap --json reflown.json",
        ),
    ]


def run(folder: Path, execute: Callable[[Step], None]) -> dict[str, Any]:
    """Run all steps with `execute`, in `folder` (the working directory), and return the numbers of the table."""
    for step in steps():
        execute(step)
    return numbers(folder)


def numbers(folder: Path) -> dict[str, Any]:
    """The closing table's numbers from the steps' results: torque rms (3,) [Nm], attitude error (3,) [rad]."""

    def rms(file: str, index: int) -> list[float]:
        return [float(v) for v in _read(folder / file)["models"][index]["rms"][3:]]

    reflown = _read(folder / "reflown.json")
    return {
        "hidden": list(HIDDEN),
        "found": _read(folder / "explain.json")["effects"],
        "torque_rms": {
            "nominal": rms("before.json", 0),
            f"with {ADDED}": rms("effect.json", -1),
            f"with {ADDED} and the GP": rms("gp.json", -1),
            "sensor noise": [float(v) for v in _read(folder / "before.json")["noise"][3:]],
        },
        "tracking": reflown["tracking"],
        "null_run": reflown["null_run"],
    }


def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))
