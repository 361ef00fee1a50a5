"""What is in a log, before anybody trusts it: topics, roles, rates, gaps, clocks, sanity, and every channel.

A channel is one numeric field of one topic, or one column of it where it is an array: "/imu/data.angular_velocity.x",
"/esc.data[3]", whether or not it plays a role: for looking, not for computing. Its times are those of the flight's
clock: header stamps where they were filled in, else log times, brought to one clock as `flight.load` does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wrenchgap.flight.budget import LIMITS, Budget
from wrenchgap.flight.check import Check, accepting
from wrenchgap.flight.checks import with_checks
from wrenchgap.flight.clocks import Relation, one_clock, relation, without_jumps
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import Array, Flight, Stamps
from wrenchgap.flight.formats import Log, Table, read_log
from wrenchgap.flight.load import assigned, build
from wrenchgap.flight.roles import ROLE_PARTS, Assignment
from wrenchgap.flight.stamps import Steps


@dataclass(frozen=True)
class TopicReport:
    """One topic. Times in seconds; None where there is nothing to say.

    `header_offset` is stamp minus log time, `header_jitter` its spread about the straight line of rate `header_rate`:
    jitter of the transport. `plays` are the roles (or parts of roles) that it plays, `could_play` those that it was not
    chosen for.
    """

    topic: str
    type: str
    count: int
    rate: float | None
    jitter: float | None
    gaps: int
    longest_gap: float
    header_offset: float | None
    header_rate: float | None
    header_jitter: float | None
    dropped: dict[str, int]
    plays: tuple[str, ...]
    could_play: tuple[str, ...]
    problem: str | None


@dataclass(frozen=True)
class Inspection:
    """Everything that `wrenchgap inspect` prints of one log. `flight` is None where no topic plays a role.

    `mapping` is the assignment in the syntax of `--topic`, by part of a role.
    """

    path: Path
    format: str
    size: int
    content_hash: str
    start_ns: int
    duration: float
    topics: tuple[TopicReport, ...]
    mapping: dict[str, str]
    checks: tuple[Check, ...]
    notes: tuple[str, ...]
    flight: Flight | None

    @property
    def level(self) -> str:
        """The worst level of all checks, what is accepted counting as warn: ok, warn or bad."""
        levels = ("warn" if check.accepted else check.level for check in self.checks)
        return max(levels, key=("ok", "warn", "bad").index, default="ok")


def inspect(
    path: str | Path,
    topics: Mapping[str, str] | None = None,
    preferred: Mapping[str, str] | None = None,
    unmeasured: Sequence[str] = (),
    accept: Sequence[str] = (),
    budget: Budget | str | None = None,
) -> Inspection:
    """Look at a log; arguments as for `load`, but one in which no topic plays a role is reported as well.

    Raises LogError where the file is no log or cannot be read, UsageError where `topics` is not understood.
    """
    return inspected(*assigned(path, topics, preferred, budget), unmeasured, accept)


def inspected(
    log: Log, assignment: Assignment, unmeasured: Sequence[str] = (), accept: Sequence[str] = ()
) -> Inspection:
    """The same of a log that is read and whose roles are assigned; its columns are given away."""
    flight: Flight | None = None
    known: dict[str, Relation] = {}
    try:
        raw, timing = build(log, assignment, unmeasured)
        plain = {s.topic for s in assignment.sources.values() if s.meaning.stamp == 1.0}  # stamps as they are logged
        known = {topic: clock for topic, clock in timing.relations.items() if topic in plain}
        flight = with_checks(raw, timing, assignment.vehicles)
        found = flight.checks or ()
    except LogError as error:
        found = (Check("roles", "bad", str(error)),)
    first = min(int(_told(table.log_time_ns)[0]) for table in log.tables.values())
    last = max(int(table.log_time_ns[-1]) for table in log.tables.values())
    return Inspection(
        path=log.path,
        format=log.format,
        size=log.size,
        content_hash=log.content_hash,
        start_ns=first if flight is None else flight.start_ns,
        duration=(last - first) * 1e-9
        if flight is None
        else max(float(series.time[-1]) for series in flight.series().values()),
        topics=tuple(_topic(table, assignment, flight, known) for table in log.tables.values()),
        mapping=assignment.as_topics(),
        checks=accepting(found, accept),
        notes=log.notes if flight is None else flight.notes,
        flight=flight,
    )


def _topic(table: Table, assignment: Assignment, flight: Flight | None, known: Mapping[str, Relation]) -> TopicReport:
    stamps = _told(table.log_time_ns if table.header_ns is None else table.header_ns)
    time = (stamps - stamps[0]) * 1e-9
    steps = Steps(time if np.all(time[1:] >= time[:-1]) else np.sort(time))
    period = steps.nominal_period if len(time) > 2 else 0.0
    clock = known.get(table.topic)
    if clock is None and table.header_ns is not None:
        clock = relation(table.log_time_ns, without_jumps(table.log_time_ns, table.header_ns)[0])
    series = [] if flight is None else flight.series().values()
    return TopicReport(
        topic=table.topic,
        type=table.type,
        count=len(table),
        rate=1.0 / period if period > 0.0 else None,  # damaged logs repeat one stamp
        jitter=steps.jitter if period > 0.0 else None,
        gaps=len(steps.gaps),
        longest_gap=max((gap.stop - gap.start for gap in steps.gaps), default=0.0),
        header_offset=None if clock is None else clock.offset,
        header_rate=None if clock is None else clock.rate,
        header_jitter=None if clock is None else clock.residual,
        dropped=next((dict(s.dropped) for s in series if s.topic.split(" + ")[0] == table.topic), {}),
        plays=_plays(table.topic, assignment),
        could_play=tuple(part for part, others in assignment.candidates.items() if table.topic in others),
        problem=table.problem,
    )


def _told(stamps: Stamps) -> Stamps:
    """Stamps without those of zero, which say that the time was not known; all where there are no others."""
    known = stamps[stamps != 0]
    return known if len(known) else stamps


def _plays(topic: str, assignment: Assignment) -> tuple[str, ...]:
    """Roles; the part as well where a role has several topics."""
    played = []
    for role, parts in ROLE_PARTS.items():
        topics = {part: assignment.sources[part].topic for part in parts if part in assignment.sources}
        own = [part for part, other in topics.items() if other == topic]
        if own:
            played.append(role if set(topics.values()) == {topic} else f"{role} ({', '.join(own)})")
    return tuple(played)


Channel = tuple[Array, Array]
"""Times (N,) [s since Flight.start_ns] and values (N,), nan where a message lacks it."""


def channels_of(path: str | Path, found: Flight, budget: Budget | str | None = None) -> dict[str, Channel]:
    """All channels of the log of a flight, topic by topic; `budget` as of `flight.load`."""
    log = read_log(Path(path), lambda topic, kind, fields: True, budget)
    motion = [series.topic for series in (found.imu, found.odometry) if series is not None]
    stamps = one_clock(log.tables, [topic for topic in motion if topic in log.tables]).stamps
    out: dict[str, Channel] = {}
    for topic, table in log.tables.items():
        time = np.asarray(stamps[topic] - found.start_ns, dtype=float) * 1e-9
        for name, values in _numbers(table).items():
            out[f"{topic}.{name}" if name else topic] = (time, values)
    return out


def _numbers(table: Table) -> Mapping[str, Array]:
    """The numeric columns of a topic by their dotted names, without the header's own."""
    out: dict[str, Array] = {}
    for name, values in table.columns.items():
        if name.startswith("header.") or name.endswith("covariance") or values.dtype.kind not in "fiub":
            continue
        if values.ndim == 1:
            out[name] = values.astype(float)
        elif values.shape[1] <= LIMITS.channel_columns:
            out |= {f"{name}[{i}]": values[:, i].astype(float) for i in range(values.shape[1])}
    return {name: values for name, values in out.items() if np.isfinite(values).any()}
