"""The state as a row of numbers, the input of a step of the compensation."""

from __future__ import annotations

import math

import numpy as np

from wrenchgap.compensate.tables import Ints
from wrenchgap.flight.flight import Array
from wrenchgap.plant.state import State

STATE = (
    *(f"position_{k}" for k in "xyz"),
    *(f"quat_{k}" for k in "wxyz"),
    *(f"velocity_{k}" for k in "xyz"),
    *(f"omega_{k}" for k in "xyz"),
    "time",
    "voltage",
)
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


def plausible(state: State, *, powered: bool = False) -> bool:
    """Whether the first of the states is one that a flight can have; its voltage too where an effect is `powered`."""
    from wrenchgap.compensate.kernels import is_plausible

    return bool(is_plausible(looked_at(True, powered=powered), state_row(state)))
