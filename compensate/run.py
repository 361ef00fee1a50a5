"""Many steps of a compensation at once, as a replay takes them."""

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from wrenchgap.compensate.compensator import Compensator
from wrenchgap.compensate.kernels import EXPECTED, LIMITED
from wrenchgap.compensate.tables import STATE, rows_of
from wrenchgap.flight.flight import Array, Mask
from wrenchgap.plant.state import State

BLOCK = 128
"""Steps whose time is taken together, so that the clock costs nothing."""


@dataclass(frozen=True)
class Run:
    """K consecutive steps; names and shapes are those of `compensate.Result`, with the steps first.

    `before` and `after` (K, L) are the mismatch expected of the desired and of the sent command. `solve_time` (K,) [s]
    is the mean over the block of `BLOCK` steps in which a step lies, both expectations included. `trouble` says what
    went wrong, in which step.
    """

    wrench_cmd: Array
    correction: Array
    optimum: Array
    sigma: Array
    beta: Array
    cost: Array
    iterations: NDArray[np.int64]
    accepted: Mask
    limited: Mask
    before: Array
    after: Array
    solve_time: Array
    trouble: dict[int, str]


def run(compensator: Compensator, wrenches: Array, states: State | None) -> Run:
    """Step through desired wrenches (K, 6) in `states` (N = K), from what the compensator remembers.

    Raises UsageError where the states are needed and None.
    """
    compensator.check_voltage(states)
    outputs = len(compensator.model.outputs)
    rows = np.empty((len(wrenches), EXPECTED + 2 * outputs))
    took, trouble = np.empty(len(wrenches)), dict[int, str]()
    numbers = np.zeros((len(wrenches), len(STATE))) if states is None else rows_of(states)
    compiled = compensator.steps_compiled(states is not None)
    for start in range(0, len(wrenches), BLOCK):
        part = slice(start, min(start + BLOCK, len(wrenches)))
        began = perf_counter()
        if compiled is not None:
            said = compiled.many(wrenches[part], numbers[part], rows[part])
        else:
            rows[part], said = compensator.rows_by_step(wrenches[part], None if states is None else states.take(part))
        trouble |= {start + k: text for k, text in said.items()}
        took[part] = (perf_counter() - began) / (part.stop - start)
    return Run(
        wrench_cmd=rows[:, :6],
        correction=rows[:, 6:12],
        optimum=rows[:, 12:18],
        sigma=rows[:, 18],
        beta=rows[:, 19],
        cost=rows[:, 20],
        iterations=rows[:, 21].astype(int),
        accepted=rows[:, 22] > 0.0,
        limited=rows[:, LIMITED] > 0.0,
        before=rows[:, EXPECTED : EXPECTED + outputs],
        after=rows[:, EXPECTED + outputs :],
        solve_time=took,
        trouble=trouble,
    )
