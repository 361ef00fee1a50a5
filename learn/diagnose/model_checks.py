"""A log against a model: whether the vehicle weighs what the model says, and whether its actuators agree."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wrenchgap import flight
from wrenchgap.flight.check import Check, TimeLeftOut, accepted_names
from wrenchgap.flight.inspection import Inspection
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.opening import OpenFlight, checks_against
from wrenchgap.learn.data.phases.phase import Phase
from wrenchgap.learn.data.read_options import ReadOptions
from wrenchgap.learn.diagnose.timing import FlightTiming, timing, timing_of
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import as_argument


@dataclass(frozen=True, repr=False)
class LogReport(Result):
    """What is in a log: `inspection`, what the model's numbers say of it, and the timing of its topics.

    `model_checks` and `phases` are empty without a model, `timing` None where no topic plays a role; `shifts` [s] moved
    stamps; `left_out` are the times that an analysis with the model does without. `model` is its file or name.
    """

    inspection: Inspection
    model_checks: tuple[Check, ...]
    timing: FlightTiming | None
    shifts: Mapping[str, float]
    notes: tuple[str, ...]
    phases: tuple[Phase, ...] = ()
    left_out: tuple[TimeLeftOut, ...] = ()
    model: str = ""


def inspect(path: str | Path, model: Model | None = None, options: ReadOptions | None = None) -> LogReport:
    """Look at a log, against a model where one is given. Raises LogError for what is no log, UsageError for topics."""
    path, options = Path(path), options or ReadOptions()
    absent = options.unmeasured_axes(model)
    accept = accepted_names(options.accept)
    preferred = None if model is None else model.topics
    asked: dict[str, Any] = {"unmeasured": absent, "accept": accept, "budget": options.budget}
    seen = flight.inspect(path, options.topics, preferred, **asked)
    moved = None if seen.flight is None else options.shifted(seen.flight, model)
    against: tuple[Check, ...] = ()
    opened: OpenFlight | None = None
    if model is not None:
        log = path if seen.flight is None else seen.flight  # which was read once
        against, opened = checks_against(log, model, options.changed(accept=accept))
    found: FlightTiming | None = None
    if opened is not None and model is not None:
        found = timing_of(opened, model)
    elif moved is not None:
        found = timing(moved)
    alone = () if seen.flight is None else seen.flight.left_out
    left = alone if opened is None else tuple(n for n in opened.notes if isinstance(n, TimeLeftOut))
    phases = () if opened is None else opened.phases
    moves = {} if moved is None else moved.shifts
    notes = tuple(seen.notes if moved is None else moved.notes)
    return LogReport(seen, against, found, moves, notes, phases, left, "" if model is None else as_argument(model))
