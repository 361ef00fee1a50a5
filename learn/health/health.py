"""The health of a vehicle as its logs show it, without a model: what a flight engineer looks at first.

A log is read once; its flight with its checks is that of `flight.inspect`, the autopilot's own messages come besides.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wrenchgap.flight.arguments import Progress
from wrenchgap.flight.autopilot import Autopilot, ParameterDifferences, parameter_differences
from wrenchgap.flight.check import Check, accepted_names
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Flight
from wrenchgap.flight.inspection import Inspection, inspected
from wrenchgap.flight.load import assigned
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.opening import OpenFlight, checks_against
from wrenchgap.learn.data.read_options import ReadOptions
from wrenchgap.learn.diagnose.timing import answering_axes, following_axes, timing_of
from wrenchgap.learn.health.answers import Answer, Setting, answers_of, settings_of
from wrenchgap.learn.health.autopilot_messages import Battery, Estimator, Recorded, battery_of, estimator_of
from wrenchgap.learn.health.logged_messages import FlightMode, LoggedMessage, messages_of, modes_of
from wrenchgap.learn.health.motors import Motors, motors_of
from wrenchgap.learn.health.phases import AIRBORNE, FlightPhases, NoPhases, phases_of
from wrenchgap.learn.health.rotors import thrusts_of
from wrenchgap.learn.health.vibration import Vibration, vibration_of
from wrenchgap.plant import model_file
from wrenchgap.plant.model import Model


@dataclass(frozen=True)
class Rate:
    """A role and the topic that plays it: messages a second, gaps, the longest of them, and that in flight [s].

    `last` is the time of its last message [s].
    """

    role: str
    topic: str
    hz: float
    last: float
    gaps: int
    longest_gap: float
    in_flight: float


@dataclass(frozen=True, eq=False)
class LogHealth:
    """One log. What it does not carry is None; `phases.lack` says why nothing is known of its phases.

    `contradictions` are the bad checks of the log against the model that was given, which was then not used; `doubts`
    are those of its weight and its clocks that are to be looked at, where it was used. `follows`
    says whether the motion follows the commands about x or y, None without a model that tells it.
    """

    inspection: Inspection
    autopilot: Autopilot | None
    phases: FlightPhases
    motors: Motors | None = None
    vibration: Vibration | None = None
    battery: Battery | None = None
    estimator: Estimator | None = None
    rates: tuple[Rate, ...] = ()
    answers: tuple[Answer, ...] = ()
    settings: tuple[Setting, ...] = ()
    contradictions: tuple[Check, ...] = ()
    doubts: tuple[Check, ...] = ()
    follows: bool | None = None
    modes: tuple[FlightMode, ...] = ()
    messages: tuple[LoggedMessage, ...] = ()

    @property
    def name(self) -> str:
        """The file's."""
        return self.inspection.path.name

    @property
    def bad(self) -> tuple[Check, ...]:
        """Checks of the log that make its numbers doubtful."""
        return tuple(c for c in self.inspection.checks if c.level == "bad" and not c.accepted and c.name != "roles")


@dataclass(frozen=True, repr=False)
class Health(Result):
    """What `wrenchgap check` finds in logs, and which parameters of the autopilot differ between them.

    `model` is the file or name of the model that was given, for its rotors and topics alone; empty without one. Where a
    log contradicts it, it was not used (`fits`). `repeated` are files that were left out, each with the one before that
    it equals.
    """

    logs: tuple[LogHealth, ...]
    parameters: ParameterDifferences
    model: str = ""
    repeated: tuple[tuple[str, str], ...] = ()

    @property
    def fits(self) -> bool:
        """Whether a model was given that no log contradicts."""
        return bool(self.model) and not any(log.contradictions for log in self.logs)


def check(
    logs: Sequence[str | Path],
    model: Model | None = None,
    options: ReadOptions | None = None,
    progress: Progress | None = None,
) -> Health:
    """Look at logs without a model, or with the rotors and topics of one.

    A log that is byte by byte one of those before is left out. Raises LogError for what is no log, UsageError for no
    log at all and for options that are not understood.
    """
    if not logs:
        raise UsageError("check: got no logs; expected one at least")
    found: list[LogHealth] = []
    repeated = []
    for number, path in enumerate(logs):
        if progress is not None:
            progress(number / len(logs), Path(path).name)
        found.append(examined(Path(path), model, options or ReadOptions()))
        hashes = [log.inspection.content_hash for log in found]
        if (first := hashes.index(hashes[-1])) < len(found) - 1:
            repeated.append((str(found.pop().inspection.path), str(found[first].inspection.path)))
    names = [log.name for log in found]
    named = [log.name if names.count(log.name) == 1 else str(log.inspection.path) for log in found]
    differences = parameter_differences(zip(named, (log.autopilot for log in found), strict=True))
    return Health(tuple(found), differences, "" if model is None else model_file.as_argument(model), tuple(repeated))


