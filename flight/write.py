"""A flight as an MCAP file with ROS 2 messages, which Foxglove, PlotJuggler and the rosbag tools open.

Topics: /command/wrench, /desired/wrench (WrenchStamped), /command/actuators (actuator_msgs/Actuators: position = tilt,
velocity = rotor speed; normalised commands lie in normalized, pulse widths in the velocity of
/command/actuators_pwm; a normalised wrench is /command/wrench_normalised), /imu, /odometry (twist in B), /reference
(Odometry, twist in D), /reference/acceleration (AccelStamped, in D), /battery. What a message has room for and the
flight does not know is NaN. A pose of which no velocity is known is a PoseStamped. Log time and header stamp are the
same.

The same flight gives the same bytes. A file appears under its name when it is complete, or not at all.
"""

from __future__ import annotations

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
from wrenchgap.flight.flight import Array, Flight, ReferenceSeries
from wrenchgap.flight.formats.decode import ACTUATORS, DTYPES, layout_of
from wrenchgap.flight.mcap_messages import Messages, write_messages

PROVENANCE = "wrenchgap"
"""Name of the metadata record in which a file says where it comes from."""

SECOND = 1_000_000_000  # ns

Fields = dict[str, Array | float]


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
    """N messages of one type at `time` (N,) [s since the start]; numeric fields and texts by dotted name."""

    name: str
    type: str
    time: Array
    fields: Fields
    texts: dict[str, str] = field(default_factory=lambda: {"header.frame_id": "base_link"})


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
    topics = [*_flight_topics(flight), *map(_named_topic, extra)]
    names = [topic.name for topic in topics]
    if len(set(names)) < len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise UsageError(f"{path}: topic {', '.join(twice)} is written twice; give the additional series another name")
    about = {key: storable(value) for key, value in (metadata or {}).items()}
    with atomic(path) as partial, partial.open("wb") as stream:
        _write(stream, topics, _start(flight.start_ns, topics), about)
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


def _start(start_ns: int, topics: list[_Topic]) -> int:
    """When the flight starts [ns], moved by whole seconds where a stamp would be before the first that MCAP has."""
    first = start_ns + min((round(float(topic.time[0]) * SECOND) for topic in topics if len(topic.time)), default=0)
    return start_ns if first >= 0 else start_ns + SECOND * -(first // SECOND)


def _write(stream: Any, topics: list[_Topic], start_ns: int, metadata: dict[str, str]) -> None:
    store, every = _typestore(), []
    shared = {id(topic.time): topic.time for topic in topics}
    clocks = {k: np.asarray(start_ns + np.round(np.asarray(time) * 1e9).astype(np.int64)) for k, time in shared.items()}
    for topic in topics:
        stamps = clocks[id(topic.time)]
        definition = store.generate_msgdef(topic.type, ros_version=2)[0]
        every.append(Messages(topic.name, topic.type, definition, stamps, *_payloads(topic, stamps, store)))
    write_messages(stream, every, PROVENANCE, (PROVENANCE, metadata) if metadata else None)


def _payloads(
    topic: _Topic, stamps: NDArray[np.int64], store: Typestore
) -> tuple[NDArray[np.uint8], Callable[[int, int], NDArray[np.uint8]], NDArray[np.int64]]:
    """CDR messages as `Messages` has them: one is serialised; numbers that all share go there, the others beside it."""
    lengths = {name: v.shape[1] for name, v in topic.fields.items() if isinstance(v, np.ndarray) and v.ndim == 2}
    blank = _blank(topic.type, store, topic.texts, lengths)
    template = np.frombuffer(bytes(store.serialize_cdr(blank, topic.type)), dtype=np.uint8).copy()
    layout = layout_of(template.tobytes(), topic.type, store.fielddefs)
    fields: dict[str, Any] = dict(topic.fields)
    if "header.stamp.sec" in layout:
        fields |= {"header.stamp.sec": stamps, "header.stamp.nanosec": stamps}
    series = sorted((layout[name][0], name) for name, values in fields.items() if np.ndim(values) > 0)
    for name in fields.keys() - {name for _, name in series}:
        offset, dtype, count = layout[name]
        template[offset : offset + dtype.itemsize * count] = np.full(count, fields[name], dtype=dtype).view(np.uint8)
    kinds = [(name, dtype, (count,)) for _, name in series for _, dtype, count in [layout[name]]]

    def varying(start: int, stop: int) -> NDArray[np.uint8]:
        """What varies in messages start to stop, as bytes."""
        out = np.empty(stop - start, dtype=kinds)
        for _, name in series:
            part = fields[name][start:stop]
            if name.startswith("header.stamp."):
                seconds = part // SECOND
                part = seconds if name == "header.stamp.sec" else part - SECOND * seconds
            out[name] = part if np.ndim(part) > 1 else part[:, None]
        return out.view(np.uint8).reshape(stop - start, out.dtype.itemsize)

    sizes = np.array([dtype.itemsize * shape[0] for _, dtype, shape in kinds], dtype=np.int64)
    spans = np.stack((np.cumsum(sizes) - sizes, [offset for offset, _ in series], sizes), axis=1)
    return template, varying, _joined(spans)


def _joined(spans: NDArray[np.int64]) -> NDArray[np.int64]:
    """Spans (S, 3) as `Messages` has them, in order, those that lie side by side in one."""
    found: list[list[int]] = []
    for source, target, size in spans.tolist():
        if found and found[-1][1] + found[-1][2] == target:
            found[-1][2] += size
        else:
            found.append([source, target, size])
    return np.array(found, dtype=np.int64).reshape(-1, 3)


def _blank(kind: str, store: Typestore, texts: dict[str, str], lengths: dict[str, int], prefix: str = "") -> object:
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


def _typestore() -> Typestore:
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(ACTUATORS["actuator_msgs/msg/Actuators"], "actuator_msgs/msg/Actuators"))
    return store


