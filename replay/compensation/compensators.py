"""The compensator that a stored process asks for: with its physics where it was learnt on top of some."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from wrenchgap.compensate import INDI, L1, Combined, Compensator, DisturbanceObserver, PhysicsMismatch, Settings
from wrenchgap.compensate.feedback import INDI_HZ, L1_HZ
from wrenchgap.flight import AXES, FitError, Flight, UsageError
from wrenchgap.flight.arguments import check_arguments
from wrenchgap.learn.identify.add import Addition, model_of
from wrenchgap.learn.identify.guard import loop_of
from wrenchgap.learn.identify.learning import Learnt
from wrenchgap.learn.identify.observer import OBSERVER
from wrenchgap.learn.process.gp import Caution, GaussianProcess
from wrenchgap.learn.process.held_out_time import Verdict
from wrenchgap.learn.process.predictors import check_effects
from wrenchgap.learn.process.train import fit_linear
from wrenchgap.plant.mismatch_inputs import columns
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import content_hash
from wrenchgap.plant.simulation.flight_computer import Compensating
from wrenchgap.plant.stability import Loop, Observer, sensitivity_peak
from wrenchgap.plant.wrench_model import ModelEffect

TORQUE = AXES[3:]
OBSERVER_HZ = 1.0
"""Bandwidth of the disturbance observer among the baselines [Hz]: fast enough for a reference, slow beside servos."""

FEEDBACK = {"observer": OBSERVER_HZ, "indi": INDI_HZ, "l1": L1_HZ}
"""Corrections by feedback alone, and the cut-off [Hz] of each unless another is given."""


def gp_of(gp: GaussianProcess | Learnt) -> GaussianProcess:
    """The process itself."""
    return gp.gp if isinstance(gp, Learnt) else gp


@check_arguments
def compensator(
    gp: GaussianProcess | Learnt,
    model: Model | Addition,
    settings: Settings | None = None,
    *,
    lead: float | None = None,
    without: Sequence[ModelEffect] = (),
) -> Compensator:
    """What goes into a control loop: `compensator(gp, model).step(wrench_des, state)` gives the wrench to command.

    With the effects of the model where the process was learnt on top of them; `lead` [s] is the lead time. `without`
    are effects that the process was learnt on and that are left out on purpose. Raises FitError for a process of
    another vehicle, or one on top of other effects.
    """
    process, model = gp_of(gp), model_of(model)
    process.check_vehicle(model.vehicle.name)
    expected = len(AXES) + len(columns(process.settings.inputs))
    if len(process.input_mean) != expected:
        raise FitError(f"GP: has {len(process.input_mean)} inputs, expected {expected}: the commanded wrench first")
    physics = None
    if process.settings.mean == "physics":
        check_effects(process, replace(model, effects=(*model.effects, *without)))
        physics = PhysicsMismatch(model.wrench_model, process.outputs, lead)
    elif lead is not None:
        raise FitError(
            "--lead: this GP was learnt without physics as its mean, so it has no lag to compensate; add the lag "
            "with `wrenchgap add`, and learn on that model"
        )
    return Compensator(process, settings, physics=physics, vehicle=model.vehicle)


@check_arguments
def combined(
    gp: GaussianProcess | Learnt,
    model: Model | Addition,
    settings: Settings | None = None,
    *,
    lead: float | None = None,
) -> Combined | Compensator:
    """Feed-forward and observer in one object for your own loop: `compensator`, and an observer of what it leaves.

    The observer's bandwidth is the one that training log and attitude loop support (docs/do-no-harm.md). `settings` are
    by default those of the model's control rate. The observer is told the lag that the training log showed, and a delay
    that has a name (`learn.identify.observer`). Where nothing of the process is to be compensated, this is effects and
    observer, or the observer alone. Where the training log gives no bandwidth, because nothing is left for an observer
    to remove, or because none keeps the loop's margin, this is `compensator` without one, and `without_observer` says
    why. Raises FitError for another vehicle's GP, and where neither process nor observer is to be compensated with.
    """
    process, model = gp_of(gp), model_of(model)
    hz, asked = process.provenance.observer_hz, settings or Settings(dt=1.0 / model.controller.rate_hz)
    alone = all_refused(process, asked)
    if hz is None:
        why = no_bandwidth(process)
        if alone:
            raise FitError(f"GP: nothing of it is to be compensated, and it has no bandwidth for an observer: {why}")
        known = compensator(process, model, asked, lead=lead)
        known.without_observer = why
        return known
    ahead = None if alone else compensator(process, model, asked, lead=lead)
    hz = min(hz, 1.0 / (2.0 * math.pi * asked.dt))
    lag = process.provenance.observer_lag
    return Combined(model.vehicle, asked.dt, hz, ahead, lag=lag, delay=loop_of(model).named_delay)


def all_refused(process: GaussianProcess, settings: Settings) -> bool:
    """Whether neither the process nor physics below it is to be compensated, as its verdicts are against it."""
    refused = set(process.refused) == set(process.outputs) and not settings.despite_verdict
    return refused and process.settings.mean != "physics"


@dataclass(frozen=True)
class Judged:
    """An observer in the attitude loop of a model: M_s with it, infinite where the loop is unstable."""

    observer: Observer
    loop: Loop
    peak: float


def told_observer(process: GaussianProcess | None, model: Model, hz: float) -> Observer:
    """An observer of `hz`, told the lag of the training log (without one: the named lags) and the named delay."""
    said = None if process is None else process.provenance
    lag = loop_of(model).lag if said is None or not said.loop_delay else said.observer_lag
    return Observer(hz, lag, loop_of(model).named_delay)


def judged(process: GaussianProcess | None, model: Model, hz: float) -> Judged:
    """An observer of `hz` in the loop of the model's gains, with the lag that the process was judged with.

    Where nobody looked for a lag and none has a name, it is taken for `OBSERVER.unknown`.
    """
    said = None if process is None else process.provenance
    lag = loop_of(model).lag if said is None or not said.loop_delay else said.loop_lag
    loop = replace(loop_of(model), lag=lag or OBSERVER.unknown)
    observer = told_observer(process, model, hz)
    return Judged(observer, loop, sensitivity_peak(loop, observer))


def no_bandwidth(process: GaussianProcess) -> str:
    """Why a process comes without an observer."""
    said = process.provenance
    if not said.loop_delay:
        return "it was learnt by an older version or --as-fitted; learn it again with `wrenchgap learn`"
    if said.observer_left is not None:
        return (
            f"on the training log the best observer would leave {100 * said.observer_left:.0f} % of what is left "
            "without one: nothing is missing there that an observer removes"
        )
    peak = "infinite" if said.observer_peak is None else f"{said.observer_peak:.2g}"
    return (
        f"the attitude loop itself has a peak of the sensitivity of {peak} behind a lag of "
        f"{1e3 * said.loop_lag:.0f} ms, and no observer keeps it below {OBSERVER.most_sensitive:g}; lower the "
        "controller's gains, or fly the GP alone"
    )


def feedback(
    text: str, model: Model, dt: float, process: GaussianProcess | None = None
) -> tuple[str, DisturbanceObserver | INDI | L1]:
    """A correction by feedback alone with its name, of a text such as `indi` or `l1=2`: which, and its cut-off in Hz.

    INDI is told the lag that the training log of `process` showed, or else the named one. Raises UsageError for another
    text, and for a cut-off that is too high for `dt` [s].
    """
    law, equals, number = (part.strip() for part in text.lower().partition("="))
    if law not in FEEDBACK:
        raise UsageError(f"--feedback {text}: expected LAW or LAW=HZ with a law out of {', '.join(FEEDBACK)}")
    try:
        hz = float(number) if equals else FEEDBACK[law]
    except ValueError:
        raise UsageError(f"--feedback {text}: {number!r} is no cut-off in Hz; for example {law}=2") from None
    if law == "observer":
        return f"disturbance observer, {hz:g} Hz", DisturbanceObserver(model.vehicle, dt, hz)
    if law == "l1":
        return f"L1, {hz:g} Hz", L1(model.vehicle, dt, hz)
    told = told_observer(process, model, hz)
    lag = f"{1e3 * (told.lag + told.delay):.0f} ms of lag" if told.lag + told.delay > 0 else "no lag"
    return f"INDI, {hz:g} Hz, told {lag}", INDI(model.vehicle, dt, hz, lag=told.lag, delay=told.delay)


def baselines(process: GaussianProcess | None, model: Model, dt: float) -> tuple[tuple[str, Compensating], ...]:
    """What a process must be better than, by name: feedback alone, the effects alone, a line through its points."""
    found: list[tuple[str, Compensating]] = [feedback(law, model, dt, process) for law in FEEDBACK]
    outputs = TORQUE if process is None else process.outputs
    if model.effects:
        physics_alone = PhysicsMismatch(model.wrench_model, outputs)
        found.append(("the effects of the model alone", Compensator(physics_alone, Settings(dt=dt))))
    if process is not None and process.provenance.observer_hz is not None:
        hz = process.provenance.observer_hz
        found.append((f"combined: GP and observer, {hz:.2g} Hz", combined(process, model, Settings(dt=dt))))
    if process is not None and process.settings.mean == "zero" and not process.settings.inputs:
        inputs = process.input_mean + process.input_scale * process.inputs
        line = fit_linear(inputs, process.residuals * process.output_scale, outputs)
        found.append(
            ("a straight line through the GP's points", Compensator(line, Settings(dt=dt), vehicle=model.vehicle))
        )
    return tuple(found)


@dataclass(frozen=True)
class LearnWarned:
    """`wrenchgap learn` warned of the process when it made it."""

    caution: Caution


@dataclass(frozen=True)
class OtherVersion:
    """The process was learnt on top of `physics`, in another version of the model."""

    model: str
    physics: str


@dataclass(frozen=True)
class LearntFromThisFlight:
    """The process is judged on a flight that it was learnt from."""

    flight: str


@dataclass(frozen=True)
class Refused:
    """Outputs that are not compensated, because the verdict of `learn` is against it."""

    verdicts: tuple[Verdict, ...]


ProcessCaveat = LearnWarned | OtherVersion | LearntFromThisFlight | Refused


def caveats(process: GaussianProcess, model: Model, flight: Flight | None = None) -> tuple[ProcessCaveat, ...]:
    """What a user must know before compensating with this process and model, on this flight."""
    source = process.provenance
    found: list[ProcessCaveat] = [LearnWarned(warning) for warning in source.warnings]
    refused = tuple(v for v in source.verdicts if v.output in process.refused)
    found += [Refused(refused)] if refused else []
    learnt_on = [model] if process.settings.mean == "physics" else [model, model.nominal]
    if source.model_hash not in map(content_hash, learnt_on):
        found.append(OtherVersion(model.name, source.physics))
    if flight is not None and flight.content_hash in [log.sha256 for log in source.logs]:
        found.append(LearntFromThisFlight(flight.name))
    return tuple(found)
