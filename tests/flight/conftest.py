"""Logs made on the spot: one recording, saved in every format by libraries other than ours."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Bag1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from wrenchgap import flight
from wrenchgap.flight import so3
from wrenchgap.flight.flight import GRAVITY

HEADER = "std_msgs/Header header"
CUSTOM = {
    "actuator_msgs/msg/Actuators": f"{HEADER}\nfloat64[] position\nfloat64[] velocity\nfloat64[] normalized",
    "mav_msgs/msg/MotorSpeed": f"{HEADER}\nfloat64[] motor_speed",
    "lab_msgs/msg/Mixed": "string name\nuint8 flag\nfloat64 a\nint16[3] b\nstring[] words\nfloat32[] c\nuint64 d",
}
START_NS = 1_700_000_000_000_000_000


def typestore(ros):
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    for name, text in CUSTOM.items():
        store.register(get_types_from_msg(text, name))
    return store


def message(store, kind, fields, prefix=""):
    """A message with `fields` by dotted name; everything else is zero or empty."""
    values = {}
    for name, (node, payload) in store.fielddefs[kind][1]:
        path = prefix + name
        if path in fields:
            values[name] = fields[path]
        elif node == Nodetype.NAME:
            values[name] = message(store, payload, fields, f"{path}.")
        elif node == Nodetype.BASE:
            values[name] = "" if payload[0] == "string" else 0
        elif node == Nodetype.ARRAY:
            values[name] = np.zeros(payload[1], dtype=payload[0][1][0])
        elif payload[0][0] == Nodetype.BASE and payload[0][1][0] != "string":
            values[name] = np.zeros(0, dtype=payload[0][1][0])
        else:
            values[name] = []
    return store.types[kind](**values)


class Recording:
    """Messages (topic, type, log time, fields), saved as a log."""

    def __init__(self):
        self.entries = []

    def add(self, topic, kind, log_ns, fields=None, stamp_ns=None):
        fields = dict(fields or {})
        if stamp_ns is not None:
            fields["header.stamp.sec"], fields["header.stamp.nanosec"] = divmod(int(stamp_ns), 1_000_000_000)
        self.entries.append((topic, kind, int(log_ns), fields))
        return self

    def series(self, topic, kind, log_s, columns, stamp_s=None, start_ns=START_NS):
        """One message per time; `columns` by dotted name, (N,) each; `stamp_s` True for stamps equal to log times."""
        stamps = log_s if stamp_s is True else stamp_s
        for i, time in enumerate(log_s):
            log_ns = start_ns + round(time * 1e9)
            stamp = None if stamps is None else (start_ns if stamp_s is True else 0) + round(stamps[i] * 1e9)
            self.add(topic, kind, log_ns, {name: values[i] for name, values in columns.items()}, stamp)
        return self

    def plain(self, topic, time, log_s=None, stamp_s=True):
        """What a vehicle in `Motion` sends on one of the topics of PLAIN."""
        kind, columns = PLAIN[topic]
        return self.series(topic, kind, time if log_s is None else log_s, columns(time), stamp_s=stamp_s)

    def save(self, path, form="mcap-zstd"):
        entries = sorted(self.entries, key=lambda entry: entry[2])
        kind, _, variant = form.partition("-")
        return getattr(self, f"_save_{kind}")(Path(path), variant, entries)

    def _save_mcap(self, path, variant, entries, ros=2):
        store = typestore(ros)
        compression = {"lz4": CompressionType.LZ4, "none": CompressionType.NONE}.get(variant, CompressionType.ZSTD)
        options = {"use_chunking": False} if variant == "unchunked" else {"chunk_size": 16384}
        if variant == "unindexed":
            switches = ("use_statistics", "use_summary_offsets", "repeat_channels", "repeat_schemas")
            options |= dict.fromkeys(switches, False) | {"index_types": IndexType.NONE}
        with path.open("wb") as stream:
            writer = Writer(stream, compression=compression, **options)
            writer.start(profile=f"ros{ros}")
            channels = {}
            for topic, name, log_ns, fields in entries:
                if topic not in channels:
                    text = store.generate_msgdef(name, ros_version=ros)[0].encode()
                    spelled = name if ros == 2 else name.replace("/msg/", "/")
                    schema = writer.register_schema(spelled, f"ros{ros}msg", text)
                    channels[topic] = writer.register_channel(topic, "cdr" if ros == 2 else "ros1", schema)
                made = message(store, name, fields)
                serialise = store.serialize_cdr if ros == 2 else store.serialize_ros1
                writer.add_message(channels[topic], log_ns, bytes(serialise(made, name)), log_ns)
            writer.finish()
        return path

    def _save_mcap1(self, path, variant, entries):
        return self._save_mcap(path, variant, entries, ros=1)

    def _save_bag(self, path, variant, entries):
        bag, store = Bag1Writer(path), typestore(1)
        if variant:
            bag.set_compression(Bag1Writer.CompressionFormat[variant.upper()])
        return self._write(bag, store, store.serialize_ros1, entries)

    def _save_folder(self, path, variant, entries):
        plugin = StoragePlugin.MCAP if variant.startswith("mcap") else StoragePlugin.SQLITE3
        bag, store = Bag2Writer(path, version=9, storage_plugin=plugin), typestore(2)
        for mode in (CompressionMode.FILE, CompressionMode.MESSAGE):
            if variant.endswith(mode.name.lower()):
                bag.set_compression(mode, CompressionFormat.ZSTD)
        return self._write(bag, store, store.serialize_cdr, entries)

    def _write(self, bag, store, serialise, entries):
        with bag:
            connections = {}
            for topic, name, log_ns, fields in entries:
                if topic not in connections:
                    connections[topic] = bag.add_connection(topic, name, typestore=store)
                bag.write(connections[topic], log_ns, serialise(message(store, name, fields), name))
        return bag.path


class Motion:
    """A closed-form flight: x = a sin(w t), pitch = b sin(v t)."""

    a, w, b, v = 0.8, 1.7, 0.4, 2.3

    def __init__(self, time):
        t = np.asarray(time, dtype=float)
        zero = np.zeros_like(t)
        self.time = t
        self.position_E = np.stack((self.a * np.sin(self.w * t), 0.3 * np.cos(t), 1.0 + 0.1 * t), axis=1)
        self.velocity_E = np.stack((self.a * self.w * np.cos(self.w * t), -0.3 * np.sin(t), 0.1 + zero), axis=1)
        self.acceleration_E = np.stack((-self.a * self.w**2 * np.sin(self.w * t), -0.3 * np.cos(t), zero), axis=1)
        pitch = self.b * np.sin(self.v * t)
        self.quat_EB = np.stack((np.cos(pitch / 2), zero, np.sin(pitch / 2), zero), axis=1)
        self.omega_B = np.stack((zero, self.b * self.v * np.cos(self.v * t), zero), axis=1)
        self.specific_force_B = so3.rotate_inverse(self.quat_EB, self.acceleration_E + np.array([0.0, 0.0, GRAVITY]))

    def pose(self, prefix="pose"):
        return xyz(f"{prefix}.position", self.position_E) | xyz(f"{prefix}.orientation", self.quat_EB, "wxyz")

    def twist(self, prefix="twist", frame="B"):
        linear = so3.rotate_inverse(self.quat_EB, self.velocity_E) if frame == "B" else self.velocity_E
        return xyz(f"{prefix}.linear", linear) | xyz(f"{prefix}.angular", self.omega_B)

    def odometry(self, frame="B"):
        return self.pose("pose.pose") | self.twist("twist.twist", frame)

    def imu(self):
        return xyz("angular_velocity", self.omega_B) | xyz("linear_acceleration", self.specific_force_B)


def xyz(prefix, values, axes="xyz"):
    return {f"{prefix}.{axis}": values[:, i] for i, axis in enumerate(axes)}


def wrench(time, prefix="wrench"):
    values = np.stack([np.sin((i + 1) * 0.5 * np.asarray(time)) for i in range(6)], axis=1)
    return xyz(f"{prefix}.force", values[:, :3]) | xyz(f"{prefix}.torque", values[:, 3:])


PLAIN = {
    "/command/wrench": ("geometry_msgs/msg/WrenchStamped", wrench),
    "/imu": ("sensor_msgs/msg/Imu", lambda time: Motion(time).imu()),
    "/odometry": ("nav_msgs/msg/Odometry", lambda time: Motion(time).odometry()),
}


def plain_flight(seconds=4.0):
    """Commands and IMU at 100 Hz, odometry at 50 Hz, stamps equal to log times."""
    fast, slow = np.arange(0, seconds, 0.01), np.arange(0, seconds, 0.02)
    return Recording().plain("/command/wrench", fast).plain("/imu", fast).plain("/odometry", slow)


def cbor_log(path):
    """An MCAP whose only channel is in an encoding that is not read."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("Thing", "jsonschema", b"{}")
        channel = writer.register_channel("/thing", "cbor", schema)
        for i in range(10):
            writer.add_message(channel, START_NS + i, json.dumps({"x": i}).encode(), START_NS + i)
        writer.finish()
    return path


@pytest.fixture(scope="session")
def logs():
    """This module."""
    return sys.modules[__name__]


@pytest.fixture
def loaded(tmp_path):
    """The flight of a recording, saved and read."""
    return lambda recording: flight.load(recording.save(tmp_path / "log.mcap"))


@pytest.fixture(scope="session")
def plain(tmp_path_factory):
    """A plain flight as zstd MCAP."""
    return plain_flight().save(tmp_path_factory.mktemp("plain") / "plain.mcap")
