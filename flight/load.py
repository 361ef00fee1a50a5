# Long because the way of every role from columns to its series stands here, in one builder.
"""From a log file to a `Flight`: roles, one clock, clean series in SI and in the frames of `flight.flight`."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from wrenchgap._escaping import printable
from wrenchgap.flight import so3
from wrenchgap.flight.budget import Budget
from wrenchgap.flight.checks import with_checks
from wrenchgap.flight.clocks import Timing, one_clock
from wrenchgap.flight.columns import Rows, Slope, best_frame, empty_columns, in_other_axes, slope_of, sound_rows, vector
from wrenchgap.flight.command_units import option_for, with_units
from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.flight.filters import angular_velocity, smooth
from wrenchgap.flight.flight import (
    AXES,
    SERIES,
    ActuatorSeries,
    Array,
    Flight,
    ImuSeries,
    OdometrySeries,
    ReferenceSeries,
    Series,
    Stamps,
)
from wrenchgap.flight.formats import Log, give_away, read_log
from wrenchgap.flight.formats.headers import listed
from wrenchgap.flight.memory import give_back, on_disk
from wrenchgap.flight.roles import PART_QUANTITY, Assignment, Source, assignment, selection
from wrenchgap.flight.stamps import gaps_of, increasing, interpolated, nearest
from wrenchgap.flight.topic_names import says_command
from wrenchgap.flight.unmeasured import Why, axis_names, not_estimated, unmeasured_axes, without_axes

AnySeries = TypeVar("AnySeries", bound=Series)


def load(
    path: str | Path,
    topics: Mapping[str, str] | None = None,
    preferred: Mapping[str, str] | None = None,
    unmeasured: Sequence[str] = (),
    budget: Budget | str | None = None,
) -> Flight:
    """Read a log.

    `topics` overrides what role a topic plays, by role or part, e.g. `{"imu": "/my/imu", "tilt": "/plot/tilt[0:6]"}`
    (see `flight.roles`). `preferred` is the same, but passed over where the log lacks the topic: the mapping of a
    model file, which serves logs of several kinds. `unmeasured` are axes that the IMU is known not to measure
    (`flight.unmeasured`). What was assumed, repaired or left out is in the flight's `notes`. `budget` is the memory and
    the processor time that reading may take, e.g. "8GB,120s" (`flight.budget`).

    Raises BudgetError where it would take more; LogError where the file is no log, cannot be read, or plays no role at
    all; UsageError where `topics` is not understood.
    """
    log, assignment = assigned(path, topics, preferred, budget)
    found = with_checks(*build(log, assignment, unmeasured), assignment.vehicles)
    give_back(max((len(series.time) for series in found.series().values()), default=0))
    return found


def assigned(
    path: str | Path,
    topics: Mapping[str, str] | None,
    preferred: Mapping[str, str] | None,
    budget: Budget | str | None = None,
) -> tuple[Log, Assignment]:
    """A log, and who plays what in it; arguments and errors as of `load`."""
    log = read_log(Path(path), selection({**(preferred or {}), **(topics or {})}), budget)
    return log, assignment(log.tables, topics, preferred, str(path))


def build(log: Log, assignment: Assignment, unmeasured: Sequence[str] = ()) -> tuple[Flight, Timing]:
    """The flight that a log holds under an assignment of roles, and its clocks; the log's columns are given away."""
    option = option_for(log.tables.get("/table"))
    if max(map(len, log.tables.values()), default=0) == 1:
        raise LogError(f"{log.path}: one message of each topic; a flight has many: was the file cut short?")
    if not assignment.sources:
        found = listed([f"{topic:.100} ({table.type:.100})" for topic, table in log.tables.items()], 240)
        raise LogError(
            f"{log.path}: no topic plays a role; topics: {found}. Map one with --topic {option or 'imu=/your/topic'}, "
            "and see `wrenchgap inspect`"
        )
    sources = assignment.sources
    used = {source.topic: log.tables[source.topic] for source in sources.values()}
    for source in sources.values():
        header, unit = log.tables[source.topic].header_ns, source.meaning.stamp  # as logged: a topic may play two parts
        if header is not None and unit != 1.0:  # the user said in which unit its stamps are
            scaled = np.round(header * unit)
            if np.any(np.abs(scaled) >= 2.0**63):
                largest = f"stamps of {np.abs(scaled).max():.3g} ns"
                raise UsageError(f"{source}: {largest}; expected a unit in which they are times")
            used[source.topic] = replace(log.tables[source.topic], header_ns=scaled.astype(np.int64))
    timing = one_clock(used, [sources[part].topic for part in ("imu", "gyroscope", "pose", "twist") if part in sources])
    builder = _Builder(log, assignment, timing, axis_names(unmeasured))
    flight = Flight(
        name=printable(log.path.name if log.path.is_dir() else log.path.name.removesuffix(log.path.suffix)),
        path=log.path,
        content_hash=log.content_hash,
        start_ns=builder.start_ns,
        commanded=builder.one("commanded", slice(None)),
        desired=builder.one("desired", slice(None)),
        actuators=builder.actuators(),
        imu=builder.imu(),
        odometry=builder.odometry(),
        reference=builder.reference(),
        battery=builder.one("battery", 0),
        autopilot=log.autopilot,
        damage=log.damage,
        firmware=next((table.firmware for table in log.tables.values() if table.firmware), ""),
    )
    if not flight.series():
        raise LogError(f"{log.path}: nothing usable in {', '.join(used)}: {' '.join(builder.notes)}")
    builder.parts.clear()
    give_back(max((len(series.time) for series in flight.series().values()), default=0))
    flight = without_axes(flight, {**unmeasured_axes(flight), **builder.unmeasured})
    notes = (*log.notes, *assignment.notes, *timing.notes, *builder.notes)
    flight = replace(flight, command_option=option or flight.command_option)
    return with_units(replace(flight, notes=notes, mapping=assignment.as_topics()), sources), timing


