"""A compensator stepped through a series of desired wrenches."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.compensate import Compensator
from wrenchgap.flight.flight import Array
from wrenchgap.plant.mismatch import output_indices
from wrenchgap.plant.state import State

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Steps:
    """What the compensator did in K steps, in order; see `compensate.Result` for each field.

    `commanded`, `correction`, `optimum` are (K, 6) [N, Nm], the others (K,). `mismatch_before` (K, L) is the mismatch
    mu(W) that the model expects of the wrench as it is, `mismatch_after` (K, L) what is left of it, mu(W + dW) + dW.
    `solve_time` [s] is wall-clock time, the only thing here that differs between two equal runs. `trouble` counts
    messages.
    """

    commanded: Array
    correction: Array
    optimum: Array
    mismatch_before: Array
    mismatch_after: Array
    sigma: Array
    beta: Array
    cost: Array
    iterations: NDArray[np.int64]
    accepted: NDArray[np.bool_]
    solve_time: Array
    trouble: dict[str, int]


def step_through(
    compensator: Compensator,
    wrench: Array,
    motion: State | None,
    starts: NDArray[np.intp],
    progress: Progress | None = None,
) -> Steps:
    """Compensate wrenches (K, 6) one after the other; forget the past at every index in `starts`."""
    fresh, results = set(starts.tolist()), []
    rows = output_indices(compensator.model.outputs)
    before, after = [], []
    every = max(1, len(wrench) // 100)
    for k, row in enumerate(wrench):
        if k in fresh:
            compensator.reset()
        one = compensator.step(row, None if motion is None else motion.take(slice(k, k + 1)))
        results.append(one)
        before.append(compensator.expected(row))
        after.append(compensator.expected(one.wrench_cmd) + one.correction[rows])
        if progress is not None and k % every == 0:
            progress(k / len(wrench), f"step {k} of {len(wrench)}")
    same = ("correction", "optimum", "sigma", "beta", "cost", "iterations", "accepted", "solve_time")
    return Steps(
        commanded=np.array([r.wrench_cmd for r in results]),
        mismatch_before=np.array(before),
        mismatch_after=np.array(after),
        trouble=dict(Counter(r.trouble for r in results if r.trouble)),
        **{name: np.array([getattr(r, name) for r in results]) for name in same},
    )
