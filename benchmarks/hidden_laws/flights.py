"""Flights with a hidden law: the quadrotor of `tests/independent`, and the hexarotor of `hidden_effects` in MuJoCo."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.hidden_effects import engine
from benchmarks.hidden_effects.world import Engine, Hidden
from benchmarks.hidden_laws.laws import LAWS, View, Wrench
from tests.independent import flown_quadrotor as quadrotor
from wrenchgap.flight.flight import GRAVITY, Flight
from wrenchgap.plant import model_file
from wrenchgap.plant.model import Model

SECONDS = 44.0
HEXAROTOR = model_file.load("tilt_hexarotor")
MODELS: dict[str, Callable[[], Model]] = {
    "quadrotor": lambda: quadrotor.MODEL,
    "hexarotor": lambda: HEXAROTOR,
}


class InMujoco(Hidden):
    """A law in MuJoCo's engine."""

    answers = ("unknown",)
    unit, size = "1", 1.0

    def __init__(self, push: Callable[[View], Wrench]) -> None:
        self.law = push

    def push(self, world: Engine) -> None:
        """The law's force at the centre, and its torque."""
        R = world.R_EB
        force, torque = self.law(seen(world))
        world.push(R @ force, world.position_E)
        world.twist(R @ torque)


def seen(world: Engine) -> View:
    """What the hexarotor does."""
    R, arms = world.R_EB, HEXAROTOR.vehicle.arms
    assert arms is not None
    return View(
        world.time, world.position_E, R.T @ world.velocity_E, world.omega_B, R, world.thrusts, world.normals_E @ R,
        (world.hubs_E - world.position_E) @ R, world.tilt, world.tilt_rate, arms.axis_B, 39.24, 0.3,
    )  # fmt: skip


def on_quadrotor(push: Callable[[View], Wrench]) -> quadrotor.Law:
    """A law for the quadrotor's engine."""
    R0 = np.tile(E_Z, (4, 1))

    def law(t: float, position, velocity, R, omega, thrust) -> Wrench:  # type: ignore[no-untyped-def]
        none = np.zeros(0)
        size = (quadrotor.MASS * GRAVITY, quadrotor.ARM)
        return push(View(t, position, R.T @ velocity, omega, R, thrust, R0, quadrotor.PLACES, none, none, none, *size))

    return law


E_Z = np.array([0.0, 0.0, 1.0])


def flown(vehicle: str, name: str, scale: float, kind: str, seed: int) -> Flight:
    """One flight, of `SECONDS`; `name` is a law, or "nothing"."""
    law = LAWS.get(name)
    size = 0.0 if law is None else scale * true_size(name, vehicle)
    push = None if law is None else lambda view: law.push(view, size)
    if vehicle == "quadrotor":
        excited = {"excited": 1.0, "mission": 0.15, "low": 1.0}[kind]
        case = quadrotor.Case(
            f"{name}-{seed}", excited=excited, seed=seed, seconds=SECONDS, fast=2.0,
            law=None if push is None else on_quadrotor(push),
        )  # fmt: skip
        return quadrotor.fly([case])[0]
    trajectory = {"excited": "train", "mission": "figure8", "low": "low"}[kind]
    fast = "fast" if kind == "excited" and name in FAST else trajectory
    flight = engine.fly("none", None, fast, 40.0, seed, crisp=True, also=() if push is None else (InMujoco(push),))[0]
    return replace(flight, name=f"{name}-{seed}")


def true_size(name: str, vehicle: str) -> float:
    """The size of a law's coefficient where it is hidden at its usual size."""
    law = LAWS[name]
    return law.size * (law.on_hexarotor if vehicle == "hexarotor" else 1.0)


FAST = ("thrust_speed2", "drag_1.5", "flapping", "pressure_point", "crosswind_yaw")
"""Laws of speed: the hexarotor flies fast for them."""
