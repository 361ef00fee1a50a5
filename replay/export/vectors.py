"""Steps that the exported code must repeat: desired wrenches among the process's own training commands, in motion."""

from __future__ import annotations

import numpy as np

from wrenchgap.compensate import Compensator
from wrenchgap.compensate.physics_program import rows_of
from wrenchgap.compensate.run import run
from wrenchgap.flight import so3
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.mismatch import output_indices
from wrenchgap.plant.state import State
from wrenchgap.plant.vehicle import GRAVITY

STEPS = 60
PACE = 12
"""Steps from one command to the next."""
SPEED, RATE, HEIGHT, VOLTAGE = 1.5, 0.6, 2.0, 15.0
"""Of the motion: m/s, rad/s, m, V. Moderate, so that every effect has something to do."""


def motion(dt: float) -> State:
    """A slow turn about all axes (N = STEPS)."""
    t = np.arange(STEPS, dtype=float) * dt
    turn = np.stack((np.sin(3.0 * t), np.sin(2.0 * t + 1.0), np.sin(2.5 * t + 2.0)), axis=1)
    place = turn + np.array([0.0, 0.0, HEIGHT])
    return State(t, place, so3.exp(0.5 * turn), SPEED * turn[:, ::-1], RATE * turn, np.full(STEPS, VOLTAGE))


def wrenches(commands: Array | None, mass: float, dt: float) -> Array:
    """Desired wrenches (STEPS, 6): from one of `commands` (N, 6) to the next; about hover where there are none."""
    if commands is None or not len(commands):
        t = np.arange(STEPS)[:, None] * dt
        weight = mass * GRAVITY
        swing = np.sin(t * np.arange(1, 7)) * weight * np.array([0.1, 0.1, 0.1, 0.01, 0.01, 0.01])
        return np.asarray(swing + weight * np.eye(6)[2])
    stops = commands[np.linspace(0, len(commands) - 1, STEPS // PACE + 2).astype(int)]
    place = np.arange(STEPS) / PACE
    return np.stack([np.interp(place, np.arange(len(stops)), column) for column in stops.T], axis=1)


def recorded(compensator: Compensator, commands: Array | None, mass: float) -> tuple[Array, Array, float, float]:
    """Inputs (K, 27) and results (K, 13) of the self-test, the mean number of evaluations, and the share solved.

    The self-test ends before the first of the `STEPS` that is not solved: where there is no solution, rounding decides
    where the search ends, and another precision ends elsewhere.
    """
    dt = compensator.settings.dt
    desired, states = wrenches(commands, mass, dt), motion(dt)
    compensator.reset()
    found = run(compensator, desired, states)
    given = np.hstack((desired, np.zeros((STEPS, len(AXES))), rows_of(states, np.arange(STEPS))))
    expected = found.wrench_cmd.copy()
    expected[:, output_indices(compensator.model.outputs)] += found.after
    wanted = np.hstack((found.wrench_cmd, expected, found.beta[:, None]))
    count = STEPS if found.accepted.all() else max(1, int(np.argmin(found.accepted)))
    return given[:count], wanted[:count], float(found.iterations.mean()), float(found.accepted.mean())
