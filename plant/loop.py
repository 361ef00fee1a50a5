"""What closes a loop in a simulation, and what comes of it: for plain numpy and for compiled code alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.plant.closed_loop import Clock, Flown
from wrenchgap.plant.controller import ControllerGains, pushes_along_z_only
from wrenchgap.plant.flight_computer import Compensating, Correction, RecordedPilot
from wrenchgap.plant.sensors import SensorNoise
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory import Reference
from wrenchgap.plant.vehicle import Vehicle


@dataclass(frozen=True)
class Loop:
    """What closes the loop: see `plant.simulate.simulate`; `errors` (N, 6) are the IMU's, `per_` in steps.

    disturbance  (S, 6) about O in B, None where there is none
    recorded     what a recorded computer sent beyond law and allocation; its integral is then the law's
    forgiven     (K,) periods in which control counts as lost only where the state is not finite
    memory       of the plant's command effects before the first step
    """

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
    disturbance: Array | None = None
    recorded: RecordedPilot | None = None
    forgiven: NDArray[np.bool_] | None = None
    memory: dict[str, Any] | None = None

    @property
    def along_z(self) -> bool:
        """Whether the law is that of a vehicle that pushes along its z axis only."""
        return pushes_along_z_only(self.believed) if self.recorded is None else self.recorded.along_z


@dataclass(frozen=True)
class Result:
    """A flight; pose readings, desired wrenches (K, 6), how many commands were limited in what.

    `steps` are the compensator's.
    """

    flown: Flown
    poses: State
    desired: Array
    limited: dict[str, int]
    steps: tuple[Correction, ...] = ()
