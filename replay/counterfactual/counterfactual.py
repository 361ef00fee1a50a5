"""The counterfactual: a recorded flight, re-simulated with something changed.

What the model M does not explain is inferred from the log (`learn.identify.disturbance`) and carried into the
re-simulation (`refly`) as functions of time: a disturbance d(t), the pilot's residual e(t),
the allocation's residual a(t).

    W_des = law(state, reference) + e(t)  ->  compensator  ->  W_cmd  ->  allocation + a(t)  ->  plant + d(t)

As long as nothing is changed, the state is the recorded one, the law plus e(t) gives the recorded command, and the
plant plus d(t) gives the recorded motion. The error of this null run against the recorded *odometry* tells how well the
flight was understood, not how well a loop can hide it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wrenchgap import flight
from wrenchgap.compensate import Combined, Compensator
from wrenchgap.compensate.lbfgs import NotCompiled
from wrenchgap.flight.arguments import Progress, silent
from wrenchgap.flight.flight import AXES, Array, Flight
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.candidates import check_effects
from wrenchgap.learn.data.prediction import process_inputs
from wrenchgap.learn.data.recording import Recording
from wrenchgap.learn.identify.disturbance import Inference, infer
from wrenchgap.learn.identify.guard import loop_of
from wrenchgap.learn.parallel import one_thread
from wrenchgap.plant import Model
from wrenchgap.plant.simulation import closed_loop
from wrenchgap.plant.simulation.closed_loop import LoopFlight, Lost
from wrenchgap.plant.simulation.flight_computer import Compensating, Correction, FlightComputer
from wrenchgap.plant.simulation.simulate import as_flight
from wrenchgap.plant.simulation.tracking import Deviation, Tracking, TrackingErrors, deviation, tracking_errors
from wrenchgap.plant.stability import Margin, margin_of_model
from wrenchgap.replay.counterfactual.change import Change

ATTITUDE_GOAL_DEG, POSITION_GOAL_M = 0.5, 0.02
"""Largest error of a null run with which a counterfactual can be believed."""

EXPLAINED_GOAL = 0.5
"""Share of the command's variance below which the control law is called a guess."""

WORSE_FACTOR, WORSE_DEG = 1.1, 0.02
"""Growth of the attitude error (norm of the axes' means) from which a compensation counts as harmful: beyond both."""


@dataclass(frozen=True)
class ReferenceEnds:
    """The reference covers only a part of the re-simulation; its ends are held."""


@dataclass(frozen=True)
class NullRunOff:
    """The null run is further from the recorded flight than the goals."""

    deviation: Deviation


@dataclass(frozen=True)
class WeakLaw:
    """On these axes the control law explains less of the recorded command than `EXPLAINED_GOAL`."""

    axes: tuple[str, ...]


@dataclass(frozen=True)
class ControlLost:
    """Control was lost in the null run, with the change, or with one of the other compensators by its name."""

    run: str
    lost: Lost


@dataclass(frozen=True)
class CompensationHarms:
    """With the compensation the attitude error grows, from `before` to `after` [deg]."""

    before: float
    after: float


@dataclass(frozen=True)
class FlownPlainly:
    """A re-simulation was not compiled, and why."""

    reason: str


Caveat = ReferenceEnds | NullRunOff | WeakLaw | ControlLost | CompensationHarms | NotCompiled | FlownPlainly
"""What a reader must know before relying on the numbers."""

COMPENSATED_ALONE = "compensated, allocated nominally"
"""The run beside one with both a compensator and another allocation."""
NULL_RUN, CHANGED = "null_run", "counterfactual"
"""Names of runs; other compensators have their own."""


