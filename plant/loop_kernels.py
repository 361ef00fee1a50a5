"""The compiled clock of a loop (`plant.loop`): which stage is due at which step, and its tape upon the signals."""

# mypy: disable-error-code="no-any-return"

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.plant.tape_kernels import compiled, evaluate

Ints = NDArray[np.int64]


LINES, READS, ROWS, WRITES, LOGS, GIVEN, LOGGED = range(7)
"""Columns of `Plan.begin`."""


class Plan(NamedTuple):
    """S stages as compiled code takes them, each part of theirs one behind the other.

    code, value  (n, 4), (n,) lines of all tapes (`plant.tape.Program`), and room for their values
    reads        (R, 2) a line, and the place of the signal that it takes
    rows         (G,) lines that take the row that is given
    writes       (W, 2) a line with a result, and the place of the signal that it becomes
    logs         (L,) places of signals that are kept
    given        all rows that are given
    logged       all that is kept
    begin        (S + 1, 7) where each of these begins for a stage
    every        (S,) steps from one time to the next
    calls        (S,) steps in which Python is asked instead
    stop         place of the signal that ends the loop where it is not zero
    """

    code: NDArray[np.int32]
    value: Array
    reads: Ints
    rows: Ints
    writes: Ints
    logs: Ints
    given: Array
    logged: Array
    begin: Ints
    every: Ints
    calls: Ints
    stop: int


@compiled
def act(plan: Plan, signals: Array, s: int, k: int) -> None:
    """Stage s, for the k-th time."""
    begin, end, value = plan.begin[s], plan.begin[s + 1], plan.value
    for i in range(begin[READS], end[READS]):
        value[plan.reads[i, 0]] = signals[plan.reads[i, 1]]
    width = end[ROWS] - begin[ROWS]
    for i in range(width):
        value[plan.rows[begin[ROWS] + i]] = plan.given[begin[GIVEN] + k * width + i]
    evaluate(plan, begin[LINES], end[LINES])
    for i in range(begin[WRITES], end[WRITES]):
        signals[plan.writes[i, 1]] = value[plan.writes[i, 0]]


@compiled
def keep(plan: Plan, signals: Array, s: int, k: int) -> None:
    """Log what stage s keeps, for the k-th time."""
    begin = plan.begin[s]
    width = plan.begin[s + 1, LOGS] - begin[LOGS]
    for i in range(width):
        plan.logged[begin[LOGGED] + k * width + i] = signals[plan.logs[begin[LOGS] + i]]


@compiled
def advance(plan: Plan, signals: Array, n: int, s: int, end: int) -> tuple[int, int]:
    """Steps from stage s of step n until step `end`, a stage that Python acts for, or one that stops the loop.

    The step, and the stage that is next: -1 where the loop was stopped.
    """
    count = len(plan.every)
    while n < end:
        while s < count:
            if n % plan.every[s] == 0:
                if n < plan.calls[s]:
                    return n, s
                act(plan, signals, s, n // plan.every[s])
                keep(plan, signals, s, n // plan.every[s])
                if signals[plan.stop] != 0.0:
                    return n, -1
            s += 1
        s = 0
        n += 1
    return n, 0
