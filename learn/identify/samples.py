"""What a process is learnt from: filtered commands, behind a lag where there is one, and what a model leaves.

Why samples are thinned and commands lagged first: docs/theory/process.md, Points and Lag. With tau,

    tau y' = u - y,         z_tau = W_meas - y(physics of W_cmd),       a function of y(W_cmd)

which is exact for a function behind a lag. Actuators are shared: an output to whose own command the process is blind
(`learn.identify.guard`) has the lag of the axes that show theirs, and where none does, one that is looked
for on all such outputs together. On these W_meas alone shows it, since -y(W_cmd) is as good a function of y behind any
lag: too little for one output by itself. tau is, output by output, what predicts held-out blocks best with a
quadratic in y(W_cmd); zero where that is no better than without, beyond chance (`learn.data.blocks`). The process then
learns the function alone. The lag itself is not compensated: name it for that (`wrenchgap explain`, `--lead`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import AXES, Array, Indices, Mask
from wrenchgap.learn.data.blocks import by_block, paired_t, significant
from wrenchgap.learn.data.candidates import check_effects
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.data.prediction import Predictor, process_inputs
from wrenchgap.learn.process.held_out_time import CALIBRATION, left_out
from wrenchgap.plant.effects.lag import first_order
from wrenchgap.plant.model import Model


@dataclass(frozen=True)
class LagSettings:
    """Which lags are tried, and from when on one is believed."""

    taus: tuple[float, ...] = (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.1, 0.12, 0.15, 0.2)
    """Time constants that are tried [s]."""
    least_gain: float = 0.05
    """Share of the rms on held-out time that a lag must take off."""
    ridge: float = 1e-3
    """Ridge of the regression, over the samples."""


LAG = LagSettings()


@dataclass(frozen=True)
class Stretch:
    """Consecutive samples `dt` [s] apart: commands (K, 6), what the physics expects of them and what was measured."""

    dt: float
    commanded: Array
    expected: Array
    measured: Array


def lagged(signal: Array, tau: float | Array, dt: float) -> Array:
    """Samples (K, D) behind a first-order lag; one time constant [s] for all columns, or one each (D,)."""
    return first_order(signal, tau, dt, None)[0]


def lags(stretches: Sequence[Stretch], looks: Mask) -> Array:
    """Time constants (6,) [s] of the lag that held-out time supports; `looks` (6,) are the usable command components.

    Zero on outputs that were not measured.
    """
    errors = np.stack([held_out(stretches, looks, tau) for tau in LAG.taus])
    count = errors.shape[1]
    block = CALIBRATION.block(count)
    found = np.zeros(len(AXES))
    for k in range(len(AXES)):
        square = errors[:, :, k] ** 2
        if not np.isfinite(square).all():
            continue
        best = int(np.argmin(square.mean(axis=1)))
        gain = 1.0 - float(np.sqrt(square[best].mean() / max(float(square[0].mean()), 1e-300)))
        if gain > LAG.least_gain and significant(
            float(paired_t(by_block(block, square[0] - square[best]))), large=True
        ):
            found[k] = LAG.taus[best]
    return found


def shared_lag(stretches: Sequence[Stretch], looks: Mask, outputs: Indices) -> float:
    """The one time constant [s] that held-out time supports on `outputs` (places in a wrench), all weighing the same.

    Without a test of significance: a process that is blind to all outputs has no slope with which a wrong lag could
    do harm, and what it gains by it is decided on held-out time later.
    """
    squares = np.stack([held_out(stretches, looks, tau)[:, outputs] ** 2 for tau in LAG.taus]).mean(axis=1)
    relative = (squares / np.maximum(squares[0], 1e-300)).mean(axis=1)
    if not np.isfinite(relative).all():
        return 0.0
    best = int(np.argmin(relative))
    return LAG.taus[best] if 1.0 - float(np.sqrt(relative[best])) > LAG.least_gain else 0.0


def held_out(stretches: Sequence[Stretch], looks: Mask, tau: float) -> Array:
    """Errors (K, 6) of a quadratic in the lagged command, each sample predicted from the other folds."""
    command = np.concatenate([lagged(s.commanded, tau, s.dt) for s in stretches])[:, looks]
    residual = np.concatenate([s.measured - lagged(s.expected, tau, s.dt) for s in stretches])
    spread = command.std(axis=0)
    x = (command - command.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
    pairs = np.triu_indices(x.shape[1])
    features = np.column_stack([np.ones(len(x)), x, x[:, pairs[0]] * x[:, pairs[1]]])

    def predict(given: Mask, asked: Indices) -> tuple[Array]:
        a, z = features[given], np.nan_to_num(residual[given])
        normal = a.T @ a + LAG.ridge * len(a) * np.eye(a.shape[1])
        return (features[asked] @ np.linalg.solve(normal, a.T @ z),)

    return residual - left_out(len(x), np.arange(len(x)), predict)[0]


@dataclass(frozen=True)
class Samples:
    """What is learnt from: `inputs` (M, D), the command first, and mismatch `outputs` (M, 6), `spacing` [s] apart."""

    inputs: Array
    outputs: Array
    spacing: float


def samples(records: Sequence[Record], model: Model, groups: Sequence[str] = (), lags: Array | None = None) -> Samples:
    """Inputs and mismatches of all records, thinned to at least 1 / (2 f_c).

    With `lags` (6,) [s] what the model expects is late by them, and the commands by the largest. Raises FitError
    where an effect of the model, or a group of inputs, needs what a log lacks.
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
