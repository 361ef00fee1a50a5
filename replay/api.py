"""What a user may call: the whole loop, from logs to a re-simulated flight. The commands call the same functions.

`import wrenchgap` offers all of it; docs/api.md lists every name with an example. Flights are opened once, for a model,
and handed from one function to the next; a single flight may stand where several are expected, and what `add` returns
where a model is expected. Results print themselves, and have `to_frame()`, `plot()` and `to_json()`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.data import comparison
from wrenchgap.learn.data.comparison import Comparison
from wrenchgap.learn.data.measurement import CUTOFF_HZ
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.data.opening import open_flights as open_every
from wrenchgap.learn.design import designer as designing
from wrenchgap.learn.design.designer import Design
from wrenchgap.learn.design.manoeuvres import Limits
from wrenchgap.learn.diagnose import model_checks
from wrenchgap.learn.diagnose.model_checks import LogReport
from wrenchgap.learn.diagnose.where import Where, examine
from wrenchgap.learn.identify import add as adding
from wrenchgap.learn.identify import explain as explaining
from wrenchgap.learn.identify import learning
from wrenchgap.learn.identify.add import Addition
from wrenchgap.learn.identify.explain import Explanation
from wrenchgap.learn.identify.learning import Learnt
from wrenchgap.learn.process import store
from wrenchgap.learn.process.gp import FitSettings, GaussianProcess
from wrenchgap.learn.process.predictors import predictors
from wrenchgap.plant import model_file
from wrenchgap.plant.model import Model

Flights = OpenFlight | Sequence[OpenFlight]
Progress = Callable[[float, str], None]


def load_model(name_or_path: str | Path) -> Model:
    """A model file (.toml), or a shipped model by its name. Raises ModelError, in one line, for what is no model."""
    return model_file.load(name_or_path)


def save_model(
    model: Model | Addition, path: str | Path, *, before: Model | None = None, command: str = "", force: bool = False
) -> Model:
    """Write a model file with its history, and return the model as the file has it.

    `before` is the model that this one came from (known of an `Addition`), `command` what made it. Raises UsageError
    where the file exists and `force` is not given.
    """
    path = Path(path)
    if isinstance(model, Addition):
        versioned = model_file.next_version(
            model.given, model.model, command=command, path=path, flights=model.logs, trial=model.trial
        )
    else:
        versioned = model_file.next_version(before or model, model, command=command, path=path)
    return model_file.save(versioned, path, force=force)


def open_flights(
    logs: str | Path | Sequence[str | Path],
    model: Model | Addition,
    *,
    topics: Mapping[str, str] | None = None,
    shifts: Mapping[str, float] | None = None,
    cutoff_hz: float = CUTOFF_HZ,
    between: tuple[float, float] | None = None,
) -> list[OpenFlight]:
    """Read logs for a model: roles found, one clock, ground time left out, measured wrenches behind one filter.

    `topics` say which topic plays a role, `shifts` [s] move stamps, `between` [s] keeps a part of each flight. Raises
    LogError for what cannot be read or never flew.
    """
    paths = [logs] if isinstance(logs, str | Path) else list(logs)
    return open_every(paths, model_of(model), topics=topics, cutoff_hz=cutoff_hz, between=between, shifts=shifts)


def inspect(
    log: str | Path,
    model: Model | Addition | None = None,
    *,
    topics: Mapping[str, str] | None = None,
    shifts: Mapping[str, float] | None = None,
    cutoff_hz: float = CUTOFF_HZ,
) -> LogReport:
    """What is in a log: topics, roles, rates, gaps, checks of units and frames, offsets between topics."""
    known = None if model is None else model_of(model)
    return model_checks.inspect(log, known, topics=topics, shifts=shifts, cutoff_hz=cutoff_hz)


def compare(
    flights: Flights, model: Model | Addition, *others: Model | Addition, gp: GaussianProcess | None = None
) -> Comparison:
    """Errors of the nominal vehicle, of `model`, of `others` and of a process on flights opened for `model`."""
    opened, base = listed(flights), model_of(model)
    found, notes = predictors(base, [model_of(o) for o in others], gp, opened[0].records[0].cutoff_hz)
    result = comparison.compare(opened, base, found)
    return replace(result, notes=tuple(dict.fromkeys((*base.notes, *notes, *result.notes))))


def where(
    flights: Flights, model: Model | Addition, *, gp: GaussianProcess | None = None, progress: Progress | None = None
) -> Where:
    """Where a model fails: error budget, the conditions that its error depends on, whiteness, relevant inputs."""
    return examine(listed(flights), model_of(model), gp, progress)


def explain(
    flights: Flights,
    model: Model | Addition,
    *,
    names: Sequence[str] = (),
    validate: Flights = (),
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Explanation:
    """Which effects the model is missing, with what confidence, and what is indistinguishable.

    Among `names`, by default the whole catalogue; `validate` flights are not fitted but tested on. `jobs` processes, by
    default one for each core.
    """
    return explaining.explain(
        listed(flights), model_of(model), names=names, validation=listed(validate), jobs=jobs, progress=progress
    )


def add(
    model: Model | Addition,
    effects: str | Sequence[str] | Explanation,
    flights: Flights | None = None,
    *,
    progress: Progress | None = None,
) -> Addition:
    """The model with effects fitted to flights, all of them together; of an `Explanation`, what it named, to its own."""
    if isinstance(effects, Explanation):
        names, opened = effects.effects, effects.flights if flights is None else listed(flights)
    else:
        names = (effects,) if isinstance(effects, str) else tuple(effects)
        if flights is None:
            raise UsageError(f"add: no flights to fit {', '.join(names)} to; give those that were opened for the model")
        opened = listed(flights)
    return adding.add(model_of(model), names, opened, progress=progress)


def learn(
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
    """A Gaussian process of what the model leaves, as a function of the command; `.gp` is what compensation needs.

    `outputs` are axes out of `flight.AXES`. With physics as its mean where the model has effects, unless `settings`
    say otherwise. With `guard` it is compared with other inputs and with every effect of the catalogue.
    """
    return learning.learn(
        listed(flights),
        model_of(model),
        tuple(outputs),
        settings,
        validation=listed(validate),
        best_inputs=best_inputs,
        guard=guard,
        progress=progress,
    )


def load_gp(path: str | Path) -> GaussianProcess:
    """A process of `save_gp` or `wrenchgap learn`. Raises FitError for what is none."""
    return store.load(path)


def save_gp(gp: GaussianProcess | Learnt, path: str | Path, *, force: bool = False) -> None:
    """Write a process: arrays and JSON in a zip, no code. Raises UsageError where the file exists without `force`."""
    store.save(gp.gp if isinstance(gp, Learnt) else gp, path, force=force)


def model_of(model: Model | Addition) -> Model:
    """The model itself."""
    return model.model if isinstance(model, Addition) else model


def listed(flights: Flights) -> list[OpenFlight]:
    """One flight or several, as a list."""
    return [flights] if isinstance(flights, OpenFlight) else list(flights)


def design(
    effects: Sequence[str],
    model: Model | Addition,
    flights: Flights = (),
    *,
    limits: Limits | None = None,
    duration: float = 30.0,
    also: Sequence[str] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Design:
    """The flight of `duration` [s] that separates effects best; sizes are the model's, else fitted to `flights`."""
    return designing.design(
        effects,
        model_of(model),
        flights=listed(flights),
        limits=limits,
        duration=duration,
        also=also,
        seed=seed,
        progress=progress,
    )
