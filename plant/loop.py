"""What closes a loop in a simulation, and what comes of it: for plain numpy and for compiled code alike."""

from __future__ import annotations

from dataclasses import dataclass

from wrenchgap.flight.flight import Array
from wrenchgap.plant.closed_loop import Clock, Flown
from wrenchgap.plant.controller import ControllerGains
from wrenchgap.plant.flight_computer import Compensating
from wrenchgap.plant.sensors import SensorNoise
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory import Reference
from wrenchgap.plant.vehicle import Vehicle


@dataclass(frozen=True)
class Loop:
    """What closes the loop: see `plant.simulate.simulate`; `errors` (N, 6) are the IMU's, `per_` in steps."""

    clock: Clock
    gains: ControllerGains
    believed: Vehicle
    reference: Reference
    noise: SensorNoise
    per_imu: int
    per_pose: int
    errors: Array
    measured: bool
    integral: Array | None
    compensator: Compensating | None
    gravity: float


@dataclass(frozen=True)
class Result:
    """A flight; pose readings, desired wrenches (K, 6), how many commands were limited in what."""

    flown: Flown
    poses: State
    desired: Array
    limited: dict[str, int]