@dataclass(frozen=True, repr=False)
class Counterfactual(Result):
    """An inference, its null run, and the re-simulation with the change (the null run itself where nothing changed).

    `uncompensated` is the re-simulation with all of the change but its compensator: what the compensated one is to be
    compared with. It is the null run where nothing else was changed, None where no compensator flew. `beside` are the
    re-simulations with other compensators in its place. `margin` is the stability margin of the process along the
    recorded commands.
    """

    inference: Inference
    null: Reflight
    changed: Reflight
    change: Change
    uncompensated: Reflight | None = None
    beside: tuple[tuple[str, Reflight], ...] = ()
    margin: Margin | None = None

    @cached_property
    def null_run(self) -> Deviation:
        """Error of the null run against the recorded odometry."""
        return self.null.deviation

    @cached_property
    def tracking(self) -> dict[str, Tracking]:
        """Of the recorded flight, the null run, the uncompensated one if any, the counterfactual."""
        flown = {NULL_RUN: self.null, "uncompensated": self.uncompensated, CHANGED: self.changed}
        of = {name: one.tracking for name, one in flown.items() if one is not None}
        return {"recorded": self.inference.recording.tracking, **of}

    @cached_property
    def baselines(self) -> dict[str, Tracking]:
        """Tracking errors with the other compensators, by name."""
        return {name: one.tracking for name, one in self.beside}

    @cached_property
    def caveats(self) -> tuple[Caveat, ...]:
        """What a reader must know before relying on the numbers."""
        found: list[Caveat] = [] if self.inference.recording.reference_covers else [ReferenceEnds()]
        runs = {NULL_RUN: self.null, CHANGED: self.changed, **dict(self.beside)}
        if self.changed is self.null:
            del runs[CHANGED]
        lost = [ControlLost(name, run.flown.lost) for name, run in runs.items() if run.flown.lost is not None]
        found += [one for one in lost if one.run == NULL_RUN]
        off = self.null_run
        if off.attitude_deg_max > ATTITUDE_GOAL_DEG or off.position_m_max > POSITION_GOAL_M:
            found.append(NullRunOff(off))
        weak = [axis for axis, share in zip(AXES, self.inference.explained, strict=True) if share < EXPLAINED_GOAL]
        found += [WeakLaw(tuple(weak))] if weak else []
        found += [one for one in lost if one.run != NULL_RUN]
        every = (self.change.compensator, *(one for _, one in self.change.beside))
        slow = [one.not_compiled for one in every if isinstance(one, Compensator | Combined)]
        found += [reason for reason in dict.fromkeys(slow) if reason is not None]
        found += [FlownPlainly(why) for why in dict.fromkeys(run.flown.not_compiled for run in runs.values()) if why]
        harmed = self._harmed()
        return tuple(found) if harmed is None else (*found, harmed)

    def _harmed(self) -> CompensationHarms | None:
        """Decided on all axes together: on one that hardly errs any change is large in per cent."""
        if self.uncompensated is None:
            return None
        runs = (self.tracking["uncompensated"], self.tracking[CHANGED])
        angles = [np.degrees(np.arcsin(np.minimum(run.attitude_mean, 1.0))) for run in runs]
        before, after = (float(np.linalg.norm(angle)) for angle in angles)
        return CompensationHarms(before, after) if after > WORSE_FACTOR * before + WORSE_DEG else None

    @property
    def log(self) -> flight.Flight:
        """The re-simulation as a flight on the recorded time base."""
        return self.changed.log

    @property
    def series(self) -> tuple[flight.Named, ...]:
        """What is written beside the flight: disturbance, and what a compensator did."""
        time, steps = self.changed.flown.state.time, self.changed.steps
        named = [
            flight.Named("/disturbance", time, self.changed.flown.disturbance),
            flight.Named("/correction", time, self.changed.commanded - self.changed.desired),
        ]
        for what in ("sigma", "beta", "cost", "iterations") if steps else ():
            named.append(flight.Named(f"/{what}", time, np.array([float(getattr(step, what)) for step in steps])))
        return tuple(named)


