"""The state as a row of numbers, the input of a step of the compensation."""

import math

import numpy as np

from wrenchgap.compensate.tables import Ints
from wrenchgap.flight.flight import Array
from wrenchgap.plant.state import State

LARGEST = {
    **{f"position_{k}": 1e8 for k in "xyz"},
    **{f"quat_{k}": 2.0 for k in "wxyz"},
    **{f"velocity_{k}": 1e3 for k in "xyz"},
    **{f"omega_{k}": 1e3 for k in "xyz"},
    "time": 1e10,
    "voltage": 1e4,
}
"""Largest numbers that the state of a flight can have; beyond is a fault. In E and B, in SI units: geocentric positions
and the time of day fit in."""
STATE = tuple(LARGEST)
"""Names of the state's numbers, in their order."""
IMPLAUSIBLE = "the state is not finite, or none that a flight can have: no correction"


def rows_of(states: State) -> Array:
    """States (K, 15) as `STATE`; nan for a voltage that is not known."""
    voltage = np.full(len(states.time), np.nan) if states.voltage is None else states.voltage
    parts = (states.position_E, states.quat_EB, states.velocity_E, states.omega_B)
    return np.hstack([*parts, states.time[:, None], voltage[:, None]])


def state_row(state: State) -> Array:
    """The first of the states (15,)."""
    voltage = [math.nan] if state.voltage is None else state.voltage[:1]
    parts = (state.position_E[0], state.quat_EB[0], state.velocity_E[0], state.omega_B[0], state.time[:1], voltage)
    return np.concatenate(parts)


def looked_at(moves: bool, *, powered: bool) -> Ints:
    """Which numbers of a state (15,) must be such as a flight can have: of all the motion, or none; the voltage."""
    return np.array([moves] * (len(STATE) - 1) + [powered], dtype=np.int64)
