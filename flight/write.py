"""A flight as an MCAP file with ROS 2 messages, which Foxglove, PlotJuggler and the rosbag tools open.

Topics: /command/wrench, /desired/wrench (WrenchStamped), /command/actuators (actuator_msgs/Actuators: position = tilt,
velocity = rotor speed; normalised commands lie in normalized, pulse widths in the velocity of
/command/actuators_pwm; a normalised wrench is /command/wrench_normalised), /imu, /odometry (twist in B), /reference
(Odometry, twist in D), /reference/acceleration (AccelStamped, in D), /battery. What a message has room for and the
flight does not know is NaN. A pose of which no velocity is known is a PoseStamped. Log time and header stamp are the
same.

The same flight gives the same bytes. A file appears under its name when it is complete, or not at all.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from wrenchgap._escaping import storable
from wrenchgap.flight import so3
from wrenchgap.flight.atomic import atomic
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array, Flight, OdometrySeries, ReferenceSeries
from wrenchgap.flight.formats.decode import ACTUATORS, DTYPES, layout_of
from wrenchgap.flight.formats.message_layouts import joined_ranges
from wrenchgap.flight.formats.reader import Table
from wrenchgap.flight.formats.standard_topics import StandardTopic, vector
from wrenchgap.flight.mcap_messages import Messages, write_messages

PROVENANCE = "wrenchgap"
"""Name of the metadata record in which a file says where it comes from."""

SECOND = 1_000_000_000  # ns


@dataclass(frozen=True)
class Named:
    """An additional series under a topic of its own: `values` (N,) or (N, K) at `time` (N,) [s since the start].

    Without a `type` it becomes std_msgs/Float64, geometry_msgs/Vector3Stamped (K = 3), WrenchStamped (K = 6) or
    std_msgs/Float64MultiArray.
    """

    topic: str
    time: Array
    values: Array


@dataclass(frozen=True)
class _Topic:
    """Messages as columns; numbers that are `alike` in all of them and texts, by dotted name."""

    table: Table
    alike: Mapping[str, Any] = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=lambda: {"header.frame_id": "base_link"})


At = Callable[[str, Array], StandardTopic]
"""A topic to be, by its name and times [s since the start]."""


def write(
    flight: Flight,
    path: str | Path,
    extra: tuple[Named, ...] = (),
    metadata: Mapping[str, str] | None = None,
    force: bool = False,
) -> Path:
    """Write a flight, additional series and provenance; an existing file is only replaced with `force`.

    Raises UsageError: the file exists or cannot be written, its folder does not exist, its name does not end in .mcap,
    or two series claim one topic.
    """
    path = Path(path)
    _check_target(path, force)
    at = _clock(flight.start_ns, [*(series.time for series in flight.series().values()), *(one.time for one in extra)])
    topics = [*_flight_topics(flight, at), *(_named_topic(one, at) for one in extra)]
    names = [topic.table.topic for topic in topics]
    if len(set(names)) < len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise UsageError(f"{path}: topic {', '.join(twice)} is written twice; give the additional series another name")
    about = {key: storable(value) for key, value in (metadata or {}).items()}
    with atomic(path) as partial, partial.open("wb") as stream:
        store, every = get_typestore(Stores.ROS2_HUMBLE), []
        store.register(get_types_from_msg(ACTUATORS["actuator_msgs/msg/Actuators"], "actuator_msgs/msg/Actuators"))
        for topic in topics:
            name, kind, stamps = topic.table.topic, topic.table.type, topic.table.log_time_ns
            definition = store.generate_msgdef(kind, ros_version=2)[0]
            every.append(Messages(name, kind, definition, stamps, *_payloads(topic, store)))
        write_messages(stream, every, PROVENANCE, (PROVENANCE, about) if about else None)
    return path


def provenance(path: str | Path) -> dict[str, str]:
    """The metadata that `write` was given; empty for other files."""
    with Path(path).open("rb") as stream:
        found = {record.name: dict(record.metadata) for record in make_reader(stream).iter_metadata()}
    return found.get(PROVENANCE, {})


def _check_target(path: Path, force: bool) -> None:
    if path.suffix != ".mcap":
        raise UsageError(f"{path}: logs are written as MCAP; expected a name that ends in .mcap")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: the folder {path.parent} does not exist; create it first")
    if path.is_dir():
        raise UsageError(f"{path}: is a folder; expected the name of a file")
    if path.exists() and not force:
        raise UsageError(f"{path}: exists already; choose another name or overwrite it with --force")


def _clock(start_ns: int, times: list[Array]) -> At:
    """Times as stamps [ns], of an array once; all moved by whole seconds where one would be before MCAP's first."""
    first = start_ns + min((round(float(time[0]) * SECOND) for time in times if len(time)), default=0)
    start = start_ns if first >= 0 else start_ns + SECOND * -(first // SECOND)
    known = {id(t): np.asarray(start + np.round(np.asarray(t) * 1e9).astype(np.int64)) for t in times}
    return lambda name, time: StandardTopic(name, known[id(time)], known[id(time)])


def _payloads(
    topic: _Topic, store: Typestore
) -> tuple[NDArray[np.uint8], Callable[[int, int], NDArray[np.uint8]], NDArray[np.int64]]:
    """CDR messages as `Messages` has them: one is serialised; numbers that all share go there, the others beside it."""
    kind, columns, stamps = topic.table.type, topic.table.columns, topic.table.log_time_ns
    lengths = {name: values.shape[1] for name, values in columns.items() if values.ndim == 2}
    blank = _blank(kind, store, topic.texts, lengths)
    template = np.frombuffer(bytes(store.serialize_cdr(blank, kind)), dtype=np.uint8).copy()
    layout = layout_of(template.tobytes(), kind, store.fielddefs)
    for name, value in topic.alike.items():
        offset, dtype, count = layout[name]
        template[offset : offset + dtype.itemsize * count] = np.full(count, value, dtype=dtype).view(np.uint8)
    header = [name for name in ("header.stamp.sec", "header.stamp.nanosec") if name in layout]
    names = sorted([*columns, *header], key=lambda name: layout[name][0])
    kinds = [(name, dtype, (count,)) for name in names for _, dtype, count in [layout[name]]]

    def varying(start: int, stop: int) -> NDArray[np.uint8]:
        """What varies in messages start to stop, as bytes."""
        out = np.empty(stop - start, dtype=kinds)
        for name in names:
            if name in header:
                seconds = stamps[start:stop] // SECOND
                part = seconds if name == header[0] else stamps[start:stop] - SECOND * seconds
            else:
                part = columns[name][start:stop]
            out[name] = part if part.ndim > 1 else part[:, None]
        return out.view(np.uint8).reshape(stop - start, out.dtype.itemsize)

    sizes = [dtype.itemsize * count for _, dtype, (count,) in kinds]
    starts = np.cumsum([0, *sizes])[:-1].tolist()
    return template, varying, joined_ranges(zip(starts, (layout[name][0] for name in names), sizes, strict=True))


def _blank(kind: str, store: Typestore, texts: Mapping[str, str], lengths: dict[str, int], prefix: str = "") -> object:
    """A message of zeros, with given texts and lengths of sequences."""
    values: dict[str, Any] = {}
    descriptions: Any = store.fielddefs[kind][1]
    for name, (node, payload) in descriptions:
        path = f"{prefix}{name}"
        if node == Nodetype.NAME:
            values[name] = _blank(str(payload), store, texts, lengths, f"{path}.")
        elif node == Nodetype.BASE:
            values[name] = texts.get(path, "") if payload[0] == "string" else 0
        else:
            (inner, base), number = payload
            count = int(number) if node == Nodetype.ARRAY else lengths.get(path, 0)
            plain = inner == Nodetype.BASE and base[0] in DTYPES
            values[name] = np.zeros(count, dtype=DTYPES[base[0]]) if plain else []
    return store.types[kind](**values)


def _flight_topics(flight: Flight, at: At) -> Iterator[_Topic]:
    for wrench, name in ((flight.commanded, "/command/wrench"), (flight.desired, "/desired/wrench")):
        if wrench is not None:
            topic = at(name if wrench.unit == "N" else f"{name}_normalised", wrench.time)
            yield _Topic(topic.wrench(wrench.wrench_B[:, :3], wrench.wrench_B[:, 3:]))
    if (sent := flight.actuators) is not None:
        topic = at("/command/actuators_pwm" if sent.unit == "pwm" else "/command/actuators", sent.time)
        yield _Topic(topic.actuators(sent.rotor_speed, sent.tilt, sent.unit))
    if (imu := flight.imu) is not None:
        none = [-1.0, *[0.0] * 8]  # as the message's definition asks where there is no estimate
        alike: dict[str, Any] = {"orientation.w": 1.0, "orientation_covariance": none}
        for name, values in (("angular_velocity", imu.omega_B), ("linear_acceleration", imu.specific_force_B)):
            if np.isnan(values).all():
                alike[f"{name}_covariance"] = none
        yield _Topic(at("/imu", imu.time).imu(imu.omega_B, imu.specific_force_B), alike)
    if (seen := flight.odometry) is not None:
        yield _moving(at("/odometry", seen.time), seen, seen.quat_EB, seen.omega_B, "base_link")
    if (asked := flight.reference) is not None:
        yield _moving(at("/reference", asked.time), asked, asked.quat_ED, asked.omega_D, "reference")
        linear, angular = asked.acceleration_E, asked.omega_dot_D
        if linear is not None or angular is not None:
            linear_D = None if linear is None else so3.rotate_inverse(asked.quat_ED, linear)
            made = at("/reference/acceleration", asked.time).acceleration(linear_D, angular)
            yield _Topic(made, texts={"header.frame_id": "reference"})
    if (battery := flight.battery) is not None:
        unknown = ("temperature", "current", "charge", "capacity", "design_capacity", "percentage")
        alike = dict.fromkeys(unknown, np.nan) | {"present": 1.0}
        yield _Topic(at("/battery", battery.time).battery(battery.voltage), alike, {})


def _moving(
    topic: StandardTopic, series: OdometrySeries | ReferenceSeries, quat: Array, omega: Array | None, child: str
) -> _Topic:
    """Odometry with the twist in the child frame, or a bare pose where no velocity is known."""
    texts = {"header.frame_id": "world"}
    if series.velocity_E is None and omega is None:
        columns = vector("pose.position", series.position_E) | vector("pose.orientation", quat, "wxyz")
        return _Topic(topic.table("geometry_msgs/msg/PoseStamped", columns), texts=texts)
    made = topic.odometry(series.position_E, quat, series.velocity_E, omega)
    return _Topic(made, texts=texts | {"child_frame_id": child})


def _named_topic(named: Named, at: At) -> _Topic:
    values, topic = np.asarray(named.values, dtype=float), at(named.topic, named.time)
    if len(values) != len(named.time):
        raise UsageError(f"series {named.topic}: {len(values)} values at {len(named.time)} times; expected as many")
    if values.ndim == 1:
        return _Topic(topic.table("std_msgs/msg/Float64", {"data": values}), texts={})
    if values.shape[1] == 3:
        return _Topic(topic.table("geometry_msgs/msg/Vector3Stamped", vector("vector", values)))
    if values.shape[1] == 6:
        return _Topic(topic.wrench(values[:, :3], values[:, 3:]))
    return _Topic(topic.table("std_msgs/msg/Float64MultiArray", {"data": values}), texts={})