@one_thread
def counterfactual(
    recording: Recording,
    model: Model,
    change: Change | None = None,
    *,
    progress: Progress | None = None,
) -> Counterfactual:
    """Infer, fly the null run, and re-simulate with the change."""
    change = change or Change()
    report = progress or silent

    def stage(begin: float, end: float, words: str) -> Callable[[float], None]:
        return lambda fraction: report(begin + (end - begin) * fraction, words)

    inference = infer(recording, model, progress=stage(0.0, 0.3, "inferring the disturbance"))
    null = refly(inference, progress=stage(0.3, 0.5, "null run"))

    def run(compensator: Compensating | None, begin: float, end: float, words: str = "counterfactual") -> Reflight:
        return refly(inference, replace(change, compensator=compensator), progress=stage(begin, end, words))

    others = any(item is not None for item in (change.plant, change.gains, change.believed, change.allocating))
    plain = run(None, 0.5, 0.6) if others else null
    share = 0.4 / (1 + len(change.beside))
    beside = tuple((name, run(one, 1.0 - share, 1.0, name)) for name, one in change.beside)
    if change.compensator is None:
        return Counterfactual(inference, null, plain, change, beside=beside)
    if change.allocating is not None:
        alone = refly(inference, replace(change, allocating=None))
        beside = ((COMPENSATED_ALONE, alone), *beside)
    changed = run(change.compensator, 0.6, 0.6 + share)
    margin, process = None, change.process
    if process is not None:
        inputs = process_inputs(process.settings.inputs, recording.record)
        margin = margin_of_model(process, inputs, loop_of(model, max(process.provenance.lags, default=0.0)))
    return Counterfactual(inference, null, changed, change, plain, beside, margin)


@dataclass(frozen=True)
class Reflight:
    """A re-simulated flight: `flown` (K periods), the desired wrench (K, 6), the compensator's steps, what flew."""

    recording: Recording
    flown: LoopFlight
    desired: Array
    steps: tuple[Correction, ...]
    model: Model

    @property
    def commanded(self) -> Array:
        """W_cmd (K, 6)."""
        return self.flown.commands.wrench_B

    @property
    def tracking_errors(self) -> TrackingErrors:
        """Errors against the recorded reference."""
        state, r = self.flown.state, self.recording
        rows = slice(r.first, r.first + len(state.time))
        return tracking_errors(state.time, state.position_E, state.quat_EB, r.reference.take(rows))

    @property
    def tracking(self) -> Tracking:
        """How well it follows the recorded reference."""
        return Tracking.of(self.tracking_errors)

    @property
    def deviation(self) -> Deviation:
        """How far it is from the recorded odometry."""
        return deviation(self.flown.state, self.recording.odometry, self.recording.dt)

    @property
    def log(self) -> Flight:
        """The re-flight as a log: ideal sensors, the recorded reference, times and start of the recorded flight."""
        r, lost = self.recording, self.flown.lost
        return as_flight(
            f"{r.flight.name} again",
            self.flown,
            self.model,
            self.desired,
            r.reference.take(r.window),
            start_ns=r.flight.start_ns,
            path=r.flight.path,
            notes=() if lost is None else (f"{lost}; the flight ends there",),
        )


def refly(
    inference: Inference,
    change: Change | None = None,
    *,
    progress: Callable[[float], None] | None = None,
    compiled: bool = True,
) -> Reflight:
    """Re-simulate the recorded flight with the inferred disturbance and a change; without one this is the null run.

    What the change does not say is that of the inference's model. `compiled` False calls everything in numpy, as is
    done anyhow with effects of the plant that cannot be compiled. Raises FitError where an effect of the plant needs
    what the log lacks.
    """
    r, known, asked = inference.recording, inference.model, change or Change()
    model = asked.plant or known
    check_effects(model.effects, model, [r.record])
    reference = r.reference.take(r.window)
    computer = FlightComputer(
        asked.gains or known.controller,
        asked.believed or known.vehicle,
        reference,
        r.clock,
        compensator=asked.compensator,
        allocating=asked.allocating,
        recorded=inference.pilot,
    )
    felt = [] if asked.compensator is None else [closed_loop.accelerometer_stage(model.wrench_model, r.clock)]
    forgiven = closed_loop.loss_of_control(r.motion.state.take(r.window), reference)[0] > 0.0
    flown, loop = closed_loop.fly(
        model.wrench_model,
        r.start,
        r.clock,
        [
            *felt,
            closed_loop.loss_of_control_stage(reference, r.clock, forgiven),
            *computer.stages,
            closed_loop.disturbance_stage(inference.disturbance),
        ],
        computer.signals,
        memory=inference.memory,
        compiled=compiled,
        progress=progress,
    )
    desired = loop.logged("law", "desired", len(flown.commands.wrench_B))
    return Reflight(r, flown, desired, tuple(computer.steps), model)