@dataclass
class _Part:
    """Clean samples of one part: stamps (N,) [ns], increasing; values (N, K)."""

    source: Source
    stamps: Stamps
    values: Array
    dropped: dict[str, int]


@dataclass
class _Builder:
    log: Log
    assignment: Assignment
    timing: Timing
    declared: tuple[str, ...] = ()
    unmeasured: dict[str, Why] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    parts: dict[str, _Part] = field(default_factory=dict)
    start_ns: int = 0

    def __post_init__(self) -> None:
        topics = Counter(source.topic for source in self.assignment.sources.values())
        give_away(self.log.tables, topics)
        for name, source in self.assignment.sources.items():
            part = self._clean(name)
            if part is not None:
                self.parts[name] = part
            topics[source.topic] -= 1
            give_away(self.log.tables, +topics)  # hours of log are not held twice
            give_back(0 if part is None else len(part.stamps))
        self.start_ns = min((int(part.stamps[0]) for part in self.parts.values()), default=0)

    def _clean(self, name: str) -> _Part | None:
        """The usable samples of one part; what is left out is counted."""
        source = self.assignment.sources[name]
        table = self.log.tables[source.topic]
        values = vector(table, source, PART_QUANTITY[name], str(self.log.path))
        values = source.meaning.applied(PART_QUANTITY[name], values)
        if name == "imu":
            self.unmeasured = {**not_estimated(table, source), **dict.fromkeys(self.declared, Why.DECLARED)}
            if self.unmeasured:
                values = values.copy()
                columns = [(AXES.index(axis) + 3) % 6 for axis in self.unmeasured]  # the gyroscope comes first
                values[:, columns] = np.nan
        if table.problem:
            self._note(f"{source.topic}: {table.problem}.")
        if not np.isfinite(values[:1]).any() and not np.isfinite(values).any():
            self._note(f"{source.topic} plays {name}, but none of its values is a number: left out.")
            return None
        absent = empty_columns(values, name)
        stamps = self.timing.stamps[source.topic]
        unset = (stamps == 0) & (np.count_nonzero(stamps == 0) > 1)  # one zero may be the start of a simulation
        finite, absurd = sound_rows(values, absent)
        dropped: Counter[str] = Counter(
            {"not finite": int((~finite).sum()), "absurd": int(absurd.sum()), "no stamp": int(unset.sum())}
        )
        keep = np.flatnonzero(finite & ~absurd & ~unset)
        if name in ("pose", "reference_pose"):
            quat = values[:, 3:7] if len(keep) == len(values) else values[keep, 3:7]
            norm = np.sqrt(np.einsum("ij,ij->i", quat, quat))
            dropped["zero quaternion"] = int((norm < 0.5).sum())
            repaired = int(((np.abs(norm - 1.0) > 1e-3) & (norm >= 0.5)).sum())
            if repaired:
                self._note(f"{source.topic}: {repaired} quaternions were not of unit length; normalised.")
            keep = keep[norm >= 0.5]
        ordered, reasons = increasing(stamps[keep])
        keep, dropped = keep[ordered], dropped + Counter(reasons)
        counted = {reason: count for reason, count in dropped.items() if count}
        if counted:
            listed = ", ".join(f"{count} {reason}" for reason, count in counted.items())
            self._note(f"{source.topic}: {sum(counted.values())} of {len(stamps)} samples left out ({listed}).")
        if len(keep) < 2:
            self._note(f"{source.topic} plays {name}, but only {len(keep)} of its samples are usable: left out.")
            return None
        rows: Any = slice(None) if len(keep) == len(values) else keep
        return _Part(source, on_disk(stamps[rows]), on_disk(values[rows]), counted)

    def one(self, role: str, *columns: int | slice) -> Any:
        """The series of a role of one part, whose `columns` are its fields."""
        part = self.parts.get(role)
        if part is None:
            return None
        values = (part.values[:, c] for c in columns)
        return self._made(SERIES[role], part.source.topic, part, *values)

    def _made(self, kind: type[AnySeries], topic: str, part: _Part, *values: Array | None) -> AnySeries:
        time = self._seconds(part.stamps)
        kept = (None if column is None else on_disk(column) for column in values)
        return kind(topic, on_disk(time), *kept, gaps=gaps_of(time), dropped=part.dropped)

    def imu(self) -> ImuSeries | None:
        """Gyroscope and accelerometer, of one topic or, where the user named two, at the stamps of the gyroscope."""
        whole, gyro, accel = (self.parts.get(name) for name in ("imu", "gyroscope", "accelerometer"))
        if gyro is None and accel is None:
            return None if whole is None else self.one("imu", slice(3), slice(3, None))
        main = gyro or whole or accel
        assert main is not None
        unknown = np.full((len(main.stamps), 3), np.nan)
        omega = main.values[:, :3] if main is not accel else unknown
        force = self._at(main, accel) if accel is not None else main.values[:, 3:] if main is whole else None
        if force is None:
            force = unknown if whole is None else self._at(main, replace(whole, values=whole.values[:, 3:]))
        topics = self._topics(*(part for part in ("imu", "gyroscope", "accelerometer") if part in self.parts))
        return self._made(ImuSeries, topics, main, omega, force)

    def actuators(self) -> ActuatorSeries | None:
        """Tilt angles and rotor speeds; where they come from two topics, at the stamps of the tilt angles."""
        tilt, speed = self.parts.get("tilt"), self.parts.get("rotor_speed")
        if tilt is not None and speed is not None and not np.array_equal(tilt.stamps, speed.stamps):
            tilt, speed = self._joined_commands(tilt, speed)
        main = tilt or speed
        if main is None:
            return None
        empty = np.zeros((len(main.stamps), 0))
        if speed is not None and not says_command(speed.source.topic, self.log.tables[speed.source.topic].type):
            self._note(
                f"{speed.source.topic} does not say whether its rotor speeds are commanded or measured; "
                "they are taken as commanded."
            )
        topic = self._topics(*(part for part in ("tilt", "rotor_speed") if part in self.parts))
        values = (empty if part is None else part.values for part in (tilt, speed))
        return self._made(ActuatorSeries, topic, main, *values)

    def _joined_commands(self, first: _Part, second: _Part) -> tuple[_Part, _Part]:
        """Two topics of commands at the stamps of the first; each with the other's nearest sample."""
        partner = nearest(first.stamps, second.stamps)
        apart = np.abs(second.stamps[partner] - first.stamps)
        allowed = max(np.median(np.diff(first.stamps)), np.median(np.diff(second.stamps)))
        keep = np.flatnonzero(apart <= allowed)
        if len(keep) < 2:
            self._note(f"{second.source.topic} has no samples at the times of {first.source.topic}: left out.")
            return first, replace(second, stamps=first.stamps, values=np.zeros((len(first.stamps), 0)), dropped={})
        dropped = first.dropped
        if alone := len(apart) - len(keep):
            dropped = dropped | {"no partner": alone}
            self._note(f"{alone} samples of {first.source.topic} have no partner in {second.source.topic}: left out.")
        joined = _Part(first.source, first.stamps[keep], first.values[keep], dropped)
        return joined, _Part(second.source, joined.stamps, second.values[partner[keep]], dropped)

    def odometry(self) -> OdometrySeries | None:
        """Pose, with the velocity taken to E and the rate to B, whatever frames the log has them in."""
        pose = self.parts.get("pose")
        if pose is None:
            return None
        quat_EB = so3.continuous(so3.normalise(pose.values[:, [6, 3, 4, 5]]))
        values = (pose.values[:, :3].copy(), quat_EB, *self._motion(pose, quat_EB, "twist", "B"))
        return self._made(OdometrySeries, self._topics("pose", "twist"), pose, *values)

    def reference(self) -> ReferenceSeries | None:
        """The reference, with velocity and acceleration in E and rates in D."""
        pose = self.parts.get("reference_pose")
        if pose is None:
            return None
        quat_ED = so3.continuous(so3.normalise(pose.values[:, [6, 3, 4, 5]]))
        velocity_E, omega_D = self._motion(pose, quat_ED, "reference_twist", "D")
        acceleration_E, omega_dot_D = self._acceleration(pose, quat_ED, velocity_E)
        values = (pose.values[:, :3], quat_ED, velocity_E, omega_D, acceleration_E, omega_dot_D)
        topics = self._topics("reference_pose", "reference_twist")
        return self._made(ReferenceSeries, topics, pose, *values)

    def _motion(self, pose: _Part, quat: Array, name: str, frame: str) -> tuple[Array | None, Array | None]:
        """velocity_E and omega in the body frame at the pose's stamps; `frame` is the body frame's letter."""
        twist = self.parts.get(name)
        if twist is None:
            return None, None
        values = self._at(pose, twist)
        topic = twist.source.topic
        in_body = "Odometry" in self.log.tables[topic].type
        time = self._seconds(pose.stamps)
        meant = twist.source.meaning
        linear, angular = values[:, :3], values[:, 3:]
        velocity_E = omega = None
        if np.isfinite(linear).all():
            readings: dict[str, Rows] = {
                frame: lambda rows: so3.rotate(quat[rows], in_other_axes(linear[rows], meant.body("velocity"))),
                "E": lambda rows: in_other_axes(linear[rows], meant.world),
            }
            default = frame if in_body else "E"
            truth = slope_of(pose.values[:, :3])
            velocity_E = self._in_frame(topic, "linear velocity", readings, truth, time, default)
        if np.isfinite(angular).all():
            readings = {
                frame: lambda rows: in_other_axes(angular[rows], meant.body("rate")),
                "E": lambda rows: so3.rotate_inverse(quat[rows], in_other_axes(angular[rows], meant.world)),
            }
            # a stamped twist of a body is in its own frame more often than not, as far as the rate goes
            omega = self._in_frame(
                topic, "angular velocity", readings, lambda time, rows: angular_velocity(time, quat[rows]), time, frame
            )
        return velocity_E, omega

    def _acceleration(self, pose: _Part, quat_ED: Array, velocity_E: Array | None) -> tuple[Array | None, Array | None]:
        part = self.parts.get("reference_acceleration")
        if part is None:
            return None, None
        values = self._at(pose, part)
        in_body = "Accel" in self.log.tables[part.source.topic].type
        linear, angular = values[:, :3], values[:, 3:]
        time = self._seconds(pose.stamps)
        acceleration_E = None
        if np.isfinite(linear).all():
            readings: dict[str, Rows] = {
                "D": lambda rows: so3.rotate(quat_ED[rows], linear[rows]),
                "E": lambda rows: linear[rows],
            }
            default = "D" if in_body else "E"
            velocity = smooth(time, pose.values[:, :3], derivative=1) if velocity_E is None else velocity_E
            acceleration_E = self._in_frame(
                part.source.topic, "acceleration", readings, slope_of(velocity), time, default
            )
        return acceleration_E, angular if np.isfinite(angular).all() else None

    def _in_frame(
        self, topic: str, what: str, readings: Mapping[str, Rows], truth: Slope, time: Array, default: str
    ) -> Array:
        """The reading that fits the derivative of the pose, with a note where it is not the convention's."""
        frame, misfit = best_frame(readings, truth, time, default)
        if frame != default:
            self._note(
                f"{topic}: its {what} is in frame {frame}, not {default} as its type suggests (rms difference from "
                f"the differentiated pose {misfit[frame]:.2g} against {misfit[default]:.2g}); read as {frame}."
            )
        return np.ascontiguousarray(readings[frame](slice(None)))

    def _at(self, pose: _Part, other: _Part) -> Array:
        """Values of another topic at the pose's stamps: the same rows, or interpolated (no further than its ends)."""
        if len(pose.stamps) == len(other.stamps) and np.array_equal(pose.stamps, other.stamps):
            return other.values
        return interpolated(self._seconds(pose.stamps), self._seconds(other.stamps), other.values)

    def _topics(self, *parts: str) -> str:
        sources = self.assignment.sources
        return " + ".join(dict.fromkeys(sources[part].topic for part in parts if part in sources))

    def _seconds(self, stamps: Stamps) -> Array:
        return np.asarray((stamps - self.start_ns) / 1e9)

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)
