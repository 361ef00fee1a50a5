"""What a step of the compensation is told of the motion, and where a row of its results has what."""

from __future__ import annotations

import math

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.plant.state import State

COMMAND, CORRECTED, FOUND, SIGMA, BETA, COST, EVALUATIONS, ACCEPTED, LIMITED, EXPECTED = (
    0,
    6,
    12,
    18,
    19,
    20,
    21,
    22,
    23,
    24,
)
"""Places in a row of results; the mismatch expected before (L,) and after (L,) comes last. LIMITED: the vehicle
cannot make what was asked for, or what was found."""
STATE_MAX = (1e8, 1e8, 1e8, 2.0, 2.0, 2.0, 2.0, 1e3, 1e3, 1e3, 1e3, 1e3, 1e3, 1e10)
"""Largest numbers that the state of a flight can have: position in E [m] (with room for geocentric ones), quaternion,
velocity [m/s], body rates [rad/s], time [s] (with room for that of the day). What is beyond is a fault, not a
flight."""
TURN_MIN, TURN_MAX = 0.25, 4.0
"""Squared norm that a quaternion can have before it is none: one of zeros turns every vector to zero."""
VOLTAGE_MAX = 1e4
"""Largest voltage of a battery [V] that a flight can have."""
IMPLAUSIBLE = "the state is not finite, or none that a flight can have: no correction"


def state_row(state: State) -> Array:
    """The first of the states as `physics_program.STATE` (15,); nan for a voltage that is not known."""
    voltage = [math.nan] if state.voltage is None else state.voltage[:1]
    parts = (state.position_E[0], state.quat_EB[0], state.velocity_E[0], state.omega_B[0], state.time[:1], voltage)
    return np.concatenate(parts)


def plausible(state: State, *, powered: bool = False) -> bool:
    """Whether the first of the states is one that a flight can have; its voltage too where an effect is `powered`."""
    row = state_row(state)
    turns = TURN_MIN <= float(row[3:7] @ row[3:7]) <= TURN_MAX
    return bool(turns and np.all(np.abs(row[:-1]) <= STATE_MAX) and (not powered or abs(row[-1]) <= VOLTAGE_MAX))
