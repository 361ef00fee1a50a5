"""The compensation of a recorded flight, step by step: optimiser and uncertainty filter on the logged wrenches.

    W_k  -> dW*_k = argmin |mu(W_k + dW) + dW|^2  -> filter -> dW_k,   W_cmd,k = W_k + dW_k

W_k is the logged desired wrench (what the controller wanted), or the logged command, at the log's own stamps; the
vehicle flew what it flew, so this shows what would have been commanded, not where it would have led (that is the
counterfactual). After a gap of the log the compensator starts afresh.

Measured and predicted wrenches go through one filter (`learn.data.measurement`) and are read at the same stamps; nan where
the log has no motion, in gaps and at their edges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from wrenchgap.compensate import Compensator, Settings
from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.flight.flight import AXES, ActuatorSeries, Flight, WrenchSeries
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.applicable import check_effects
from wrenchgap.learn.data.inputs import check
from wrenchgap.learn.data.measurement import CUTOFF_HZ, from_actuators
from wrenchgap.learn.data.opening import opened
from wrenchgap.learn.data.prediction import Predictor
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.learn.process.predictors import predictors
from wrenchgap.plant.allocation import Allocation, Saturation
from wrenchgap.plant.mismatch import Conditioning, conditioning, output_indices
from wrenchgap.plant.mismatch_inputs import extra_inputs
from wrenchgap.plant.model import Model
from wrenchgap.plant.state import State
from wrenchgap.plant.wrench_model import about_origin
from wrenchgap.replay.compensation import compensators as compensating

Array = NDArray[np.float64]
Source = Literal["desired", "commanded"]
Progress = Callable[[float, str], None]

CONDITIONED = 2000
"""Commands along the log at which I + dmu/dW is looked at, at most."""


@dataclass(frozen=True)
class Steps:
    """What the compensator did in K steps, in order; see `compensate.Result` for each field.

    `commanded`, `correction`, `optimum` are (K, 6) [N, Nm], the others (K,). `solve_time` [s] is wall-clock time, the
    only thing here that differs between two equal runs. `trouble` counts messages.
    """

    commanded: Array
    correction: Array
    optimum: Array
    sigma: Array
    beta: Array
    cost: Array
    iterations: NDArray[np.int64]
    accepted: NDArray[np.bool_]
    solve_time: Array
    trouble: dict[str, int]


@dataclass(frozen=True, repr=False)
class Replay(Result):
    """A flight with what the compensation would have done. K steps at `time` (K,) [s since the flight's start].

    source               which logged wrench went in
    input_topic          where it comes from
    wrench               (K, 6) that wrench: to the compensator it is the desired one
    logged               (K, 6) logged command (the plant's input), nan where unknown; `wrench` if that is the command
    measured             (K, 6) from the IMU, filtered
    predicted            (K, 6) model and GP at the logged command, filtered
    predicted_new        (K, 6) model and GP at the new command in the state that was flown, filtered
    mismatch_before      (K, L) mu(W): the wrench error without correction, on the outputs of the GP, physics included
                         where that is its mean
    mismatch_after       (K, L) mu(W + dW) + dW: what is left of it
    sigma_threshold      sigma at which half of the optimum is taken; inf where the filter is off
    dt                   [s], the period that the filter was told
    restarts             how many times the compensator started afresh after a gap
    saturation           of the new commands, and of the logged ones; None for a model without rotors
    """

    flight: Flight
    model: Model
    gp: GaussianProcess
    settings: Settings
    source: Source
    input_topic: str
    time: Array
    wrench: Array
    logged: Array
    measured: Array
    predicted: Array
    predicted_new: Array
    steps: Steps
    mismatch_before: Array
    mismatch_after: Array
    conditioning: Conditioning
    saturation: Saturation | None
    saturation_logged: Saturation | None
    sigma_threshold: float
    dt: float
    restarts: int
    notes: tuple[str, ...]

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the L axes that the GP knows."""
        return self.gp.outputs

    def __len__(self) -> int:
        return len(self.time)


def replay(
    flight: Flight,
    model: Model,
    gp: GaussianProcess,
    settings: Settings | None = None,
    *,
    source: Source | None = None,
    lead: float | None = None,
    progress: Progress | None = None,
) -> Replay:
    """Re-run the compensation on a flight; deterministic but for `Steps.solve_time`.

    `source` is by default the desired wrench where the log has it, else the commanded one, which is computed from the
    actuators where only they are logged. `settings.dt` is replaced by the log's period. `lead` [s] leads the lags of
    the physics, where that is the process's mean (`compensate.physics`).

    Raises FitError for a GP of another vehicle or physics, LogError where the log lacks the wrench, or the motion that
    the process wants to know.
    """
    gp.check_vehicle(model.vehicle.name)
    logged, notes = logged_command(flight, model)
    series, chosen = _input(flight, logged, source)
    cutoff = gp.provenance.cutoff_hz or CUTOFF_HZ
    candidates, said = predictors(model, (), gp, cutoff)
    predictor = candidates[-1]
    settings = replace(settings or Settings(), dt=series.period)
    starts = np.unique([0, *(int(np.searchsorted(series.time, gap.stop)) for gap in series.gaps)])
    starts = starts[starts < len(series.time)]
    compensated = compensating.compensator(gp, model, settings, lead=lead)
    motion = _motion(flight, model, compensated, gp, series, logged) if compensated.needs_state else None
    with threadpool_limits(1):
        steps, before, after = _run(compensated, series.wrench_B, motion, starts, progress)
        stride = max(1, len(series.time) // CONDITIONED)
        condition = conditioning(gp, _inputs(gp, series.wrench_B, motion, series.period)[::stride])
        measured, predicted, predicted_new, words = _predictions(
            flight, model, predictor, cutoff, series, logged, steps.commanded
        )
    return Replay(
        flight=flight,
        model=model,
        gp=gp,
        settings=settings,
        source=chosen,
        input_topic=series.topic,
        time=series.time,
        wrench=series.wrench_B,
        logged=_at(series.time, [] if logged is None else _pieces(logged)),
        measured=measured,
        predicted=predicted,
        predicted_new=predicted_new,
        steps=steps,
        mismatch_before=before,
        mismatch_after=after,
        conditioning=condition,
        saturation=_saturation(model, steps.commanded, starts, series.period),
        saturation_logged=_saturation(model, series.wrench_B, starts, series.period),
        sigma_threshold=float(compensated.uncertainty.threshold),
        dt=series.period,
        restarts=len(starts) - 1,
        notes=tuple(dict.fromkeys((*flight.notes, *notes, *words, *said, *compensating.notes(gp, model)))),
    )


def logged_command(flight: Flight, model: Model) -> tuple[WrenchSeries | None, tuple[str, ...]]:
    """The commanded wrench about the centre of mass, computed from the actuators where only they are logged.

    None where the log has neither, or only a desired wrench; the notes say what stands in for what. Raises FitError
    where actuators are logged that do not fit the model.
    """
    if flight.commanded is not None:
        return flight.commanded, ()
    actuators, vehicle = flight.actuators, model.vehicle
    if actuators is None or not vehicle.has_rotors or not actuators.rotor_speed.shape[1]:
        return None, ()
    wrench = from_actuators(flight.name, vehicle, actuators.tilt, actuators.rotor_speed).wrench_B
    note = f"{flight.name}: no commanded wrench in the log; computed from {actuators.topic} with the model's geometry."
    return WrenchSeries(actuators.topic, actuators.time, wrench, gaps=actuators.gaps), (note,)


def checked(source: str | None) -> Source | None:
    """The source by name; raises UsageError on another word."""
    for name in get_args(Source):
        if name == source:
            return cast(Source, name)
    if source is None:
        return None
    raise UsageError(f"--source {source}: expected {' or '.join(get_args(Source))}")


def _input(flight: Flight, logged: WrenchSeries | None, source: Source | None) -> tuple[WrenchSeries, Source]:
    """The series to compensate."""
    available: dict[Source, WrenchSeries | None] = {"desired": flight.desired, "commanded": logged}
    for name, series in available.items():
        if source in (None, name) and series is not None:
            return series, name
    have = ", ".join(name for name, series in available.items() if series is not None)
    if source is not None and have:
        raise LogError(
            f"{flight.path.name}: no topic plays the role '{source}'; use --source {have}, or map one with "
            f"--topic {source}=/your/topic"
        )
    played = ", ".join(flight.series()) or "none"
    raise LogError(
        f"{flight.path.name}: neither a desired or commanded wrench, nor actuators from which the model could compute "
        f"one; roles played: {played}. Map one with --topic commanded=/your/topic, or use a model with [[arms]]"
    )


def _motion(
    flight: Flight,
    model: Model,
    compensator: Compensator,
    gp: GaussianProcess,
    series: WrenchSeries,
    logged: WrenchSeries | None,
) -> State:
    """The state last known at every stamp of `series`, for what depends on it."""
    known = replace(flight, commanded=series if logged is None else logged, notes=())
    if flight.imu is None and flight.odometry is None:
        raise LogError(f"{flight.path.name}: this GP depends on the motion, and the log has neither IMU nor odometry")
    records = opened(known, model).records
    for record in records:
        check(gp.settings.inputs, record)
    if compensator.physics is not None:
        check_effects(compensator.physics.model.effects, model, records)
    every = State.joined([r.state for r in records])
    return every.take(np.maximum(np.searchsorted(every.time, series.time, side="right") - 1, 0))


def _inputs(gp: GaussianProcess, wrench: Array, motion: State | None, dt: float) -> Array:
    """What the process looks at along the series (K, D)."""
    if motion is None:
        return wrench
    extra, _ = extra_inputs(gp.settings.inputs, np.concatenate((wrench[:1], wrench[:-1])), motion, dt)
    return np.hstack((wrench, extra))


def _run(
    compensator: Compensator,
    wrench: Array,
    motion: State | None,
    starts: NDArray[np.int64],
    progress: Progress | None,
) -> tuple[Steps, Array, Array]:
    """Step through the series; forget the past at every index in `starts`.

    Also the mismatch (K, L) that is expected of the wrench as it is, and what is left of it after the correction.
    """
    fresh, results = set(starts.tolist()), []
    rows = output_indices(compensator.model.outputs)
    before, after = [], []
    every = max(1, len(wrench) // 100)
    for k, row in enumerate(wrench):
        if k in fresh:
            compensator.reset()
        results.append(compensator.step(row, None if motion is None else motion.take(slice(k, k + 1))))
        before.append(compensator.expected(row))
        after.append(compensator.expected(results[-1].wrench_cmd) + results[-1].correction[rows])
        if progress is not None and k % every == 0:
            progress(k / len(wrench), f"step {k} of {len(wrench)}")
    trouble: dict[str, int] = {}
    for one in results:
        if one.trouble:
            trouble[one.trouble] = trouble.get(one.trouble, 0) + 1
    steps = Steps(
        commanded=np.array([r.wrench_cmd for r in results]),
        correction=np.array([r.correction for r in results]),
        optimum=np.array([r.optimum for r in results]),
        sigma=np.array([r.sigma for r in results]),
        beta=np.array([r.beta for r in results]),
        cost=np.array([r.cost for r in results]),
        iterations=np.array([r.iterations for r in results], dtype=np.int64),
        accepted=np.array([r.accepted for r in results], dtype=bool),
        solve_time=np.array([r.solve_time for r in results]),
        trouble=trouble,
    )
    return steps, np.array(before), np.array(after)


def _predictions(
    flight: Flight,
    model: Model,
    predictor: Predictor,
    cutoff: float,
    series: WrenchSeries,
    logged: WrenchSeries | None,
    commanded: Array,
) -> tuple[Array, Array, Array, tuple[str, ...]]:
    """Measured, predicted at the logged command and predicted at the new one, (K, 6) each at the stamps of `series`.

    A log with only a desired wrench is taken to have been flown uncompensated: the desired wrench is the command.
    """
    unknown = np.full((len(series.time), len(AXES)), np.nan)
    if flight.imu is None and flight.odometry is None:
        words = f"{flight.name}: neither IMU nor odometry in the log, so no measured wrench to compare with."
        return unknown, unknown, unknown, (words,)
    notes: tuple[str, ...] = ()
    if logged is None:
        logged = series
        notes = (f"{flight.name}: only a desired wrench in the log; taken as what was commanded.",)
    every = 1.0 / series.period
    flown = replace(flight, commanded=logged, notes=())
    new = replace(
        flown,
        commanded=WrenchSeries("/replay/command", series.time, commanded, gaps=series.gaps),
        actuators=None,
    )
    try:
        before = opened(flown, model, cutoff_hz=cutoff, rate_hz=every)
        after = opened(new, model, cutoff_hz=cutoff, rate_hz=every)
    except LogError as error:  # a short log: still worth a replay
        return unknown, unknown, unknown, (*notes, f"no measured wrench: {error}")
    check_effects(predictor.model.effects, model, before.records)
    return (
        _at(series.time, [(r.time, r.measured) for r in before.records]),
        _at(series.time, [(r.time, predictor.predict(r, model.vehicle.body)) for r in before.records]),
        _at(series.time, [(r.time, predictor.predict(r, model.vehicle.body)) for r in after.records]),
        (*notes, *before.notes),
    )


def _pieces(series: WrenchSeries) -> list[tuple[Array, Array]]:
    """A series cut at its gaps."""
    cuts = [int(np.searchsorted(series.time, gap.stop)) for gap in series.gaps]
    return list(zip(np.split(series.time, cuts), np.split(series.wrench_B, cuts), strict=True))


def _at(time: Array, pieces: list[tuple[Array, Array]]) -> Array:
    """Piecewise wrenches, linear between their samples, at `time` (K,); nan between the pieces."""
    out = np.full((len(time), len(AXES)), np.nan)
    for knots, values in pieces:
        if len(knots) == 0:
            continue
        inside = (time >= knots[0]) & (time <= knots[-1])
        out[inside] = np.stack([np.interp(time[inside], knots, column) for column in values.T], axis=1)
    return out


def allocated(replay: Replay) -> ActuatorSeries | None:
    """Tilt angles and rotor speeds that the new commands ask for; None for a model without rotors."""
    vehicle = replay.model.vehicle
    if not vehicle.has_rotors:
        return None
    commands, _ = Allocation(vehicle).allocate(about_origin(vehicle.body, replay.steps.commanded), dt=replay.dt)
    assert commands.tilt is not None
    assert commands.rotor_speed is not None
    return ActuatorSeries("/replay/actuators", replay.time, commands.tilt, commands.rotor_speed)


def _saturation(model: Model, wrench: Array, starts: NDArray[np.int64], dt: float) -> Saturation | None:
    """How many of the wrenches (K, 6) run into a limit of the actuators."""
    vehicle = model.vehicle
    if not vehicle.has_rotors:
        return None
    allocation = Allocation(vehicle)
    parts = [allocation.allocate(w, dt=dt)[1] for w in np.split(about_origin(vehicle.body, wrench), starts[1:])]
    names = ("rotor_speed", "tilt_rate", "tilt_range", "held")
    return Saturation(**{name: sum(getattr(part, name) for part in parts) for name in names})
