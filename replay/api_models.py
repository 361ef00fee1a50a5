"""Public functions that make a model or look at one; the others are in `replay.api`."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path

from wrenchgap.flight.arguments import Progress, check_arguments, silent
from wrenchgap.flight.budget import Budget
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.learn.data.checks import usable_cutoff
from wrenchgap.learn.data.measurement import CUTOFF_HZ
from wrenchgap.learn.data.opening import Flights, listed
from wrenchgap.learn.identify import calibrate as calibrating
from wrenchgap.learn.identify.add import Addition, model_of
from wrenchgap.learn.identify.calibrate import Calibration
from wrenchgap.learn.posterior.hidden_rotor import refused_where_hidden
from wrenchgap.plant import Model, model_file
from wrenchgap.plant.drafts.draft import Sheet, Sourced, assumptions, completed
from wrenchgap.plant.drafts.model_text import text_of
from wrenchgap.plant.drafts.sources import Ask, Given, answers, draft_of_source, parameters_of, with_spins
from wrenchgap.plant.effectiveness import Effectiveness
from wrenchgap.plant.effectiveness import effectiveness as effectiveness_of
from wrenchgap.plant.targets.written import SIMULATORS, Written, written


@check_arguments
def draft_model(
    source: str | Path | None,
    *,
    given: Given | None = None,
    command: str = "",
    ask: Ask | None = None,
    budget: Budget | str | None = None,
) -> Sheet:
    """A model of what a log, parameters or a robot description say, and of what is `given`; of answers, with `ask`.

    `budget` is what reading a log may take, e.g. "8GB,120s".
    Nothing is written. Raises UsageError, ModelError or LogError, in one line, for what is missing or cannot be read.
    """
    path, said = None if source is None else Path(source), given or Given()
    found = draft_of_source(path, said, budget)
    if ask is not None:
        said = Given(**answers(asdict(said), found, ask))  # type: ignore[arg-type]
        found = with_spins(draft_of_source(path, said, budget), ask)
    found = completed(found)
    if found.slowest_hz is not None and (cutoff := usable_cutoff(found.slowest_hz)) < CUTOFF_HZ:
        why = f"IMU and motor commands come at {found.slowest_hz:.3g} Hz or faster, which allows no more"
        found = replace(found, cutoff_hz=Sourced(cutoff, why))
    words = command or shlex.join(["wrenchgap", "model", "new", *(["--from", str(path)] if path else [])])
    origin = found.origin if path is None else f"{found.origin} (SHA-256 {sha256(path.read_bytes()).hexdigest()})"
    headline = (
        f"Drafted by wrenchgap {model_file.tool_version()} on {datetime.now(UTC):%Y-%m-%d} from {origin}",
        f"with `{words}`.",
        "Every number says where it comes from; what is marked ASSUMED nobody said: replace it where you know better.",
    )
    try:
        model = model_file.loads(text_of(found, headline))
    except ModelError as error:
        raise ModelError(f"{found.origin}: {error}") from None
    return Sheet(model, tuple(assumptions(found)), found.notes)


@check_arguments
def save_draft(drawn: Sheet, path: str | Path, *, force: bool = False) -> Sheet:
    """Write the model file of a draft; raises UsageError where it exists without `force`."""
    return replace(drawn, model=model_file.save(drawn.model, Path(path), force=force))


@check_arguments
def calibrate(
    flights: Flights,
    model: Model | Addition,
    *,
    validate: Flights = (),
    progress: Progress | None = None,
) -> Calibration:
    """A model trimmed on healthy flights: what helps on held-out time is changed, and nothing else.

    `validate` flights are tested on and never fitted. `.model` is the calibrated one; the model as it was where a weak
    rotor, put into these flights, would be found with that and not with the calibrated one.
    """
    found = calibrating.calibrate(listed(flights), model_of(model), unseen=listed(validate), progress=progress)
    return refused_where_hidden(found, progress or silent)


@check_arguments
def effectiveness(model: Model | Addition, tilt: float | Sequence[float] = 0.0) -> Effectiveness:
    """What a newton asked of each rotor makes as flown, beside the nominal, and the allocation that allows for it.

    Parameters
    ----------
    model
        With rotors and fitted effects.
    tilt
        Angle [rad] of all arms that tilt, or one for each arm, about which the vehicle hovers.

    Returns
    -------
    Effectiveness
        ``matrix`` (6, R), ``achieved`` (6, 6) and ``allocation`` (R, 6) with nominal values and standard deviations.

    Raises
    ------
    ModelError
        For a model without rotors.
    UsageError
        For tilts that the arms do not have.
    """
    return effectiveness_of(model_of(model), tilt)


@check_arguments
def export_model(
    model: Model | Addition,
    target: str,
    *,
    parameters: str | Path | Mapping[str, float] | None = None,
    origin: str = "",
    budget: Budget | str | None = None,
) -> Written:
    """A model in the terms of an autopilot or a simulator; `text` of the result is the file, nothing is written.

    Parameters
    ----------
    model
        With rotors. Of an autopilot only what its effects' standard deviations say was identified is in the result; a
        simulator gets the whole vehicle.
    target
        "px4", "ardupilot", "crazyflie"; "mjcf", "sdf", "urdf", "rotorpy" or "drone-models".
    parameters
        Those with which the logs were flown: a log of PX4 (.ulg) or ArduPilot (.bin), a parameter file, or a mapping.
    origin
        A line for the top of the file, by default the model's name.
    budget
        What reading a log may take.

    Returns
    -------
    Written
        The text, parameters with standard deviations, and what the target cannot say.

    Raises
    ------
    ModelError
        For a model without rotors, rotors that the target cannot have, and nothing identified for an autopilot.
    UsageError
        For an unknown target, and for parameters of a simulator, which has none.
    LogError
        For a log that cannot be read.
    """
    if parameters is not None and target in SIMULATORS:
        raise UsageError(
            f"--to {target}: is a simulator and takes no parameters of an autopilot; leave --parameters out"
        )
    if isinstance(parameters, str | Path):
        parameters = parameters_of(Path(parameters), budget)
    mine = model_of(model)
    words = origin or f"{mine.name}, by wrenchgap {model_file.tool_version()}"
    return written(mine, target, parameters, words)
