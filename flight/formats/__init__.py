"""Log formats: one file each, one table, one function that reads any of them into columns.

Readers of messages give batches of raw ones; `Collector` decodes them, each channel by its definition.
"""

import hashlib
import os
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.autopilot import Autopilot
from wrenchgap.flight.budget import LIMITS, Account, Budget
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats import ardupilot, px4
from wrenchgap.flight.formats.crazyflie_usd import CrazyflieUsdReader
from wrenchgap.flight.formats.dataflash import DataflashReader
from wrenchgap.flight.formats.decode import Decoder, UndecodableError, definitions_of, flat_fields
from wrenchgap.flight.formats.encodings import Encoded, encoded
from wrenchgap.flight.formats.mcap import McapReader
from wrenchgap.flight.formats.message_walk import Definitions
from wrenchgap.flight.formats.reader import (
    REPLACED,
    Batch,
    Channel,
    Columns,
    DoubtfulError,
    Places,
    Reader,
    TableReader,
)
from wrenchgap.flight.formats.reader import Selection as Selection
from wrenchgap.flight.formats.reader import Table as Table
from wrenchgap.flight.formats.reader import give_away as give_away
from wrenchgap.flight.formats.rosbag1 import Rosbag1Reader
from wrenchgap.flight.formats.rosbag2 import Rosbag2FolderReader, Rosbag2SqliteReader
from wrenchgap.flight.formats.tabular import BlackboxReader, CsvReader, ParquetReader
from wrenchgap.flight.formats.ulog import UlogReader
from wrenchgap.flight.memory import give_back

READERS: tuple[type[Reader], ...] = (
    McapReader,
    Rosbag1Reader,
    Rosbag2FolderReader,
    Rosbag2SqliteReader,
    UlogReader,
    DataflashReader,
    BlackboxReader,
    CrazyflieUsdReader,
    ParquetReader,
    CsvReader,
)
"""Every format, in the order in which they are asked whether a file is theirs."""

SUPPORTED = ", ".join(kind.expected for kind in READERS if kind.expected)


@dataclass(frozen=True)
class Log:
    """A log file as it is, before any meaning: tables by topic, in the order of their names."""

    path: Path
    format: str
    size: int
    content_hash: str
    tables: dict[str, Table]
    notes: tuple[str, ...] = ()
    autopilot: Autopilot | None = None
    damage: tuple[str, ...] = ()


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


def read_log(path: Path, selection: Selection, budget: Budget | str | None = None) -> Log:
    """Read a log once: columns of the topics that `selection` wants, log times of all.

    Raises LogError: no such file, no log, no message in it, or no access; BudgetError where it takes more than the
    `budget`.
    """
    try:
        return _read_log(path, selection, budget)
    except OSError as error:  # also of what took the log's place after it was looked at
        raise LogError(f"{path}: cannot be read: {error.strerror or error}") from None


def _read_log(path: Path, selection: Selection, budget: Budget | str | None) -> Log:
    reader = reader_of(path)
    files = reader.data_files()
    before = [file.stat() for file in files]
    size = sum(file.st_size for file in before)
    reader.account = Budget.of(budget).account(path, size)
    tables, notes = _tables(reader, selection)
    if not tables:
        told = " ".join(reader.damage + reader.notes)
        detail = f" ({told})" if told else ""
        raise LogError(f"{path}: the {reader.name} holds no message{detail}")
    autopilot: Autopilot | None = getattr(reader, "autopilot", None)
    for derived in (px4.derived, ardupilot.derived):
        made, said = derived(tables, {} if autopilot is None else autopilot.parameters)
        tables, notes = tables | made, notes + said
    tables = dict(sorted(tables.items()))
    give_back(max(map(len, tables.values())))
    if (after := sum(_grown(*pair).st_size for pair in zip(files, before, strict=True))) != size:
        notes.append(f"{path.name} grew from {size} to {after} bytes while it was read: its end is missing here.")
    return Log(
        path, reader.name, size, _hash(files), tables, tuple(reader.notes + notes), autopilot, tuple(reader.damage)
    )


def _grown(path: Path, before: os.stat_result) -> os.stat_result:
    """A file that was read, as it is now. Raises LogError where another one has its name, or it is shorter or gone."""
    with suppress(OSError):
        after = path.stat()
        if (after.st_dev, after.st_ino) == (before.st_dev, before.st_ino) and after.st_size >= before.st_size:
            return after
    raise LogError(f"{path}: {REPLACED}")


def _tables(reader: Reader, selection: Selection) -> tuple[dict[str, Table], list[str]]:
    """What a reader gives, decoded, and what the decoding has to say."""
    if isinstance(reader, TableReader):
        with np.errstate(over="ignore", invalid="ignore"):  # numbers without sense are left out later, and counted
            return reader.tables(selection), []
    collector = Collector(
        lambda topic, kind, fields: selection(topic, kind, fields) or px4.wanted(topic, kind), reader.account
    )
    try:
        for batch in reader.batches(collector.wanted):
            collector.add(batch)
    except DoubtfulError:
        reader.careful, reader.account.taken = True, 0.0
        reader.notes.clear()
        reader.damage.clear()
        return _tables(reader, selection)
    return collector.tables(), collector.notes


def _hash(files: list[Path]) -> str:
    digest = hashlib.sha256()
    for path in files:
        with path.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


