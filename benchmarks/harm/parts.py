"""Feed-forward and feedback together against each of its parts: gyro noise, vibration, delay.

The paper's vehicle (benchmarks/paper/plants.py) without integral, with another gyroscope, with rotors that are out of
balance, and with another bus delay. What is learnt, and the observer's bandwidth, come from a training flight under the
same conditions. `plain` is an observer alone with the bandwidth that the paper's experiments chose on a test flight.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from benchmarks.paper.flying import attitude_errors
from benchmarks.paper.methods import OBSERVER_HZ
from benchmarks.paper.plants import Plant, vehicle
from wrenchgap.compensate import Combined, DisturbanceObserver, Settings
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.learn.data.opening import opened
from wrenchgap.learn.identify.learning import TORQUE, learn_process
from wrenchgap.learn.process.gp import FitSettings, GaussianProcess
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.simulation.simulate import physics_rate, simulate
from wrenchgap.plant.trajectory import Trajectory, named
from wrenchgap.replay.compensation.compensators import combined, compensator

TRAINING, LENGTH, SETTLE = 30.0, 9.0, 3.0
POINTS = 100
IMBALANCE = ((87.0, 0.6), (183.0, 1.2))
"""Torques of rotors out of balance, frequency [Hz] and size [Nm] on every axis. A gyroscope read at 200 Hz sees the
second at 17 Hz."""
TRAJECTORIES = ("figure8", "pitch")
METHODS = ("none", "plain", "observer", "GP", "combined")


@dataclass(frozen=True)
class Condition:
    """Gyroscope's noise in multiples of an ADIS16448's, whether rotors are out of balance, bus delay [s]."""

    noise: float
    vibration: bool
    delay: float

    @property
    def name(self) -> str:
        """As in the table."""
        words = ", vibration" if self.vibration else ""
        return f"gyro noise x {self.noise:g}{words}, {1e3 * self.delay:.0f} ms delay"


CONDITIONS = (
    Condition(1.0, False, 0.01),
    Condition(5.0, False, 0.01),
    Condition(1.0, True, 0.01),
    Condition(1.0, False, 0.025),
    Condition(5.0, True, 0.025),
)


def keys() -> list[str]:
    """One row for each condition and trajectory."""
    return [f"{k} {t}" for t in TRAJECTORIES for k in range(len(CONDITIONS))]


def fly(plant: Plant, asked: Trajectory, seed: int, condition: Condition, helper: Any = None) -> Flight:
    """A flight under these conditions, without integral."""
    believed = replace(plant.believed, controller=replace(plant.believed.controller, integral=0.0))
    sensors = plant.truth.sensors
    return simulate(
        plant.truth,
        believed,
        asked,
        rng=np.random.default_rng([seed, 23]),
        compensator=helper,
        disturbance=shaking if condition.vibration else None,
        sensors=replace(sensors, gyro_density=condition.noise * sensors.gyro_density),
        physics_rate=physics_rate(believed),
    )


def shaking(time: float) -> Array:
    """The torque (6,) of rotors out of balance, in phases that differ between the axes."""
    phases = np.array([0.0, 2.1, 4.2])
    return np.concatenate((np.zeros(3), sum(a * np.sin(2.0 * np.pi * f * time + phases) for f, a in IMBALANCE)))


def truth(condition: Condition) -> Plant:
    """The paper's vehicle with another delay."""
    plant = vehicle()
    others = [e for e in plant.truth.effects if e.name != "command_delay"]
    late = make_effect(plant.believed.vehicle, "command_delay", (condition.delay,))
    return Plant(plant.believed, plant.truth.with_effects((*others, late)))


@cache
def learnt(index: int) -> GaussianProcess:
    """What is learnt under these conditions."""
    condition = CONDITIONS[index]
    plant = truth(condition)
    log = opened(fly(plant, named("multi_axis", TRAINING, 1.0, 0), 20 + index, condition), plant.believed)
    return learn_process((log,), plant.believed, TORQUE, FitSettings(points=POINTS)).gp


def one(key: str) -> dict[str, Any]:
    """Mean |e_R| (3,) [rad] of every method; None where control was lost."""
    index, trajectory = key.split()
    condition, gp = CONDITIONS[int(index)], learnt(int(index))
    plant = truth(condition)
    settings, said = Settings(dt=1.0 / plant.believed.controller.rate_hz), gp.provenance
    hz = said.observer_hz
    assert hz is not None
    body, dt = plant.believed.vehicle, settings.dt
    helpers: dict[str, Callable[[], Any]] = {
        "none": lambda: None,
        "plain": lambda: DisturbanceObserver(body, dt, OBSERVER_HZ),
        "observer": lambda: Combined(body, dt, hz, lag=said.observer_lag),
        "GP": lambda: compensator(gp, plant.believed, settings),
        "combined": lambda: combined(gp, plant.believed, settings),
    }
    found: dict[str, Any] = {"hz": hz, "told": said.observer_lag, "peak": said.observer_peak, "lags": list(said.lags)}
    found["decisions"] = _decisions(gp)
    for name in METHODS:
        flown = fly(plant, named(trajectory, LENGTH), 60, condition, helpers[name]())
        lost = any("control was lost" in str(note) for note in flown.notes)
        time, error = attitude_errors(flown)
        found[name] = None if lost else np.abs(error[time > SETTLE]).mean(axis=0).tolist()
    return found


def _decisions(gp: GaussianProcess) -> list[str]:
    return [v.decision.value for v in gp.provenance.verdicts]
