"""Log formats: one file each, one table, one function that reads any of them into columns."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats import ardupilot, px4
from wrenchgap.flight.formats.dataflash import DataflashReader
from wrenchgap.flight.formats.decode import Decoder, UndecodableError, definitions_of, flat_fields
from wrenchgap.flight.formats.mcap import McapReader
from wrenchgap.flight.formats.reader import Channel, Reader, TableReader
from wrenchgap.flight.formats.rosbag1 import Rosbag1Reader
from wrenchgap.flight.formats.rosbag2 import Rosbag2FolderReader, Rosbag2SqliteReader
from wrenchgap.flight.formats.table import Columns
from wrenchgap.flight.formats.table import Selection as Selection
from wrenchgap.flight.formats.table import Table as Table
from wrenchgap.flight.formats.tabular import CsvReader, ParquetReader
from wrenchgap.flight.formats.ulog import UlogReader

READERS: tuple[type[Reader], ...] = (
    McapReader,
    Rosbag1Reader,
    Rosbag2FolderReader,
    Rosbag2SqliteReader,
    UlogReader,
    DataflashReader,
    ParquetReader,
    CsvReader,
)
"""Every format, in the order in which they are asked whether a file is theirs."""

SUPPORTED = (
    "MCAP (.mcap), ROS 1 bag (.bag), ROS 2 bag (folder or .db3), PX4 (.ulg), ArduPilot (.bin), CSV or Parquet tables"
)
DECODABLE = ("cdr", "ros1")


@dataclass(frozen=True)
class Log:
    """A log file as it is, before any meaning: tables by topic, in the order of their names."""

    path: Path
    format: str
    size: int
    content_hash: str
    tables: dict[str, Table]
    notes: tuple[str, ...] = ()


def reader_of(path: Path) -> Reader:
    """The reader for a file or folder, by its content and not by its name."""
    if not path.exists():
        raise LogError(f"{path}: no such file or folder")
    head = b""
    if path.is_file():
        with path.open("rb") as file:
            head = file.read(64)
        if not head:
            raise LogError(f"{path}: the file is empty (0 bytes); expected {SUPPORTED}")
    for kind in READERS:
        if kind.accepts(path, head):
            return kind(path)
    raise LogError(f"{path}: not a log: begins with {head[:8]!r}; expected {SUPPORTED}")


def content_hash(path: Path) -> str:
    """SHA-256 of the file(s) of a log. Raises LogError where there is none."""
    return _hash(reader_of(path).data_files())


def read_log(path: Path, selection: Selection) -> Log:
    """Read a log once: columns of the topics that `selection` wants, log times of all.

    Raises LogError: no such file, no log, or no message in it.
    """
    reader = reader_of(path)
    files = reader.data_files()
    tables, notes = _tables(reader, selection)
    if not tables:
        detail = f" ({' '.join(reader.notes)})" if reader.notes else ""
        raise LogError(f"{path}: the {reader.name} holds no message{detail}")
    for derived in (px4.derived, ardupilot.derived):
        made, said = derived(tables, getattr(reader, "parameters", {}))
        tables, notes = tables | made, notes + said
    tables = dict(sorted(tables.items()))
    size = sum(file.stat().st_size for file in files)
    return Log(path, reader.name, size, _hash(files), tables, tuple(reader.notes + notes))


def _tables(reader: Reader, selection: Selection) -> tuple[dict[str, Table], list[str]]:
    """What a reader gives, decoded, and what the decoding has to say."""
    if isinstance(reader, TableReader):
        return reader.tables(selection), []
    collector = _Collector(lambda topic, kind, fields: selection(topic, kind, fields) or px4.wanted(topic, kind))
    for batch in reader.batches(collector.wanted):
        collector.add(batch.channel, batch.log_time_ns, batch.payloads)
    return {topic: collector.table(topic) for topic in sorted(collector.times)}, collector.notes


@dataclass
class _Collector:
    """Decodes batches as they come. A topic's first channel decides its type."""

    selection: Selection
    times: dict[str, list[NDArray[np.int64]]] = field(default_factory=dict)
    channels: dict[str, Channel] = field(default_factory=dict)
    decoders: dict[Channel, Decoder | None] = field(default_factory=dict)
    problems: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def wanted(self, channel: Channel) -> bool:
        if channel not in self.decoders:
            self.decoders[channel] = self._decoder(channel)
        return self.decoders[channel] is not None

    def _decoder(self, channel: Channel) -> Decoder | None:
        first = self.channels.setdefault(channel.topic, channel)
        if (channel.type, channel.encoding) != (first.type, first.encoding):
            self.notes.append(f"{channel.topic} carries {first.type} and also {channel.type}: the latter is left out.")
            return None
        if first is not channel and self.decoders.get(first) is not None:
            return self.decoders[first]  # several writers of one topic
        if channel.encoding not in DECODABLE:
            self.problems[channel.topic] = f"its messages are encoded as {channel.encoding!r}, expected cdr or ros1"
            return None
        try:
            definitions = definitions_of(channel)
            fields = flat_fields(channel.type, definitions)
        except (UndecodableError, KeyError) as error:
            self.problems[channel.topic] = str(error)
            return None
        return Decoder(channel, definitions) if self.selection(channel.topic, channel.type, fields) else None

    def add(self, channel: Channel, log_time_ns: list[int], payloads: list[bytes]) -> None:
        first = self.channels[channel.topic]
        if channel.type != first.type:
            return
        self.times.setdefault(channel.topic, []).append(np.array(log_time_ns, dtype=np.int64))
        decoder = self.decoders[channel]
        if decoder is not None:
            decoder.add(payloads)

    def table(self, topic: str) -> Table:
        channel = self.channels[topic]
        log_time_ns = np.concatenate(self.times[topic])
        order = np.argsort(log_time_ns, kind="stable")
        decoder = self.decoders[channel]
        problem = self.problems.get(topic)
        if decoder is None:
            return Table(topic, channel.type, log_time_ns[order], problem=problem)
        if decoder.malformed:
            problem = f"{decoder.malformed} of {decoder.count} messages do not fit the definition of {channel.type}"
        columns = {name: values[order] for name, values in decoder.columns().items()}
        return Table(topic, channel.type, log_time_ns[order], _header_ns(columns), columns, problem)


def _header_ns(columns: Columns) -> NDArray[np.int64] | None:
    """Header stamps [ns]; None where there is no header, or where all its stamps are zero."""
    seconds, nanoseconds = columns.get("header.stamp.sec"), columns.get("header.stamp.nanosec")
    if seconds is None or nanoseconds is None:
        return None
    if seconds.dtype.kind == "f":  # some messages were malformed
        seconds, nanoseconds = np.nan_to_num(seconds), np.nan_to_num(nanoseconds)
    stamps = seconds.astype(np.int64) * 1_000_000_000 + nanoseconds.astype(np.int64)
    return stamps if np.any(stamps) else None


def _hash(files: list[Path]) -> str:
    digest = hashlib.sha256()
    for path in files:
        with path.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()