ROS = ("cdr", "ros1")
OTHERS = ("json", "protobuf")
STAMPS = (
    ("header.stamp.sec", "header.stamp.nanosec"),
    ("header.stamp.sec", "header.stamp.nsec"),
    ("timestamp.sec", "timestamp.nsec"),
    ("timestamp.seconds", "timestamp.nanos"),
)
"""Where a message has the time at which it was made: of ROS, and of Foxglove's schemas in JSON and protobuf."""
LATEST_SECOND = 9e9
"""Since 1970, in the year 2255: nanoseconds of 64 bits end soon after. What is said to be later is no time."""


@dataclass
class Collector:
    """Decodes batches as they come. A topic's first channel decides its type.

    Two channels of a topic whose definitions of the type differ are each read by their own: files of a recording may
    have been written before and after a message changed.
    """

    selection: Selection
    account: Account
    times: dict[str, list[NDArray[np.int64]]] = field(default_factory=dict)
    channels: dict[str, Channel] = field(default_factory=dict)
    decoders: dict[Channel, Decoder | Encoded | None] = field(default_factory=dict)
    definitions: dict[Channel, Definitions] = field(default_factory=dict)
    problems: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def wanted(self, channel: Channel) -> bool:
        """Whether the payloads of a channel are worth reading."""
        if channel not in self.decoders:
            self.decoders[channel] = self._decoder(channel)
        return self.decoders[channel] is not None

    def _decoder(self, channel: Channel) -> Decoder | Encoded | None:
        first = self.channels.setdefault(channel.topic, channel)
        if (channel.type, channel.encoding) != (first.type, first.encoding):
            self.notes.append(f"{channel.topic} carries {first.type} and also {channel.type}: the latter is left out.")
            return None
        if first is not channel and self.decoders.get(first) is not None:
            return self._shared(first, channel)
        if channel.encoding not in (*ROS, *OTHERS):
            self.problems[channel.topic] = (
                f"its messages are encoded as {channel.encoding!r}, expected cdr, ros1, json or protobuf"
            )
            return None
        decoder: Decoder | Encoded
        try:
            if channel.encoding in OTHERS:
                decoder = encoded(channel, self.account)
                fields, unknown = decoder.fields, channel.encoding != "json"  # JSON may come without a schema
            else:
                definitions = definitions_of(channel)
                fields, unknown = flat_fields(channel.type, definitions), False
                decoder = Decoder(channel, definitions, self.account)
        except (UndecodableError, KeyError) as error:
            self.problems[channel.topic] = str(error)
            return None
        chosen = self.selection(channel.topic, channel.type, fields) if fields else not unknown
        return decoder if chosen else None

    def _shared(self, first: Channel, channel: Channel) -> Decoder | Encoded | None:
        """The decoder of another writer of the topic, which may know the type by another definition."""
        decoder = self.decoders[first]
        if channel.definition == first.definition or not isinstance(decoder, Decoder):
            return decoder
        try:
            self.definitions[channel] = definitions_of(channel)
        except UndecodableError as error:
            self.notes.append(f"{channel.topic}: another writer's messages are left out: {error}.")
            return None
        if self.definitions[channel].get(channel.type) != decoder.definitions.get(channel.type):
            note = f"{channel.topic}: two definitions of {channel.type} in this log; each message is read by its own."
            if note not in self.notes:
                self.notes.append(note)
        return decoder

    def add(self, batch: Batch) -> None:
        """Take some messages in."""
        channel = batch.channel
        first = self.channels[channel.topic]
        decoder = self.decoders[channel]
        if channel.type != first.type or (decoder is None and self.decoders.get(first) is not None):
            return
        self.account.take(LIMITS.log_times + 8 * len(batch.log_time_ns), "log times")
        self.account.check_time()
        self.times.setdefault(channel.topic, []).append(np.array(batch.log_time_ns, dtype=np.int64))
        if isinstance(decoder, Decoder):
            decoder.add(batch.payloads, self.definitions.get(channel))
        elif decoder is not None:
            payloads = batch.payloads
            decoder.add(payloads.payloads() if isinstance(payloads, Places) else payloads)

    def tables(self) -> dict[str, Table]:
        """All topics, in the order of their names."""
        return {topic: self._table(topic) for topic in sorted(self.times)}

    def _table(self, topic: str) -> Table:
        channel = self.channels[topic]
        log_time_ns = np.concatenate(self.times[topic])
        in_order = bool(np.all(log_time_ns[1:] >= log_time_ns[:-1]))  # then hours of log need no copy
        order: Any = slice(None) if in_order else np.argsort(log_time_ns, kind="stable")
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
    numbers = {name for name, values in columns.items() if values.ndim == 1 and values.dtype.kind in "iuf"}
    place = next((names for names in STAMPS if numbers.issuperset(names)), None)
    if place is None:
        return None
    seconds, nanoseconds = (columns[name] for name in place)
    known = (np.abs(seconds) < LATEST_SECOND) & (np.abs(nanoseconds) < 1e9 * LATEST_SECOND)  # NaN: malformed messages
    seconds, nanoseconds = np.where(known, seconds, 0), np.where(known, nanoseconds, 0)
    stamps = seconds.astype(np.int64) * 1_000_000_000 + nanoseconds.astype(np.int64)
    return stamps if np.any(stamps) else None