def examined(path: Path, model: Model | None, options: ReadOptions) -> LogHealth:
    """The health of one log."""
    absent = options.unmeasured_axes(model)
    preferred = None if model is None else model.topics
    log, assignment = assigned(path, options.topics, preferred, options.budget)
    names = [name for topic, table in log.tables.items() for name in (topic, *table.columns)]
    tables = {topic: replace(table, columns=dict(table.columns)) for topic, table in log.tables.items()}
    seen = inspected(replace(log, tables=tables), assignment, absent, accepted_names(options.accept))
    recorded = Recorded({} if log.autopilot is None else log.tables, seen.start_ns)
    found = LogHealth(seen, log.autopilot, FlightPhases(lack=NoPhases.COMMANDS))  # where no topic plays a role
    against, doubts, opened = _against(seen.flight, model, options)
    if seen.flight is not None:
        found = _of_flight(found, seen.flight, recorded, None if against else model, opened)
    return replace(
        found,
        settings=settings_of(log.autopilot, found.answers, names),
        doubts=doubts,
        contradictions=against if found.phases.seconds(*AIRBORNE) else (),  # without a flight, which is said, none fits
        modes=modes_of(recorded),
        messages=messages_of(recorded, found.phases),
    )


def _against(
    flight: Flight | None, model: Model | None, options: ReadOptions
) -> tuple[tuple[Check, ...], tuple[Check, ...], OpenFlight | None]:
    """Checks of a flight against a model, and the flight if it fits.

    Bad ones, but for rates and clocks, which are the log's own; where there are none, what is to be looked at of the
    weight, and of the clocks.
    """
    if flight is None or model is None:
        return (), (), None
    found, opened = checks_against(flight, model, options)
    bad = tuple(c for c in found if c.stops and c.name not in ("rate", "early-response"))
    doubts = tuple(c for c in found if (c.level == "warn" and c.name == "weight") or (c.stops and c.name != "rate"))
    return (bad, (), None) if bad else ((), doubts, opened)


def _of_flight(
    log: LogHealth, flight: Flight, recorded: Recorded, model: Model | None, opened: OpenFlight | None
) -> LogHealth:
    """The log with all that is known of its flight; `opened` with the model, where that fits, has `inspect`'s phases.

    Whether the motion follows the commands about x or y, or on any axis, only a model tells (`learn.diagnose.timing`).
    """
    thrusts = thrusts_of(flight, model)
    phases = phases_of(flight, thrusts, None if opened is None else opened.phases)
    follows, lags = None, True
    if opened is not None and model is not None:
        timing = [timing_of(opened, model)]
        follows, lags = not {3, 4} <= set(answering_axes(timing)), bool(following_axes(timing))
    battery = battery_of(flight, recorded, phases)
    rotors = () if thrusts is None else tuple(rotor.name for rotor in thrusts.rotors)
    vibration = vibration_of(flight, recorded, phases, rotors)
    air = phases.named(*AIRBORNE)
    start, stop = (air[0].start, air[-1].stop) if air else (0.0, 0.0)
    rates = (
        Rate(
            *(role, s.topic, 1.0 / s.period, float(s.time[-1]), len(s.gaps)),
            *(max((g.stop - g.start for g in s.gaps if a < g.stop and g.start < b), default=0.0) for a, b in spans),
        )
        for spans in [((-np.inf, np.inf), (start, stop))]
        for role, s in flight.series().items()
        if len(s.time) > 2 and s.period > 0.0
    )
    return replace(
        log,
        phases=phases,
        motors=motors_of(thrusts, phases),
        vibration=vibration,
        battery=battery,
        estimator=estimator_of(flight.autopilot, recorded, phases),
        rates=tuple(rates),
        answers=answers_of(flight, thrusts, phases, battery, vibration, follows=follows is not False, lags=lags),
        follows=follows,
    )
