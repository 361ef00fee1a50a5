"""Flights of three vehicles, each of which hides another effect; made one after the other, what is there is kept."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wrenchgap import load_model, simulate
from wrenchgap.replay.api import save_log

SECONDS = 5.0
"""Length of a flight [s]: short, so that the benchmark is about batches and not about long logs."""


@dataclass(frozen=True)
class Vehicle:
    """One vehicle: its name, the shipped model that it is believed to be, and what it hides.

    `hidden` is what `simulate --hide` takes, {0} its size; on every flight the size is scattered by `scatter` about
    `size`.
    """

    name: str
    model: str
    hidden: str
    size: float
    scatter: float


VEHICLES = (
    Vehicle("alpha", "crazyflie", "com_offset=x:{0}", 0.0015, 0.00005),
    Vehicle("bravo", "asymmetric_quadrotor", "thrust_scale=scale:{0}", -0.06, 0.004),
    Vehicle("charlie", "tilt_hexarotor", "com_offset=x:{0}", 0.004, 0.0002),
)


def fly(folder: Path, number: int) -> Path:
    """The log of one flight; vehicles take turns, so that the first flights of a fleet are a fleet too."""
    vehicle = VEHICLES[number % len(VEHICLES)]
    path = folder / vehicle.name / f"{number // len(VEHICLES):04d}.mcap"
    if path.exists():
        return path
    path.parent.mkdir(parents=True, exist_ok=True)
    size = vehicle.size + vehicle.scatter * np.random.default_rng(number).standard_normal()
    model = load_model(vehicle.model)
    hide = [vehicle.hidden.format(f"{size:.8f}")]
    flight = simulate(model, "multi_axis", duration=SECONDS, excitation=1.0, seed=number, hide=hide)
    return save_log(flight, path)


def make(folder: Path, count: int) -> None:
    """Fly what is missing of the first `count` flights."""
    for number in range(count):
        fly(folder, number)
