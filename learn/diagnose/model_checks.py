"""A log against a model: whether the vehicle weighs what the model says, and whether its actuators agree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wrenchgap import flight
from wrenchgap.flight.check import Check, TimeLeftOut, accepted_names
from wrenchgap.flight.errors import UsageError, WrenchgapError
from wrenchgap.flight.inspection import Inspection
from wrenchgap.flight.result import Result
from wrenchgap.flight.roles import parse_source
from wrenchgap.flight.unmeasured import axis_names
from wrenchgap.learn.data.measurement import CUTOFF_HZ
from wrenchgap.learn.data.opening import OpenFlight, open_flight
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
) -> LogReport:
    """Look at a log, against a model where one is given. Raises LogError for what is no log, UsageError for topics."""
    path, wanted, moves = Path(path), dict(topics or {}), dict(shifts or {})
    absent = axis_names([*axis_names(unmeasured), *(model.unmeasured if model is not None else ())])
    accept = accepted_names(accept)
    seen = _with_topics_of(path, wanted, model, absent, accept)
    moved = None if seen.flight is None else flight.shifted(seen.flight, moves)
    found = None if moved is None else timing(moved)
    against: tuple[Check, ...] = ()
    opened: OpenFlight | None = None
    if model is not None:
        how: dict[str, Any] = {"topics": wanted, "cutoff_hz": cutoff_hz, "shifts": moves, "unmeasured": absent}
        against, opened = _checks(path, model, accept=accept, keep=tuple(keep), **how)
        found = found if opened is None else timing_of(opened, model)
    alone = () if seen.flight is None else seen.flight.left_out
    left = alone if opened is None else tuple(n for n in opened.notes if isinstance(n, TimeLeftOut))
    phases = () if opened is None else opened.phases
    return LogReport(seen, against, found, moves, tuple(seen.notes if moved is None else moved.notes), phases, left)


def _with_topics_of(
    path: Path, topics: Mapping[str, str], model: Model | None, unmeasured: tuple[str, ...], accept: tuple[str, ...]
) -> Inspection:
    """`flight.inspect` with the model file's topics, where the log has them."""
    plain = flight.inspect(path, topics, unmeasured=unmeasured, accept=accept)
    if model is None or not model.topics:
        return plain
    have = {topic.topic for topic in plain.topics}
    preferred = {role: text for role, text in model.topics.items() if parse_source(text).topic in have}
    wanted = {**preferred, **topics}
    return flight.inspect(path, wanted, unmeasured=unmeasured, accept=accept) if wanted != dict(topics) else plain


def _checks(path: Path, model: Model, **how: Any) -> tuple[tuple[Check, ...], OpenFlight | None]:
    """What a model says about a log, and the flight; a log that cannot be used with it is itself a finding."""
    try:
        opened = open_flight(path, model, gate=False, **how)
    except UsageError:
        raise
    except WrenchgapError as error:
        return (Check("model", "bad", str(error)),), None
    alone = len(opened.flight.checks or ())
    return opened.checks[alone:], opened
