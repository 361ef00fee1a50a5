"""A replay in numbers."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.identify.learning import NEARLY_SINGULAR
from wrenchgap.replay.compensation.replay import Replay

HELD_BACK = 0.5
"""beta above which the uncertainty filter counts as holding the correction back."""
PERCENTILES = (5, 50, 95, 100)


@dataclass(frozen=True)
class Summary:
    """A replay in numbers. Arrays are (6,) over `AXES` or (L,) over the outputs of the GP, in N and Nm.

    `sigma` and `beta` are the `PERCENTILES`; `held_back`, `accepted` and `near_singular` are shares of the steps.
    `measured_minus_logged` and `measured_minus_predicted` are mean absolute errors behind the
    filter on both sides, nan where nothing was measured.
    """

    source: str
    steps: int
    duration: float
    restarts: int
    correction_mean_abs: Array
    correction_max_abs: Array
    accepted: float
    iterations_mean: float
    sigma: Array
    sigma_threshold: float
    beta: Array
    held_back: float
    outputs: tuple[str, ...]
    error_before_mean_abs: Array
    error_after_mean_abs: Array
    error_before_max_abs: Array
    error_after_max_abs: Array
    measured_minus_logged: Array
    measured_minus_predicted: Array
    eigenvalue_min: float
    near_singular: float
    saturation: dict[str, int] | None
    saturation_logged: dict[str, int] | None
    solve_mean_ms: float
    solve_p99_ms: float
    solve_max_ms: float
    trouble: dict[str, int]


def summarise(replay: Replay) -> Summary:
    """The numbers of a replay."""
    steps = replay.steps
    size = np.abs(steps.correction)
    before, after = np.abs(steps.mismatch_before), np.abs(steps.mismatch_after)
    solve = 1e3 * steps.solve_time
    return Summary(
        source=replay.source,
        steps=len(replay),
        duration=float(replay.time[-1] - replay.time[0]),
        restarts=replay.restarts,
        correction_mean_abs=size.mean(axis=0),
        correction_max_abs=size.max(axis=0),
        accepted=float(steps.accepted.mean()),
        iterations_mean=float(steps.iterations.mean()),
        sigma=np.percentile(steps.sigma, PERCENTILES),
        sigma_threshold=replay.sigma_threshold,
        beta=np.percentile(steps.beta, PERCENTILES),
        held_back=float((steps.beta > HELD_BACK).mean()),
        outputs=replay.outputs,
        error_before_mean_abs=before.mean(axis=0),
        error_after_mean_abs=after.mean(axis=0),
        error_before_max_abs=before.max(axis=0),
        error_after_max_abs=after.max(axis=0),
        measured_minus_logged=_mean_abs(replay.measured - replay.logged_filtered),
        measured_minus_predicted=_mean_abs(replay.measured - replay.predicted),
        eigenvalue_min=float(replay.conditioning.real_min.min()),
        near_singular=float((replay.conditioning.real_min < NEARLY_SINGULAR).mean()),
        saturation=None if replay.saturation is None else asdict(replay.saturation),
        saturation_logged=None if replay.saturation_logged is None else asdict(replay.saturation_logged),
        solve_mean_ms=float(solve.mean()),
        solve_p99_ms=float(np.percentile(solve, 99)),
        solve_max_ms=float(solve.max()),
        trouble=steps.trouble,
    )


def _mean_abs(residual: Array) -> Array:
    """Mean absolute value (6,) of what is known; nan where nothing is, and on axes that were not measured."""
    known = np.isfinite(residual).any(axis=1)
    return np.abs(residual[known]).mean(axis=0) if known.any() else np.full(residual.shape[1], np.nan)
