"""A figure-8 after 20 s of smooth training: what the flight does not show, left to physics or learnt all the same.

Of vehicles of the paper's experiments two processes are learnt from one log: as fitted, like the paper's, and as
`learn` judges it. A figure-8 to 63 deg is flown without integral, without compensation, with both, and with the
judged one and its observer.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.harm.vehicles import POINTS, TRAINING
from benchmarks.paper.flying import as_log, fly
from benchmarks.paper.plants import believed, vehicle
from wrenchgap.compensate import Compensator, Settings
from wrenchgap.learn.identify.learning import TORQUE, learn_process
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.plant.trajectory import named
from wrenchgap.replay.compensation.compensators import combined, compensator

VEHICLES = 5
LENGTH, SETTLE = 9.0, 3.0
METHODS = {"none": "none", "fitted": "GP as fitted", "GP": "GP", "combined": "combined"}


def keys() -> list[str]:
    """One row for each vehicle."""
    return [str(n) for n in range(VEHICLES)]


def one(key: str) -> dict[str, Any]:
    """Mean |e_R| (3,) [rad] of every method; None where control was lost."""
    plant, settings = vehicle(int(key)), Settings(dt=1.0 / believed().controller.rate_hz)
    flown = fly(plant, named("multi_axis", TRAINING, 0.0, int(key)), 100 + int(key), integral=False, name="training")
    log = as_log(flown, plant)
    fitted, judged = (
        learn_process((log,), plant.believed, TORQUE, FitSettings(points=POINTS, guarded=guarded)).gp
        for guarded in (False, True)
    )
    helpers: dict[str, Any] = {
        "none": None,
        "fitted": Compensator(fitted, settings),
        "GP": compensator(judged, plant.believed, settings),
        "combined": combined(judged, plant.believed, settings),
    }
    found: dict[str, Any] = {"hz": judged.provenance.observer_hz, "lags": list(judged.provenance.lags)}
    for name, helper in helpers.items():
        end = fly(plant, named("figure8", LENGTH), 60, compensator=helper, integral=False)
        found[name] = None if end.lost else np.abs(end.error[end.time > SETTLE]).mean(axis=0).tolist()
    return found | {"blind": list(judged.settings.blind), "gain": judged.gain.tolist()}
