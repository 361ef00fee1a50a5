"""Does it ever harm: vehicles that hide something, nothing, or a lag alone, with excited and with smooth training.

Of each a GP is learnt as `wrenchgap learn` does. Then a 40 deg roll step from hover is flown without integral: without
compensation, with the GP as `learn` judged it, and with GP and observer together. Training is tilts about eight
azimuths, so that the step is new and its attitude is not.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from scipy.signal import detrend

from benchmarks.paper.flying import Flown, as_log, fly
from benchmarks.paper.plants import Plant, believed, make_effect, vehicle
from wrenchgap.compensate import Settings
from wrenchgap.learn.identify.learning import TORQUE, learn_process
from wrenchgap.learn.process.gp import FitSettings, GaussianProcess
from wrenchgap.plant.trajectory import Step, named
from wrenchgap.replay.compensation.compensators import combined, compensator

KINDS = ("hidden", "nothing", "lag")
TRAININGS = ("excited", "smooth")
VEHICLES = 200
TRAINING, LENGTH, MOMENT, LATE = 20.0, 5.0, 0.5, 3.5
"""Lengths of the flights, the moment of the step, and from when on the error is late [s]."""
POINTS = 60


def keys(vehicles: int = VEHICLES) -> list[str]:
    """One row for each vehicle, kind and training."""
    return [f"{n} {kind} {training}" for n in range(vehicles) for kind in KINDS for training in TRAININGS]


@cache
def plant(number: int, kind: str) -> Plant:
    """Vehicle `number` of the paper's experiments, the same without any effect, or with lags drawn anew alone."""
    if kind == "hidden":
        return vehicle(number + 1)
    model = believed()
    if kind == "nothing":
        return Plant(model, model)
    rng = np.random.default_rng([number, 11])
    values = {"servo_lag": rng.uniform(0.02, 0.09), "motor_lag": rng.uniform(0.01, 0.04)}
    effects = [make_effect(model.vehicle, name, (value,)) for name, value in values.items()]
    late = make_effect(model.vehicle, "command_delay", (rng.uniform(0.0, 0.02),))
    return Plant(model, model.with_effects((*effects, late)))


def learnt(number: int, kind: str, training: str) -> GaussianProcess:
    """What `learn` makes of a training flight."""
    asked = named("multi_axis", TRAINING, 1.0 if training == "excited" else 0.0, number)
    flown = fly(plant(number, kind), asked, 100 + number, integral=False, name="training")
    log = as_log(flown, plant(number, kind))
    return learn_process((log,), believed(), TORQUE, FitSettings(points=POINTS)).gp


def one(key: str) -> dict[str, Any]:
    """One row."""
    number, kind, training = key.split()
    gp = learnt(int(number), kind, training)
    settings = Settings(dt=1.0 / believed().controller.rate_hz)
    found: dict[str, Any] = {"none": step(int(number), kind)}
    refused = set(gp.refused) == set(gp.outputs)
    found["GP"] = found["none"] if refused else outcome(int(number), kind, compensator(gp, believed(), settings))
    said = gp.provenance
    watched = said.observer_hz is not None
    found["combined"] = outcome(int(number), kind, combined(gp, believed(), settings)) if watched else found["GP"]
    return found | {
        "gain": gp.gain.tolist(),
        "decisions": [f"{v.decision.value}: {v.reason.value}" for v in said.verdicts],
        "blind": list(gp.settings.blind),
        "lags": list(said.lags),
        "margin": said.margin,
        "hz": said.observer_hz,
        "told": said.observer_lag,
        "peak": said.observer_peak,
        "gains": said.gains,
    }


@cache
def step(number: int, kind: str) -> dict[str, float]:
    """The roll step without compensation."""
    return outcome(number, kind, None)


def outcome(number: int, kind: str, helper: Any) -> dict[str, float]:
    """Whether control was lost, the late error [rad], and how much it swings about its trend [rad]."""
    return measured(
        fly(plant(number, kind), Step(LENGTH, moment=MOMENT), 500 + number, compensator=helper, integral=False)
    )


def measured(flown: Flown) -> dict[str, float]:
    """Of a flight; the largest standard deviation of an axis is its swing."""
    after = flown.error[flown.time > LATE]
    if flown.lost or len(after) < 2:
        return {"lost": 1.0, "late": float("inf"), "swing": float("inf")}
    late = float(np.linalg.norm(after, axis=1).mean())
    return {"lost": 0.0, "late": late, "swing": float(detrend(after, axis=0).std(axis=0).max())}
