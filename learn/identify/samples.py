"""What a process is learnt from: filtered commands, and what a model leaves of the measured wrench.

Samples are thinned to 1 / (2 f_c) or more, because the filter has made closer ones dependent (Nyquist: a signal below
f_c has 2 f_c independent values per second).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.data.candidates import check_effects
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.data.prediction import Predictor, process_inputs
from wrenchgap.learn.identify.lag import Stretch, lagged
from wrenchgap.plant.model import Model


@dataclass(frozen=True)
class Samples:
    """What is learnt from: `inputs` (M, D), the command first, and mismatch `outputs` (M, 6), `spacing` [s] apart."""

    inputs: Array
    outputs: Array
    spacing: float


def samples(records: Sequence[Record], model: Model, groups: Sequence[str] = (), lags: Array | None = None) -> Samples:
    """Inputs and mismatches of all records, thinned to at least 1 / (2 f_c).

    With `lags` (6,) [s] what the model expects is late by them, and the commands by the largest
    (`learn.identify.lag`). Raises FitError where an effect of the model, or a group of inputs, needs what a log lacks.
    """
    inputs, outputs = [], []
    spacing = 0.0
    for record, part in zip(records, stretches(records, model), strict=True):
        step = _step(record)
        seen, expected = process_inputs(groups, record), part.expected
        if lags is not None and lags.any():
            late = lagged(seen[:, : len(AXES)], float(lags.max()), part.dt)
            seen, expected = np.hstack((late, seen[:, len(AXES) :])), lagged(expected, lags, part.dt)
        inputs.append(seen[::step])
        outputs.append((part.measured - expected)[::step])
        spacing = part.dt * step
    return Samples(np.concatenate(inputs), np.concatenate(outputs), spacing)


def sampled_inputs(records: Sequence[Record], groups: Sequence[str]) -> Array:
    """The inputs (M, D) of `samples` alone."""
    return np.concatenate([process_inputs(groups, record)[:: _step(record)] for record in records])


def _step(record: Record) -> int:
    """From one sample of a record to the next independent one."""
    return max(1, math.ceil(1.0 / (2.0 * record.cutoff_hz * record.dt_kept) - 1e-9))


def stretches(records: Sequence[Record], model: Model) -> list[Stretch]:
    """Commands, what the model expects of them, and what was measured, at the samples that are compared."""
    check_effects(model.effects, model, records)
    physics = Predictor("physics", model.wrench_model)
    return [Stretch(r.dt_kept, r.commanded, physics.predict(r, model.vehicle.body), r.measured) for r in records]
