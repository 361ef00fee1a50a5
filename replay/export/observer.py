"""The observer beside an exported compensation: which one is asked for, its constants, what it costs."""

import math
from collections import Counter
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from wrenchgap.compensate import Combined, Compensator
from wrenchgap.compensate.compensator import largest_correction
from wrenchgap.flight import AXES, UsageError
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant.mismatch import output_indices
from wrenchgap.plant.model import Model
from wrenchgap.replay.compensation.compensators import TORQUE, Judged, no_bandwidth, told_observer
from wrenchgap.replay.export.c_lines import Cost

Asked = float | Literal["log"] | None
"""Bandwidth [Hz], or that of the training log; None: no observer."""


def observed(
    bandwidth: Asked,
    most: float | None,
    ahead: Compensator | None,
    process: GaussianProcess | None,
    model: Model,
    dt: float,
) -> Combined | None:
    """`ahead` and observer as they are to be exported; None where no observer is asked for.

    The observer corrects `most` [Nm] on every axis, by default three times the largest mismatch in the training data.

    Raises UsageError where bandwidth or bounds are not known, in one line that says what to give.
    """
    if bandwidth is None:
        if most is not None:
            raise UsageError("export: --observer-max is given without --observer; say --observer log or --observer HZ")
        return None
    hz = _bandwidth(bandwidth, process, dt)
    if most is not None and not (math.isfinite(most) and most > 0.0):
        raise UsageError(f"export: --observer-max is {most}, expected a positive number of newton metres")
    bounds = np.full(3, np.inf if most is None else most)
    if most is None and process is not None:
        every = np.full(len(AXES), np.inf)
        every[output_indices(process.outputs)] = largest_correction(process)
        bounds = every[3:]
    free = [axis for axis, bound in zip(TORQUE, bounds, strict=True) if not math.isfinite(bound)]
    if free:
        raise UsageError(
            f"export: nothing bounds the observer's estimate of {', '.join(free)}, of which no mismatch was learnt; "
            "give the largest torque that it may correct with --observer-max NM"
        )
    told = told_observer(process, model, hz)
    return Combined(model.vehicle, dt, hz, ahead, lag=told.lag, delay=told.delay, torque_max=bounds)


def _bandwidth(asked: float | str, process: GaussianProcess | None, dt: float) -> float:
    if asked != "log":
        if isinstance(asked, str) or not (math.isfinite(asked) and asked > 0.0):
            raise UsageError(f"export: --observer is {asked!r}, expected a positive bandwidth in Hz, or log")
        return float(asked)
    known = None if process is None else process.provenance.observer_hz
    if known is None:
        what = "there is no GP; give it in Hz" if process is None else f"the GP has none: {no_bandwidth(process)}"
        raise UsageError(f"export: --observer log asks for the bandwidth from the log, and {what}")
    return min(known, 1.0 / (2.0 * math.pi * dt))


def observer_context(made: Combined, judged: Judged) -> dict[str, Any]:
    """What the templates ask for: in words, and how many torques are remembered."""
    return {
        "hz": f"{made.bandwidth_hz:.4g}",
        "delay": f"{made.delay:g}",
        "lag": f"{made.lag[0]:g}",
        "loop_lag": f"{judged.loop.lag:g}",
        "peak": f"{judged.peak:.2f}",
        "most": ", ".join(f"{v:g}" for v in made.torque_max),
        "asked": remembered(made),
    }


def remembered(made: Combined) -> int:
    """How many of the torques that were asked for are kept."""
    return math.ceil(made.delay / made.dt) + 2


def with_observer(price: Cost, made: Combined, number: int) -> Cost:
    """The cost of a step with the observer: operations, its constants and its memory; `number` are a number's bytes."""
    more = Counter(multiply=9 + 6 + 6 + 9 + 9, add=9 + 3 + 12 + 21 + 3, divide=6, other=12 + 3 * remembered(made))
    return replace(
        price,
        usual={kind: count + more[kind] for kind, count in price.usual.items()},
        at_worst={kind: count + more[kind] for kind, count in price.at_worst.items()},
        tables=price.tables + number * (9 + 5 * 3),
        memory=price.memory + number * (21 + 3 * remembered(made)),
    )
