"""The whole loop on two flights: a vehicle with an effect that its model file lacks, found, added, learnt, compensated.

Every step is a command line, run as a user would type it, on the logs alone. The closing table is put together from
the steps' JSON results and speaks of the test flight only, which no step fitted.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HIDDEN = "com_offset=x:0.005,y:-0.007,z:0.004"
"""What the vehicle has and its model file does not: a centre of mass 9 mm away from where it should be."""


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
        return Step(title, tuple(line.format(model=model, hidden=HIDDEN).split()))

    return [
        step(
            "Fly a training flight: tilts about several axes, excitation on all of them",
            "simulate -m {model} -t multi_axis --duration 40 --excitation 1 --seed 1 --hide {hidden} -o train.mcap",
        ),
        step(
            "Fly a test flight that nothing is fitted to: pitch 0-60-0 deg, twice",
            "simulate -m {model} -t pitch --duration 20 --seed 2 --hide {hidden} -o test.mcap",
        ),
        step("What is in the log?", "inspect test.mcap -m {model}"),
        step("How wrong is the model?", "compare test.mcap -m {model} --json before.json"),
        step("Which effect is missing?", "explain train.mcap -m {model} --validate test.mcap --json explain.json"),
        step("Add it", "add {{effects}} -m {model} --from train.mcap -o fitted.toml"),
        step(
            "How wrong is the model now?",
            "compare test.mcap -m {model} --against fitted.toml --figure effect.png --json effect.json",
        ),
        step(
            "Or learn the gap as a Gaussian process",
            "learn train.mcap -m {model} --points 200 -o torque.gp --json learn.json",
        ),
        step(
            "How wrong is the model with it?",
            "compare test.mcap -m {model} --gp torque.gp --figure torque.png --json gp.json",
        ),
        step(
            "Re-run the compensation on the test flight's recorded wrenches",
            "replay test.mcap -m {model} --gp torque.gp -o replayed.mcap --csv replayed.csv --json replay.json",
        ),
        step(
            "Fly the test flight again, with the compensation in the loop",
            "counterfactual test.mcap -m {model} --gp torque.gp -o reflown.mcap --json reflown.json",
        ),
    ]


def with_effects(step: Step, effects: Sequence[str]) -> Step:
    """The step with the effects that `explain` chose in place of its placeholder."""
    arguments: list[str] = []
    for word in step.arguments:
        arguments += effects if word == "{effects}" else [word]
    return Step(step.title, tuple(arguments))


def run(folder: Path, execute: Callable[[Step], None]) -> dict[str, Any]:
    """Run all steps with `execute`, in `folder` (the working directory), and return the numbers of the table."""
    for step in steps():
        if "{effects}" in step.arguments:
            step = with_effects(step, _read(folder / "explain.json")["effects"])
        execute(step)
    return numbers(folder)


def numbers(folder: Path) -> dict[str, Any]:
    """The closing table's numbers from the steps' results: torque rms (3,) [Nm], attitude error (3,) [rad]."""

    def rms(file: str, index: int) -> list[float]:
        return [float(v) for v in _read(folder / file)["models"][index]["rms"][3:]]

    reflown = _read(folder / "reflown.json")
    return {
        "hidden": HIDDEN,
        "found": _read(folder / "explain.json")["effects"],
        "torque_rms": {
            "nominal": rms("before.json", 0),
            "with the effect": rms("effect.json", -1),
            "with the GP": rms("gp.json", -1),
            "sensor noise": [float(v) for v in _read(folder / "before.json")["noise"][3:]],
        },
        "tracking": reflown["tracking"],
        "null_run": reflown["null_run"],
    }


def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))
