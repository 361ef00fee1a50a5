"""Faults of a recorder, in the file that was written: stamps, clocks, another vehicle beside the first."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer


def stamps(path: Path, topics: tuple[str, ...], change: Callable[[int, int], int]) -> None:
    """Rewrite the header stamps of some topics: `change` gets log time and stamp [ns]; CDR has them at byte 4."""
    partial_path = path.with_suffix(".partial")
    with path.open("rb") as source, partial_path.open("wb") as target:
        writer = Writer(target)
        writer.start(profile="ros2")
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(source).iter_messages():
            if channel.id not in channels:
                assert schema is not None
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
            data = bytearray(message.data)
            if channel.topic in topics:
                sec, nanosec = np.frombuffer(bytes(data[4:12]), dtype="<u4")
                stamp = change(message.log_time, int(sec) * 1_000_000_000 + int(nanosec))
                data[4:12] = np.array(divmod(stamp, 1_000_000_000), dtype="<u4").tobytes()
            writer.add_message(channels[channel.id], message.log_time, bytes(data), message.publish_time)
        writer.finish()
    partial_path.replace(path)


EVERY = ("/command/wrench", "/command/actuators", "/imu", "/odometry")
START_NS = 1_700_000_000_000_000_000


def milliseconds(path: Path) -> None:
    """A millisecond counter from start-up, written as seconds."""
    stamps(path, EVERY, lambda log, stamp: (stamp - START_NS) * 1000 + 5_000_000_000)


def microseconds(path: Path) -> None:
    """A microsecond counter from start-up, written as seconds."""
    stamps(path, EVERY, lambda log, stamp: (stamp - START_NS) * 1_000_000 + 5_000_000_000)


def two_vehicles(path: Path) -> None:
    """A leader whose topics have no namespace, and a follower that flies the same a tenth of a second later."""
    partial_path = path.with_suffix(".partial")
    with path.open("rb") as source, partial_path.open("wb") as target:
        writer = Writer(target)
        writer.start(profile="ros2")
        channels: dict[str, int] = {}
        for schema, channel, message in make_reader(source).iter_messages():
            for topic, late in ((channel.topic, 0), (f"/follower{channel.topic}", 100_000_000)):
                if topic not in channels:
                    kind = writer.register_schema(schema.name, schema.encoding, schema.data) if schema else 0
                    channels[topic] = writer.register_channel(topic, channel.message_encoding, kind)
                writer.add_message(channels[topic], message.log_time + late, message.data, message.publish_time)
        writer.finish()
    partial_path.replace(path)


def hour(path: Path) -> None:
    """Somebody sets the clock of the companion computer in mid-flight: the IMU's stamps jump by an hour."""
    stamps(path, ("/imu",), lambda log, stamp: stamp + (3_600_000_000_000 if log - START_NS > 8e9 else 0))
