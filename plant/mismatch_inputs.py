"""Further inputs of a mismatch model: the motion of the body, and past commands.

    velocity   velocity of O in B                                                                 [m/s]
    rates      angular velocity in B                                                              [rad/s]
    position   of O in E                                                                          [m]
    past       W - y of the command sent last, y' = (W - y) / tau, tau = `PAST_SECONDS`           [N, Nm]

`past` is how far the command runs ahead of its own lag: for slow signals tau times its rate of change. What servos and
motors that follow late leave of a command is a function of it, and tilt rates are, since the allocation maps commands
to tilts. (The paper's conclusion on body z asks for the past of the command as input.)

All are known before the next command is chosen, so that a model that has them is, at any instant, a function of the
command alone (`plant.mismatch.Follower`).
"""

from collections.abc import Sequence

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.effects.lag import LagMemory, first_order
from wrenchgap.plant.state import State

PAST_SECONDS = 0.05
"""Time constant of `past` [s]: between the 15 and 90 ms of tilt servos."""

_XYZ = ("x", "y", "z")
COLUMNS: dict[str, tuple[str, ...]] = {
    "velocity": tuple(f"velocity_{k}" for k in _XYZ),
    "rates": tuple(f"rate_{k}" for k in _XYZ),
    "position": tuple(f"position_{k}" for k in _XYZ),
    "past": tuple(f"past_{name}" for name in AXES),
}
"""Columns of every group of inputs, by its name."""

POSED = ("velocity", "position")
"""Groups that need the pose of the hull."""


def ordered_groups(names: Sequence[str]) -> tuple[str, ...]:
    """The groups in the order of `COLUMNS`; raises UsageError on an unknown name or one that comes twice."""
    for name in names:
        if name not in COLUMNS:
            raise UsageError(f"inputs: unknown group {name!r}; available besides the wrench: {', '.join(COLUMNS)}")
    if len(set(names)) < len(names):
        raise UsageError(f"inputs: {', '.join(names)} names a group twice")
    return tuple(name for name in COLUMNS if name in names)


def columns(names: Sequence[str]) -> tuple[str, ...]:
    """Names of the columns of these groups."""
    return tuple(column for name in names for column in COLUMNS[name])


def extra_inputs(
    names: Sequence[str], sent: Array, state: State, dt: float, memory: LagMemory | None = None
) -> tuple[Array, LagMemory | None]:
    """Inputs (N, E) of these groups at N instants `dt` [s] apart, and the memory to hand to the next call.

    `sent` (N, 6) are the commands sent last before each instant, `state` the N states. Without memory the command is
    taken to have been constant before.
    """
    parts: list[Array] = [np.empty((len(sent), 0))]
    for name in names:
        if name == "velocity":
            parts.append(so3.rotate(so3.conjugate(state.quat_EB), state.velocity_E))
        elif name == "rates":
            parts.append(state.omega_B)
        elif name == "position":
            parts.append(state.position_E)
        else:
            late, memory = first_order(sent, PAST_SECONDS, dt, memory)
            parts.append(sent - late)
    return np.hstack(parts), memory
