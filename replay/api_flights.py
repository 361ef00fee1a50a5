"""Public functions that look at logs without a model, and ask what differs; the others are in `replay.api`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from wrenchgap.flight.arguments import Progress, check_arguments
from wrenchgap.learn import GaussianProcess, Trend
from wrenchgap.learn.changed import changed as changing
from wrenchgap.learn.changed.changed import Changed
from wrenchgap.learn.data.opening import Flights, listed
from wrenchgap.learn.data.read_options import ReadOptions
from wrenchgap.learn.health import health as checking
from wrenchgap.learn.health.health import Health
from wrenchgap.learn.identify import trend as trending
from wrenchgap.learn.identify.add import Addition, labels, model_of
from wrenchgap.plant.model import Model
from wrenchgap.replay.prediction import HORIZONS, OpenLoop, open_loop
from wrenchgap.replay.readiness import ready as ready


@check_arguments
def check(
    logs: str | Path | Sequence[str | Path],
    model: Model | Addition | None = None,
    options: ReadOptions | None = None,
    *,
    progress: Progress | None = None,
    **more: Any,
) -> Health:
    """What a flight engineer looks at first, without a model: phases, motors, vibration, battery, estimator, rates.

    Of several logs also which parameters of the autopilot differ.

    Parameters
    ----------
    logs
        One log or several, in any format that is read.
    model
        Its rotors and topics are used, where the log does not say where its rotors are; nothing else of it.
    options, more
        How the logs are read, as of `open_flights`.
    progress
        Called with the fraction done and the name of the log that is read.

    Returns
    -------
    Health
        One `LogHealth` for each log: deviations of thrust from the mean of all rotors [1], levels of vibration
        [m/s^2], voltages [V], times [s] from the first message.

    Raises
    ------
    LogError
        For what is no log, or cannot be read.
    UsageError
        For no log at all, or options that are not understood.
    """
    every = [logs] if isinstance(logs, str | Path) else list(logs)
    known = None if model is None else model_of(model)
    return checking.check(every, known, (options or ReadOptions()).changed(**more), progress)


@check_arguments
def changed(
    suspects: Flights,
    healthy: Flights,
    model: Model | Addition,
    *,
    names: Sequence[str] = (),
    injections: int = 0,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Changed:
    """What changed on suspect flights against healthy ones of the same vehicle, where on it, and what to inspect.

    What the model is wrong by in all of them drops out. Among `names`, by default the whole catalogue; so many
    `injections` of changes at the limits of what would have been shown check these; `jobs` processes, by default one
    for each core.
    """
    asked: Any = {"names": names, "injections": injections, "jobs": jobs, "progress": progress}
    return changing.changed(listed(suspects), listed(healthy), model_of(model).without_tolerances, **asked)


@check_arguments
def trend(
    flights: Flights,
    model: Model | Addition,
    effects: Sequence[str] = (),
    *,
    parts: bool = False,
    progress: Progress | None = None,
) -> Trend:
    """Each flight fitted by itself, in the order given, and which parameters stepped or drifted over the flights.

    `effects` are fitted, by default those of the model, else `rotor_thrust` of rotors that do not tilt, else
    `thrust_scale` and `com_offset`. With `parts` it is the health of every rotor, servo and arm: thrust, drag torque,
    lag, zero and play, in order of date where the logs have one.
    """
    known = model_of(model).without_tolerances
    return trending.trend(listed(flights), known, effects, parts=parts, progress=progress)


@check_arguments
def predict(
    flights: Flights,
    model: Model | Addition,
    *others: Model | Addition,
    gp: GaussianProcess | None = None,
    horizons: Sequence[float] = HORIZONS,
    progress: Progress | None = None,
) -> OpenLoop:
    """How far models are off when they predict the motion from the logged commands alone, `horizons` [s] ahead.

    From every sample of flights that were opened for `model`: errors of position [m], velocity [m/s], attitude [rad]
    and body rates [rad/s], beside a motion that goes on as it began. Raises LogError where there is no odometry.
    """
    asked: Any = {"gp": gp, "horizons": horizons, "names": labels(model, *others), "progress": progress}
    return open_loop(listed(flights, "predict"), model_of(model), [model_of(one) for one in others], **asked)