def _flight_topics(flight: Flight) -> Iterator[_Topic]:
    for wrench, name in ((flight.commanded, "/command/wrench"), (flight.desired, "/desired/wrench")):
        if wrench is not None:
            yield _wrench(name if wrench.unit == "N" else f"{name}_normalised", wrench.time, wrench.wrench_B)
    if (sent := flight.actuators) is not None:
        place = "normalized" if sent.unit == "normalised" else "velocity"
        fields: Fields = {"position": sent.tilt, place: sent.rotor_speed}
        name = "/command/actuators_pwm" if sent.unit == "pwm" else "/command/actuators"
        yield _Topic(name, "actuator_msgs/msg/Actuators", sent.time, fields)
    if (imu := flight.imu) is not None:
        fields = _xyz("angular_velocity", imu.omega_B) | _xyz("linear_acceleration", imu.specific_force_B)
        no_orientation = np.tile([-1.0, *[0.0] * 8], (len(imu.time), 1))  # as the message's definition asks
        fields |= {"orientation.w": 1.0, "orientation_covariance": no_orientation}
        for name, values in (("angular_velocity", imu.omega_B), ("linear_acceleration", imu.specific_force_B)):
            if np.isnan(values).all():  # likewise
                fields[f"{name}_covariance"] = no_orientation
        yield _Topic("/imu", "sensor_msgs/msg/Imu", imu.time, fields)
    if (seen := flight.odometry) is not None:
        twist = (seen.velocity_E, seen.omega_B)
        yield _moving("/odometry", seen.time, (seen.position_E, seen.quat_EB), twist, "base_link")
    if flight.reference is not None:
        yield from _reference(flight.reference)
    if (battery := flight.battery) is not None:
        unknown = ("temperature", "current", "charge", "capacity", "design_capacity", "percentage")
        fields = {"voltage": battery.voltage} | dict.fromkeys(unknown, np.nan) | {"present": 1.0}
        yield _Topic("/battery", "sensor_msgs/msg/BatteryState", battery.time, fields, {})


def _xyz(prefix: str, values: Array) -> Fields:
    return {f"{prefix}.{axis}": values[:, i] for i, axis in enumerate("xyz")}


def _quaternion(prefix: str, quat_wxyz: Array) -> Fields:
    return {f"{prefix}.{axis}": quat_wxyz[:, i] for i, axis in enumerate("wxyz")}


def _wrench(name: str, time: Array, wrench_B: Array) -> _Topic:
    fields = _xyz("wrench.force", wrench_B[:, :3]) | _xyz("wrench.torque", wrench_B[:, 3:])
    return _Topic(name, "geometry_msgs/msg/WrenchStamped", time, fields)


def _reference(series: ReferenceSeries) -> Iterator[_Topic]:
    pose, twist = (series.position_E, series.quat_ED), (series.velocity_E, series.omega_D)
    yield _moving("/reference", series.time, pose, twist, "reference")
    linear, angular = series.acceleration_E, series.omega_dot_D
    if linear is None and angular is None:
        return
    unknown = np.full((len(series.time), 3), np.nan)
    linear_D = unknown if linear is None else so3.rotate_inverse(series.quat_ED, linear)
    fields = _xyz("accel.linear", linear_D) | _xyz("accel.angular", unknown if angular is None else angular)
    texts = {"header.frame_id": "reference"}
    yield _Topic("/reference/acceleration", "geometry_msgs/msg/AccelStamped", series.time, fields, texts)


def _moving(
    name: str, time: Array, pose: tuple[Array, Array], twist: tuple[Array | None, Array | None], child: str
) -> _Topic:
    """Odometry with the twist in the child frame, or a bare pose where no velocity is known."""
    position_E, quat = pose
    velocity_E, omega = twist
    texts = {"header.frame_id": "world"}
    if velocity_E is None and omega is None:
        fields = _xyz("pose.position", position_E) | _quaternion("pose.orientation", quat)
        return _Topic(name, "geometry_msgs/msg/PoseStamped", time, fields, texts)
    unknown = np.full((len(time), 3), np.nan)
    linear = unknown if velocity_E is None else so3.rotate_inverse(quat, velocity_E)
    fields = _xyz("pose.pose.position", position_E) | _quaternion("pose.pose.orientation", quat)
    fields |= _xyz("twist.twist.linear", linear) | _xyz("twist.twist.angular", unknown if omega is None else omega)
    return _Topic(name, "nav_msgs/msg/Odometry", time, fields, texts | {"child_frame_id": child})


def _named_topic(named: Named) -> _Topic:
    name, time, values = named.topic, named.time, np.asarray(named.values, dtype=float)
    if len(values) != len(time):
        raise UsageError(f"series {name}: {len(values)} values at {len(time)} times; expected as many")
    if values.ndim == 1:
        return _Topic(name, "std_msgs/msg/Float64", time, {"data": values}, {})
    if values.shape[1] == 3:
        return _Topic(name, "geometry_msgs/msg/Vector3Stamped", time, _xyz("vector", values))
    if values.shape[1] == 6:
        return _wrench(name, time, values)
    return _Topic(name, "std_msgs/msg/Float64MultiArray", time, {"data": values}, {})
