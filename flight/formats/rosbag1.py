"""ROS 1 bags (`.bag`, format 2.0), through rosbags' reader."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader as BagReader

from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats.reader import Batch, Channel, Gatherer, Reader, Wanted, normalised_type, one_line


@dataclass
class Rosbag1Reader(Reader):
    """Reads one ROS 1 bag."""

    name: ClassVar[str] = "ROS 1 bag"
    magic: ClassVar[bytes] = b"#ROSBAG V"

    def batches(self, wanted: Wanted) -> Iterator[Batch]:
        """Go through the bag in order of time."""
        gathered = Gatherer()
        try:
            with BagReader(self.path) as bag:
                channels = {connection.id: _channel(connection) for connection in bag.connections}
                for connection, log_time_ns, payload in bag.messages():
                    channel = channels[connection.id]
                    yield from gathered.add(channel, log_time_ns, bytes(payload) if wanted(channel) else b"")
        except Exception as error:  # a damaged bag makes rosbags raise many kinds
            if not gathered.total:
                raise LogError(
                    f"{self.path}: not a readable ROS 1 bag ({one_line(error)}); "
                    "a bag that was cut short is repaired by `rosbag reindex`"
                ) from error
            self.notes.append(f"{self.path.name} is damaged ({one_line(error)}): read as far as it goes.")
        yield from gathered.flush()


def _channel(connection: Connection) -> Channel:
    return Channel(connection.topic, normalised_type(connection.msgtype), "ros1", connection.msgdef.data or None)
