"""Steps that the exported code must repeat: desired wrenches among the process's own training commands, in motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wrenchgap.compensate import Combined, Compensator
from wrenchgap.compensate.run import run
from wrenchgap.compensate.state_row import rows_of
from wrenchgap.flight import so3
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.mismatch import output_indices
from wrenchgap.plant.state import State
from wrenchgap.plant.vehicle import GRAVITY, Vehicle

STEPS = 60
PACE = 12
"""Steps from one command to the next."""
SPEED, RATE, HEIGHT, VOLTAGE = 1.5, 0.6, 2.0, 15.0
"""Of the motion: m/s, rad/s, m, V. Moderate, so that every effect has something to do."""
HIDDEN = 0.5
"""Share of its bounds that an observer has to find."""


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


@dataclass(frozen=True)
class Vectors:
    """Inputs (K, 27) and results (K, 13) of the self-test, the mean number of evaluations, and the share solved.

    The self-test ends before the first of the `STEPS` that is not solved: where there is no solution, rounding decides
    where the search ends, and another precision ends elsewhere.
    """

    given: Array
    wanted: Array
    evaluations: float
    solved: float


def recorded(helper: Compensator | Combined, commands: Array | None, vehicle: Vehicle) -> Vectors:
    """What the exported code must repeat, among `commands` (N, 6) or about hover."""
    dt = helper.dt if isinstance(helper, Combined) else helper.settings.dt
    desired, states = wrenches(commands, vehicle.body.mass, dt), motion(dt)
    helper.reset()
    if isinstance(helper, Combined):
        omega, wanted, evaluations, accepted = _observed(helper, desired, states)
        states = replace(states, omega_B=omega)
    else:
        found = run(helper, desired, states)
        expected = found.wrench_cmd.copy()
        expected[:, output_indices(helper.model.outputs)] += found.after
        wanted = np.hstack((found.wrench_cmd, expected, found.beta[:, None]))
        evaluations, accepted = found.iterations.astype(float), found.accepted
    given = np.hstack((desired, np.zeros((STEPS, len(AXES))), rows_of(states)))
    count = STEPS if accepted.all() else max(1, int(np.argmin(accepted)))
    return Vectors(given[:count], wanted[:count], float(np.mean(evaluations)), float(np.mean(accepted)))


def _observed(helper: Combined, desired: Array, states: State) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Rates (STEPS, 3), results (STEPS, 13), evaluations and whether solved, step by step with an observer.

    The rates are those of a body that makes what the feed-forward is asked for, late by the delay, and feels a torque
    nobody knows of, so that the estimate has something to find: `HIDDEN` of its bounds.
    """
    J, omega, asked = helper.inertia, states.omega_B[0], []
    rates, wanted, evaluations, accepted = [], [], [], []
    late = math.ceil(helper.delay / helper.dt)
    for k, wrench in enumerate(desired):
        now = replace(states.take(slice(k, k + 1)), omega_B=omega[None])
        made = helper.step(wrench, now)
        ahead = helper.feedforward
        expected = made.wrench_cmd.copy()
        if ahead is not None:
            expected[output_indices(ahead.model.outputs)] += ahead.expected(made.wrench_cmd)
        rates.append(omega)
        wanted.append(np.concatenate((made.wrench_cmd, expected, [made.beta])))
        evaluations.append(made.iterations)
        accepted.append(made.accepted)
        asked.append(wrench[3:] - helper.estimate)
        hidden = HIDDEN * helper.torque_max * np.sin(np.array([3.0, 5.0, 7.0]) * k * helper.dt)
        torque = asked[max(len(asked) - 1 - late, 0)] + hidden - np.cross(omega, J @ omega)
        omega = omega + helper.dt * np.linalg.solve(J, torque)
    return np.array(rates), np.array(wanted), np.array(evaluations, dtype=float), np.array(accepted)
