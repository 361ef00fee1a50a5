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
from benchmarks.paper.methods import CUTOFFS_HZ, OBSERVER_HZ
from benchmarks.paper.plants import Plant, vehicle
from wrenchgap.compensate import INDI, L1, Combined, DisturbanceObserver, Settings
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.learn.data.opening import opened
from wrenchgap.learn.identify.learning import TORQUE, learn_process
from wrenchgap.learn.process.gp import FitSettings, GaussianProcess
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.simulation.simulate import physics_rate, simulate
from wrenchgap.plant.trajectory import Trajectory, named
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.replay.compensation.compensators import combined, compensator

TRAINING, LENGTH, SETTLE = 30.0, 9.0, 3.0
POINTS = 100
IMBALANCE = ((87.0, 0.6), (183.0, 1.2))
"""Torques of rotors out of balance, frequency [Hz] and size [Nm] on every axis. A gyroscope read at 200 Hz sees the
second at 17 Hz."""
TRAJECTORIES = ("figure8", "pitch")
METHODS = ("none", "plain", "observer", "GP", "combined")
FEEDBACK: dict[str, Callable[[Vehicle, float, float, float], Any]] = {
    "INDI, told the lag": lambda body, dt, hz, lag: INDI(body, dt, hz, lag=lag),
    "INDI, told no lag": lambda body, dt, hz, lag: INDI(body, dt, hz),
    "L1": lambda body, dt, hz, lag: L1(body, dt, hz),
}
"""What others fly, with the cut-offs of `benchmarks.paper.methods.CUTOFFS_HZ` and the lag of the training log."""


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


def truth(condition: Condition, number: int = 0) -> Plant:
    """The paper's vehicle, or another of its kind, with another delay."""
    plant = vehicle(number)
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
        found[name] = errors(plant, trajectory, condition, helpers[name]())
    return found | by_feedback(key, said.observer_lag)


def by_feedback(key: str, lag: float) -> dict[str, Any]:
    """As `one`, of INDI and L1, of which only the lag [s] is learnt."""
    index, trajectory = key.split()
    condition = CONDITIONS[int(index)]
    plant = truth(condition)
    body, dt = plant.believed.vehicle, 1.0 / plant.believed.controller.rate_hz
    laws = {name: build(body, dt, CUTOFFS_HZ[name], lag) for name, build in FEEDBACK.items()}
    return {name: errors(plant, trajectory, condition, law) for name, law in laws.items()}


def errors(plant: Plant, trajectory: str, condition: Condition, helper: Any) -> list[float] | None:
    """Mean |e_R| (3,) [rad] of a flight; None where control was lost."""
    flown = fly(plant, named(trajectory, LENGTH), 60, condition, helper)
    if any("control was lost" in str(note) for note in flown.notes):
        return None
    time, error = attitude_errors(flown)
    return [float(e) for e in np.abs(error[time > SETTLE]).mean(axis=0)]


def _decisions(gp: GaussianProcess) -> list[str]:
    return [v.decision.value for v in gp.provenance.verdicts]
