"""A log against a model: whether the vehicle weighs what the model says, and whether its actuators agree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wrenchgap import flight
from wrenchgap.flight.budget import Budget
from wrenchgap.flight.check import Check, TimeLeftOut, accepted_names
from wrenchgap.flight.errors import UsageError, WrenchgapError
from wrenchgap.flight.flight import Flight
from wrenchgap.flight.inspection import Inspection
from wrenchgap.flight.result import Result
from wrenchgap.flight.unmeasured import axis_names
from wrenchgap.learn.data.measurement import CUTOFF_HZ
from wrenchgap.learn.data.opening import NoFlight, OpenFlight, open_flight
from wrenchgap.learn.data.phases import Phase
from wrenchgap.learn.diagnose.timing import FlightTiming, timing, timing_of
from wrenchgap.plant.model import Model


@dataclass(frozen=True, repr=False)
class LogReport(Result):
    """What is in a log: `inspection`, what the model's numbers say of it, and the timing of its topics.

    `model_checks` and `phases` are empty without a model, `timing` None where no topic plays a role; `shifts` [s] moved
    stamps; `left_out` are the times that an analysis with the model does without.
    """

    inspection: Inspection
    model_checks: tuple[Check, ...]
    timing: FlightTiming | None
    shifts: Mapping[str, float]
    notes: tuple[str, ...]
    phases: tuple[Phase, ...] = ()
    left_out: tuple[TimeLeftOut, ...] = ()


def inspect(
    path: str | Path,
    model: Model | None = None,
    *,
    topics: Mapping[str, str] | None = None,
    shifts: Mapping[str, float] | None = None,
    cutoff_hz: float = CUTOFF_HZ,
    unmeasured: Iterable[str] = (),
    accept: Iterable[str] = (),
    keep: Iterable[str] = (),
    budget: Budget | str | None = None,
) -> LogReport:
    """Look at a log, against a model where one is given. Raises LogError for what is no log, UsageError for topics."""
    path, wanted, moves = Path(path), dict(topics or {}), dict(shifts or {})
    absent = axis_names([*axis_names(unmeasured), *(model.unmeasured if model is not None else ())])
    accept = accepted_names(accept)
    preferred = None if model is None else model.topics
    seen = flight.inspect(path, wanted, preferred, unmeasured=absent, accept=accept, budget=budget)
    moved = None if seen.flight is None else flight.shifted(seen.flight, moves)
    against: tuple[Check, ...] = ()
    opened: OpenFlight | None = None
    if model is not None:
        how: dict[str, Any] = {"topics": wanted, "cutoff_hz": cutoff_hz, "shifts": moves, "unmeasured": absent}
        how["budget"] = budget
        log = path if seen.flight is None else seen.flight  # which was read once
        against, opened = _checks(log, model, accept=accept, keep=tuple(keep), **how)
    found: FlightTiming | None = None
    if opened is not None and model is not None:
        found = timing_of(opened, model)
    elif moved is not None:
        found = timing(moved)
    alone = () if seen.flight is None else seen.flight.left_out
    left = alone if opened is None else tuple(n for n in opened.notes if isinstance(n, TimeLeftOut))
    phases = () if opened is None else opened.phases
    return LogReport(seen, against, found, moves, tuple(seen.notes if moved is None else moved.notes), phases, left)


def _checks(log: Path | Flight, model: Model, **how: Any) -> tuple[tuple[Check, ...], OpenFlight | None]:
    """What a model says about a log, and the flight; a log that cannot be used with it is itself a finding."""
    try:
        opened = open_flight(log, model, gate=False, **how)
    except UsageError:
        raise
    except NoFlight as error:  # which a bad check may explain
        return (*error.checks, Check("model", "bad", str(error))), None
    except WrenchgapError as error:
        return (Check("model", "bad", str(error)),), None
    alone = len(opened.flight.checks or ())
    return opened.checks[alone:], opened
