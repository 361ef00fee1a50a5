"""The compensation of a recorded flight, step by step: optimiser and uncertainty filter on the logged wrenches.

    W_k  -> dW*_k = argmin |mu(W_k + dW) + dW|^2  -> filter -> dW_k,   W_cmd,k = W_k + dW_k

W_k is the logged desired wrench (what the controller wanted), or the logged command, at the log's own stamps; the
vehicle flew what it flew, so this shows what would have been commanded, not where it would have led (that is the
counterfactual). After a gap of the log, and after time on the ground, the compensator starts afresh.

Measured and predicted wrenches go through one filter (`learn.data.measurement`) and are read at the same stamps; nan
where the log has no motion, in gaps and at their edges.
"""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from wrenchgap.compensate import Compensator, Settings
from wrenchgap.compensate.run import BLOCK, run
from wrenchgap.flight.arguments import Progress, check_arguments
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import Array, Flight, Indices, Mask, WrenchSeries
from wrenchgap.flight.result import Result
from wrenchgap.learn import GaussianProcess, Learnt, OpenFlight
from wrenchgap.learn.data.candidates import check_effects
from wrenchgap.learn.data.prediction import require_pose
from wrenchgap.learn.data.recording import commanded_otherwise
from wrenchgap.learn.identify.add import Addition, model_of
from wrenchgap.learn.parallel import one_thread
from wrenchgap.learn.process.predictors import ProcessNote, predictors
from wrenchgap.plant.allocation import Saturation, allocation_of
from wrenchgap.plant.mismatch import Conditioning, conditioning, output_indices
from wrenchgap.plant.mismatch_inputs import extra_inputs
from wrenchgap.plant.model import Model
from wrenchgap.plant.state import State, concatenated
from wrenchgap.plant.wrench_model import about_origin
from wrenchgap.replay.compensation import source as sources
from wrenchgap.replay.compensation.compensators import ProcessCaveat, caveats, gp_of
from wrenchgap.replay.compensation.compensators import compensator as made_for
from wrenchgap.replay.compensation.source import Source, at_stamps, starts

CONDITIONED = 2000
"""Commands along the log at which I + dmu/dW is looked at, at most."""


SAME = ("correction", "optimum", "sigma", "beta", "cost", "iterations", "accepted", "solve_time")
"""Fields that `Steps` has of `compensate.run.Run`."""


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
    accepted: Mask
    solve_time: Array
    trouble: dict[str, int]


@dataclass(frozen=True, repr=False)
class Replay(Result):
    """A flight with what the compensation would have done. K steps at `time` (K,) [s since the flight's start].

    source               which logged wrench went in, `input_topic` where it comes from
    wrench               (K, 6) that wrench: to the compensator it is the desired one
    logged               (K, 6) logged command (the plant's input), nan where unknown; `wrench` if that is the command
    logged_filtered      (K, 6) the same as `measured` is filtered
    measured             (K, 6) from the IMU, filtered
    predicted            (K, 6) model and GP at the logged command, filtered
    predicted_new        (K, 6) model and GP at the new command in the state that was flown, filtered
    conditioning         of I + dmu/dW along the commands
    saturation           of the new commands, and of the logged ones; None for a model without rotors
    sigma_threshold      sigma at which half of the optimum is taken; inf where the filter is off
    dt                   [s], the period that the filter was told
    restarts             how many times the compensator started afresh after a gap
    computed_from        topic of the actuators from which the command was computed, None where it is logged
    caveats              what to know before relying on the process
    notes                of the log and its predictions
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
    logged_filtered: Array
    measured: Array
    predicted: Array
    predicted_new: Array
    steps: Steps
    conditioning: Conditioning
    saturation: Saturation | None
    saturation_logged: Saturation | None
    sigma_threshold: float
    dt: float
    restarts: int
    computed_from: str | None
    caveats: tuple[ProcessCaveat, ...]
    notes: tuple[object, ...]

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the L axes that the GP knows."""
        return self.gp.outputs

    def __len__(self) -> int:
        return len(self.time)


