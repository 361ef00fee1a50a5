"""State and inputs of the plant, for N samples at once (a simulation step is N = 1).

Every array has the sample axis first. O is the body origin; wrenches in this module are about O, in B, force first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Commands:
    """What the flight controller sends: `wrench_B` (N, 6), and where the vehicle has rotors `tilt` (N, A) [rad] and
    `rotor_speed` (N, R) [rad/s].
    """  # noqa: D205

    wrench_B: Array
    tilt: Array | None = None
    rotor_speed: Array | None = None


@dataclass(frozen=True)
class State:
    """Motion of the body origin O: `time` (N,) [s], `position_E` (N, 3), `quat_EB` (N, 4), `velocity_E` (N, 3) and
    `omega_B` (N, 3); `voltage` (N,) [V] or None where unknown.
    """  # noqa: D205

    time: Array
    position_E: Array
    quat_EB: Array
    velocity_E: Array
    omega_B: Array
    voltage: Array | None = None


@dataclass(frozen=True)
class Actuation:
    """What the rotors do: `tilt` (N, A), `rotor_speed` (N, R), `normal_B` (N, R, 3) unit thrust directions, `hub_B`
    (N, R, 3) positions from O, `thrust` (N, R) [N] along the normals.
    """  # noqa: D205

    tilt: Array
    rotor_speed: Array
    normal_B: Array
    hub_B: Array
    thrust: Array


@dataclass(frozen=True)
class Motion:
    """What an ideal IMU at O would feel: `omega_B` (N, 3), `omega_dot_B` (N, 3), `specific_force_B` (N, 3)."""

    omega_B: Array
    omega_dot_B: Array
    specific_force_B: Array
