# Long because every public function stands here, with its options.
"""What a user may call: the whole loop, from logs to a re-simulated flight. The commands call the same functions.

`import wrenchgap` offers all of it; docs/api.md lists every name with an example. Flights are opened once, for a model,
and handed from one function to the next; a single flight may stand where several are expected, and what `add` returns
where a model is expected. Results print themselves, and have `to_frame()`, `plot()` and `to_json()`.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from wrenchgap.flight import Flight, UsageError, write
from wrenchgap.flight.arguments import Progress, check_arguments
from wrenchgap.flight.unmeasured import axis_names
from wrenchgap.learn import Comparison, Design, Explanation, FitSettings, GaussianProcess, Learnt, Limits, LogReport
from wrenchgap.learn.data import comparison
from wrenchgap.learn.data.opening import Flights, OpenFlight, listed
from wrenchgap.learn.data.opening import open_flights as open_every
from wrenchgap.learn.data.read_options import ReadOptions
from wrenchgap.learn.data.recording import read_recording
from wrenchgap.learn.design import designer as designing
from wrenchgap.learn.diagnose import model_checks
from wrenchgap.learn.diagnose.where import Where, examine
from wrenchgap.learn.discover import discover as discovering
from wrenchgap.learn.identify import add as adding
from wrenchgap.learn.identify import learning
from wrenchgap.learn.identify.add import Addition, labels, model_of
from wrenchgap.learn.posterior import explain as explaining
from wrenchgap.learn.posterior.settings import DEFAULT, SearchSettings
from wrenchgap.learn.process import store
from wrenchgap.learn.process.predictors import predictors
from wrenchgap.plant import Model, model_file
from wrenchgap.plant.simulation.flight_plan import Plan, fly
from wrenchgap.replay.compensation.compensators import compensator as compensator
from wrenchgap.replay.compensation.compensators import gp_of
from wrenchgap.replay.compensation.replay import replay_compensation as replay_compensation
from wrenchgap.replay.counterfactual import counterfactual as resimulating
from wrenchgap.replay.counterfactual.change import change
from wrenchgap.replay.counterfactual.counterfactual import Counterfactual
from wrenchgap.replay.prediction import open_loop_beside
from wrenchgap.replay.report import report as report


@check_arguments
def load_model(name_or_path: str | Path) -> Model:
    """A model file (.toml), or a shipped model by its name. Raises ModelError, in one line, for what is no model."""
    return model_file.load(name_or_path)


@check_arguments
def save_model(
    model: Model | Addition, path: str | Path, *, before: Model | None = None, command: str = "", force: bool = False
) -> Model:
    """Write a model file with its history, and return the model as the file has it.

    `before` is the model that this one came from (known of an `Addition`), `command` what made it; what is `before`
    itself has no new version. Raises UsageError where the file exists and `force` is not given.
    """
    path = Path(path)
    if isinstance(model, Addition):
        versioned = model_file.next_version(
            model.given, model.model, command=command, path=path, flights=model.logs, trial=model.trial
        )
    elif model is before:
        versioned = model
    else:
        versioned = model_file.next_version(before or model, model, command=command, path=path)
    return model_file.save(versioned, path, force=force)


@check_arguments
def open_flights(
    logs: str | Path | Flight | Sequence[str | Path | Flight],
    model: Model | Addition,
    options: ReadOptions | None = None,
    **more: Any,
) -> list[OpenFlight]:
    """Read logs, or flights of `simulate`, for a model.

    `more` are options by their names, in place of those of `options`: `between=(3, 9), keep=["saturation"]`. Raises
    LogError for what cannot be read, never flew, or is bad.
    """
    every = [logs] if isinstance(logs, str | Path | Flight) else list(logs)
    return open_every(every, model_of(model), (options or ReadOptions()).changed(**more))


@check_arguments
def inspect(
    log: str | Path,
    model: Model | Addition | None = None,
    options: ReadOptions | None = None,
    **more: Any,
) -> LogReport:
    """What is in a log: topics, roles, rates, gaps, checks of units and frames, offsets between topics.

    Options are those of `open_flights`.
    """
    known = None if model is None else model_of(model)
    return model_checks.inspect(log, known, (options or ReadOptions()).changed(**more))


@check_arguments
def compare(
    flights: Flights,
    model: Model | Addition,
    *others: Model | Addition,
    gp: GaussianProcess | None = None,
    ahead: bool = True,
) -> Comparison:
    """Errors of the nominal vehicle, of `model`, of `others` and of a process on flights opened for `model`.

    And, if wanted, how far `ahead` they predict the motion (`predict`), where the log has the odometry.
    """
    opened, base, names = listed(flights, "compare"), model_of(model), labels(model, *others)
    further = [model_of(o) for o in others]
    found, notes = predictors(base, further, gp, opened[0].records[0].cutoff_hz, names)
    result = comparison.compare(opened, base, found)
    moved, why_not = open_loop_beside(opened, base, further, gp=gp, names=names) if ahead else (None, ())
    return replace(result, ahead=moved, notes=tuple(dict.fromkeys((*base.notes, *notes, *result.notes, *why_not))))


@check_arguments
def where(
    flights: Flights, model: Model | Addition, *, gp: GaussianProcess | None = None, progress: Progress | None = None
) -> Where:
    """Where a model fails: error budget, the conditions that its error depends on, whiteness, relevant inputs."""
    return examine(listed(flights, "where"), model_of(model), gp, progress)


@check_arguments
def explain(
    flights: Flights,
    model: Model | Addition,
    *,
    names: Sequence[str] = (),
    validate: Flights = (),
    injections: int = 0,
    settings: SearchSettings = DEFAULT,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Explanation:
    """Which effects the model is missing, with what confidence, what is indistinguishable, what would have been shown.

    Among `names`, by default the whole catalogue; `validate` flights are not fitted but tested on. So many `injections`
    of effects at the limits of what would have been shown check these, each as long as the search itself. `settings`
    are the numbers that the search decides by. `jobs` processes, by default one for each core.
    """
    asked: Any = {"names": names, "validation": listed(validate), "injections": injections, "settings": settings}
    return explaining.explain(listed(flights), model_of(model), **asked, jobs=jobs, progress=progress)


@check_arguments
def discover(
    flights: Flights,
    model: Model | Addition,
    *,
    validate: Flights = (),
    explanation: Explanation | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> discovering.Discovery:
    """The law of what `explain` cannot name: its formula, how sure it is and what it resembles; or that there is none.

    `validate` flights are not fitted but tested on. `explanation` is that of these flights, where it is known.
    `source` of the result is the Python file of the law, an effect of its own.
    """
    asked: Any = {"validation": listed(validate), "explanation": explanation, "jobs": jobs, "progress": progress}
    return discovering.discover(listed(flights), model_of(model), **asked)


@check_arguments
def add(
    model: Model | Addition,
    effects: str | Sequence[str] | Explanation,
    flights: Flights | None = None,
    *,
    progress: Progress | None = None,
) -> Addition:
    """The model with effects fitted to flights, all together; of an `Explanation`, what it named to its own flights."""
    if isinstance(effects, Explanation):
        names, opened = effects.effects, effects.flights if flights is None else listed(flights)
    else:
        names = (effects,) if isinstance(effects, str) else tuple(effects)
        if flights is None:
            raise UsageError(f"add: no flights to fit {', '.join(names)} to; give those that were opened for the model")
        opened = listed(flights)
    return adding.add(model_of(model), names, opened, progress=progress)


@check_arguments
def learn_gp(
    flights: Flights,
    model: Model | Addition,
    *,
    outputs: Sequence[str] = learning.TORQUE,
    settings: FitSettings | None = None,
    validate: Flights = (),
    best_inputs: bool = False,
    guard: bool = True,
    progress: Progress | None = None,
) -> Learnt:
    """A Gaussian process of the wrench residual, as a function of the command; `.gp` is what compensation needs.

    `outputs` are axes out of `flight.AXES`. With physics as its mean where the model has effects, unless `settings`
    say otherwise. With `guard` it is compared with other inputs and with every effect of the catalogue.
    """
    return learning.learn(
        listed(flights, "learn_gp"),
        model_of(model),
        tuple(outputs),
        settings,
        validation=listed(validate),
        best_inputs=best_inputs,
        guard=guard,
        progress=progress,
    )


@check_arguments
def load_gp(path: str | Path) -> GaussianProcess:
    """A process of `save_gp` or `wrenchgap learn`. Raises FitError for what is none."""
    return store.load(path)


@check_arguments
def save_gp(gp: GaussianProcess | Learnt, path: str | Path, *, force: bool = False) -> None:
    """Write a process: arrays and JSON in a zip, no code. Raises UsageError where the file exists without `force`."""
    store.save(gp_of(gp), path, force=force)


@check_arguments
def design(
    effects: Sequence[str],
    model: Model | Addition,
    flights: Flights = (),
    *,
    limits: Limits | None = None,
    duration: float = 30.0,
    also: Sequence[str] | None = None,
    unmeasured: Sequence[str] = (),
    seed: int = 0,
    progress: Progress | None = None,
) -> Design:
    """The flight of `duration` [s] that separates effects best; sizes are the model's, else fitted to `flights`.

    `unmeasured` are axes that the IMU will not measure there, besides those of the model file.
    """
    how: dict[str, Any] = {"limits": limits, "duration": duration, "also": also, "seed": seed}
    base = model_of(model)
    base = replace(base, unmeasured=axis_names([*base.unmeasured, *unmeasured]))
    return designing.design(effects, base, flights=listed(flights), progress=progress, **how)


@check_arguments
def counterfactual(
    flight: OpenFlight,
    model: Model | Addition,
    *,
    gp: GaussianProcess | Learnt | None = None,
    gp_name: str = "GP",
    lead: float | None = None,
    without: Sequence[str] = (),
    having: Sequence[str] = (),
    gains: Sequence[str] = (),
    believe: Model | Addition | None = None,
    allocation: Model | Addition | None = None,
    baselines: bool = False,
    feedback: Sequence[str] = (),
    despite_verdict: bool = False,
    start: float = 0.0,
    duration: float | None = None,
    progress: Progress | None = None,
) -> Counterfactual:
    """A recorded flight, re-simulated with something changed; the null run bounds the accuracy.

    `gp` compensates in the loop; `without` these effects of the model, `having` others ("servo_lag=tau:0.05"); other
    `gains` ("integral=0"); controller and allocation `believe` another model; the corrected `allocation` of a model
    allocates; `baselines` are those of a GP, `feedback` others by name and cut-off [Hz] ("indi=8", "l1", "observer=2"),
    each flown instead of it.
    """
    base, process = model_of(model), None if gp is None else gp_of(gp)
    recording = read_recording(flight, base.vehicle, start=start, duration=duration)
    asked = change(
        base,
        period=recording.dt,
        gp=None if process is None else (gp_name, process),
        lead=lead,
        baselines=baselines,
        feedback=feedback,
        despite_verdict=despite_verdict,
        without=without,
        with_=having,
        gains=gains,
        believe=None if believe is None else model_of(believe),
        allocation=None if allocation is None else model_of(allocation),
    )
    return resimulating.counterfactual(recording, base, asked, progress=progress)


@check_arguments
def simulate(
    model: Model | Addition,
    trajectory: str,
    *,
    duration: float | None = None,
    excitation: float = 0.0,
    seed: int = 0,
    integral: bool | None = None,
    hide: Sequence[str] = (),
    name: str = "simulation",
    progress: Callable[[float], None] | None = None,
) -> Flight:
    """A flight of a simulated vehicle, which `open_flights` takes like a log.

    The controller believes `model`; the plant flies it with the effects `hide` ("com_offset=x:0.004") besides.
    `trajectory` is a name or a file of `design`; `excitation` adds a multisine on all axes, 1 is usual for training.
    """
    plan = Plan(model_of(model), trajectory, duration, excitation, seed, integral, tuple(hide))
    return fly(plan, name=name, progress=progress)


@check_arguments
def save_log(flight: Flight, path: str | Path, *, force: bool = False) -> Path:
    """Write a flight as MCAP with ROS 2 messages. Raises UsageError where the file exists without `force`."""
    return write(flight, Path(path), force=force)