@check_arguments
@one_thread
def replay_compensation(
    flight: OpenFlight,
    model: Model | Addition,
    gp: GaussianProcess | Learnt,
    settings: Settings | None = None,
    *,
    source: str | None = None,
    lead: float | None = None,
    progress: Progress | None = None,
) -> Replay:
    """What the compensation would have commanded on a recorded flight, at the log's own stamps.

    `source` is the logged wrench that goes in, "desired" or "commanded": by default the desired one where the log has
    it, else the commanded one, which is computed from the actuators where only they are logged. `settings.dt` is
    replaced by the log's period. `lead` [s] leads the lags of the physics, where that is the process's mean.

    Raises FitError for a GP of another vehicle or physics, LogError where the log lacks the wrench, or the motion that
    the process wants to know.
    """
    model, gp, log = model_of(model), gp_of(gp), flight.flight
    gp.check_vehicle(model.vehicle.name)
    logged = sources.logged_command(log, model)
    series, name = sources.input_wrench(log, logged, sources.source_by_name(source))
    series, dt = sources.without(series, flight.left_out), series.period
    settings = replace(settings or Settings(), dt=dt)
    compensator = made_for(gp, model, settings, lead=lead)
    motion = _motion(flight, model, compensator, gp, series) if compensator.needs_state else None
    with threadpool_limits(1):
        steps = step_through(compensator, series.wrench_B, motion, starts(series), progress)
        seen = series.wrench_B  # what the process looks at (K, D)
        if motion is not None:
            before = np.concatenate((seen[:1], seen[:-1]))
            seen = np.hstack((seen, extra_inputs(gp.settings.inputs, before, motion, dt)[0]))
        condition = conditioning(gp, seen[:: max(1, len(seen) // CONDITIONED)])
        filtered = [(r.time, r.commanded) for r in flight.records if logged is not None]
        wrenches, notes = _wrenches(flight, model, gp, replace(series, wrench_B=steps.commanded))
    return Replay(
        flight=log,
        model=model,
        gp=gp,
        settings=settings,
        source=name,
        input_topic=series.topic,
        time=series.time,
        wrench=series.wrench_B,
        logged=at_stamps(series.time, [] if logged is None else sources.pieces(logged)),
        logged_filtered=at_stamps(series.time, filtered),
        **wrenches,
        steps=steps,
        conditioning=condition,
        saturation=_saturation(model, steps.commanded, series, dt),
        saturation_logged=_saturation(model, series.wrench_B, series, dt),
        sigma_threshold=float(compensator.uncertainty.threshold),
        dt=dt,
        restarts=len(starts(series)) - 1,
        computed_from=logged.topic if logged is not None and log.commanded is None else None,
        caveats=caveats(gp, model),
        notes=(*flight.notes, *notes, *([compensator.not_compiled] if compensator.not_compiled else [])),
    )


def step_through(
    compensator: Compensator,
    wrench: Array,
    motion: State | None,
    starts: Indices,
    progress: Progress | None = None,
) -> Steps:
    """Compensate wrenches (K, 6) one after the other; forget the past at every index in `starts`."""
    if progress is not None:
        progress(0.0, "compiling, the first time on this machine")
    rows, parts = output_indices(compensator.model.outputs), []
    every = max(BLOCK, len(wrench) // 100)
    for start, stop in zip(starts, (*starts[1:], len(wrench)), strict=True):
        compensator.reset()
        for k in range(start, stop, every):
            part = slice(k, min(k + every, stop))
            parts.append(run(compensator, wrench[part], None if motion is None else motion.take(part)))
            if progress is not None:
                progress(k / len(wrench), f"step {k} of {len(wrench)}")
    found = {name: np.concatenate([getattr(p, name) for p in parts]) for name in SAME}
    after = np.concatenate([p.after for p in parts]) + found["correction"][:, rows]
    return Steps(
        commanded=np.concatenate([p.wrench_cmd for p in parts]),
        mismatch_before=np.concatenate([p.before for p in parts]),
        mismatch_after=after,
        trouble=dict(Counter(said for p in parts for said in p.trouble.values())),
        **found,
    )


def _motion(
    opened: OpenFlight, model: Model, compensator: Compensator, gp: GaussianProcess, series: WrenchSeries
) -> State:
    """The state last known at every stamp of `series`, for what depends on it."""
    flight, records = opened.flight, opened.records
    if not records:
        blind = flight.imu is None and flight.odometry is None
        has = "has neither IMU nor odometry" if blind else "has no stretch that is long enough to filter"
        raise LogError(f"{flight.path.name}: this GP depends on the motion, and the log {has}")
    for record in records:
        require_pose(gp.settings.inputs, record)
    if compensator.physics is not None:
        check_effects(compensator.physics.model.effects, model, records)
    every = concatenated([r.state for r in records])
    return every.take(np.maximum(np.searchsorted(every.time, series.time, side="right") - 1, 0))


def _wrenches(
    opened: OpenFlight, model: Model, gp: GaussianProcess, new: WrenchSeries
) -> tuple[dict[str, Array], list[ProcessNote]]:
    """As in `Replay`: measured, predicted as flown and at the new command, at the stamps of `new`; and notes."""
    records, body = opened.records, model.vehicle.body
    found, notes = predictors(model, (), gp, records[0].cutoff_hz if records else None)
    predictor = found[-1]
    check_effects(predictor.model.effects, model, records)
    otherwise = [commanded_otherwise(r, s, new, model.vehicle) for r, s in zip(records, opened.flown, strict=True)]
    return {
        "measured": at_stamps(new.time, [(r.time, r.measured) for r in records]),
        "predicted": at_stamps(new.time, [(r.time, predictor.predict(r, body)) for r in records]),
        "predicted_new": at_stamps(new.time, [(r.time, predictor.predict(r, body)) for r in otherwise]),
    }, notes


def _saturation(model: Model, wrench: Array, series: WrenchSeries, dt: float) -> Saturation | None:
    """How many of the wrenches (K, 6), at the stamps of `series`, run into a limit of the actuators."""
    vehicle = model.vehicle
    if not vehicle.has_rotors:
        return None
    allocation = allocation_of(vehicle)
    cut = np.split(about_origin(vehicle.body, wrench), starts(series)[1:])
    parts = [allocation.allocate(w, dt=dt)[1] for w in cut]
    names = ("rotor_speed", "tilt_rate", "tilt_range", "held")
    return Saturation(**{name: sum(getattr(part, name) for part in parts) for name in names})
