"""ROS 2 bags: a folder of SQLite or MCAP files, or one `.db3` file by itself.

`metadata.yaml` is only asked which files belong to the bag: everything else is in the files themselves. Messages
and files that were compressed by `ros2 bag record --compression-mode` are read as well.
"""

import sqlite3
import tempfile
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import zstandard

from wrenchgap._escaping import file_word
from wrenchgap.flight import work_files
from wrenchgap.flight.budget import LIMITS, Account, BudgetError, in_bytes
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats.folders import bag_database, natural, only_recording, storage
from wrenchgap.flight.formats.kernels import grouped
from wrenchgap.flight.formats.mcap import McapReader
from wrenchgap.flight.formats.reader import (
    ZSTD_MAGIC,
    Batch,
    Channel,
    Gatherer,
    Places,
    Reader,
    Wanted,
    decompressed,
    normalised_type,
    one_line,
)

PIECE = 2**16
"""Bytes that are decompressed at once."""
LONGEST_METADATA = 2**24
"""Bytes of a metadata.yaml that are read: a thousand topics are 1 MB."""
Row = tuple[Any, Any, Any]


@dataclass
class Rosbag2SqliteReader(Reader):
    """Reads one SQLite file of a ROS 2 bag."""

    name: ClassVar[str] = "ROS 2 bag file (sqlite3)"
    expected: ClassVar[str] = "ROS 2 bag (folder or .db3)"
    magic: ClassVar[bytes] = b"SQLite format 3\x00"

    _broken: int = 0

    def batches(self, wanted: Wanted) -> Iterator[Batch]:
        """Go through the table of messages as it was written."""
        gathered = Gatherer(self.account)
        try:
            database = bag_database(self.path, self.account)
            try:
                channels, self._broken = _channels(database, self.account)
                rows = database.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id")
                for several in _several(rows):
                    self.account.check_time()
                    yield from self._taken(several, channels, wanted, gathered)
                ((sound,),) = database.execute("PRAGMA quick_check(1)")
                if sound != "ok":  # pages out of order: rows are silently lost
                    raise sqlite3.DatabaseError(sound.partition("***\n")[2] or sound)
            finally:
                database.close()
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
            self.account.check_time()  # which interrupts a query
            if getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_TOOBIG:
                limit = in_bytes(self.account.memory / LIMITS.sqlite_copies)
                self.account.ask(2 * self.account.memory, f"a message of more than {limit}, copied as it is read,")
            if not gathered.total:
                raise LogError(
                    f"{self.path}: not a readable ROS 2 bag ({one_line(error)}); expected an SQLite file with the "
                    "tables topics and messages"
                ) from error
            self.damage.append(f"{self.path.name} is damaged ({one_line(error)}): read as far as it goes.")
        recent = self.path.with_name(f"{self.path.name}-wal")
        if recent.is_file() and recent.stat().st_size:
            self.notes.append(
                f"{recent.name} holds rows that the recorder, which still writes or was killed, had not moved to "
                f"{self.path.name}: they are missing here; `sqlite3 {file_word(self.path)} "
                "'PRAGMA wal_checkpoint'` moves them."
            )
        if self._broken:
            self.damage.append(
                f"{self._broken} row(s) of {self.path.name} are damaged or belong to no topic: left out."
            )
        yield from gathered.flush()

    def _taken(
        self, rows: list[Row], channels: dict[int, Channel], wanted: Wanted, gathered: Gatherer
    ) -> Iterator[Batch]:
        """Rows by channel, side by side; those among which one is odd or may be compressed one by one."""
        identifiers, times, payloads = zip(*rows, strict=True)
        places = np.empty((4, len(rows)), dtype=np.int64)
        try:  # arrays of integers, and join, take nothing else
            places[0], places[1], data = array("q", identifiers), array("q", times), b"".join(payloads)
        except TypeError:
            plain = False
        else:
            places[3] = np.fromiter(map(len, payloads), np.int64, len(rows))
            places[2] = np.cumsum(places[3]) - places[3]
            plain = not np.any(np.frombuffer(data, dtype=np.uint8)[places[2, places[3] > 0]] == ZSTD_MAGIC[0])
        if not plain:
            for row in rows:
                yield from self._one(*row, channels, wanted, gathered)
            return
        numbers, bounds, (log_time_ns, starts, lengths) = grouped(places, len(rows))
        for number, first, stop in zip(numbers.tolist(), bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
            channel, part = channels.get(number), slice(first, stop)
            if channel is None:
                self._broken += stop - first
            else:
                found = Places(data, starts[part], lengths[part]) if wanted(channel) else None
                yield from gathered.direct(channel, log_time_ns[part], found)

    def _one(
        self, number: Any, log_time_ns: Any, payload: Any, channels: dict[int, Channel], wanted: Wanted, to: Gatherer
    ) -> Iterator[Batch]:
        channel = channels.get(number)
        if channel is None or not isinstance(log_time_ns, int) or not isinstance(payload, bytes):
            self._broken += 1
            return
        try:
            payload = decompressed(payload) if wanted(channel) else b""
        except zstandard.ZstdError:
            self._broken += 1
            return
        yield from to.add(channel, log_time_ns, payload)


def _several(rows: sqlite3.Cursor) -> Iterator[list[Row]]:
    """Rows in lists, of so many bytes; where the database is damaged those before the damage, then the error."""
    found: list[Row] = []
    size = known = 0
    fetched = 1  # as long as messages of many MB may follow
    try:
        while True:
            found.extend(islice(rows, fetched))  # keeps those before an error
            if len(found) == known:
                break
            try:
                sizes = [len(payload) for _, _, payload in found[known:]]
            except TypeError:  # one that is no message
                sizes = [LIMITS.sqlite_bytes]
            size, known = size + sum(sizes), len(found)
            fetched = min(LIMITS.sqlite_fetched, 2 * fetched, 1 + LIMITS.sqlite_bytes // max(1, *sizes))
            if size >= LIMITS.sqlite_bytes or known >= LIMITS.sqlite_rows:
                yield found
                found, size, known = [], 0, 0
    except sqlite3.DatabaseError:
        if found:
            yield found
        raise
    if found:
        yield found


@dataclass
class Rosbag2FolderReader(Reader):
    """Reads a ROS 2 bag folder with one or more files."""

    name: ClassVar[str] = "ROS 2 bag folder"

    @classmethod
    def accepts(cls, path: Path, head: bytes) -> bool:
        """Any folder; one without a bag's files is refused with a reason."""
        return path.is_dir()

    def data_files(self) -> list[Path]:
        """The bag's files in the order of their numbers; metadata.yaml's list, where there is one, is respected."""
        listed = _listed_files(self.path / "metadata.yaml")
        found = sorted((p for p in self.path.iterdir() if p.is_file() and storage(p)), key=natural)
        if listed is None or not found:
            return only_recording(self.path)
        return [p for p in found if p.name in listed or p.name.removesuffix(".zstd") in listed] or found

    def batches(self, wanted: Wanted) -> Iterator[Batch]:
        """Go through the files one after another."""
        files = self.data_files()
        listed = _listed_files(self.path / "metadata.yaml")
        if listed is None:
            self.notes.append("The folder has no metadata.yaml: its files were read without.")
        elif missing := sorted(listed - {p.name for p in files} - {p.name.removesuffix(".zstd") for p in files}):
            self.notes.append(f"metadata.yaml lists {', '.join(missing)}, which the folder does not hold.")
        unreadable: list[LogError] = []
        for path in files:
            with tempfile.TemporaryDirectory(dir=work_files.folder()) as scratch:
                plain = self._unpacked(path, Path(scratch))
                kind = McapReader if plain.suffix == ".mcap" else Rosbag2SqliteReader
                reader: Reader = kind(plain, account=self.account)
                if plain.stat().st_size == 0:
                    self.damage.append(f"{path.name} is empty.")
                    continue
                try:
                    yield from reader.batches(wanted)
                except BudgetError:
                    raise
                except LogError as error:
                    unreadable.append(LogError(str(error).replace(str(plain), str(path))))
                self.notes += reader.notes
                self.damage += reader.damage
        if unreadable and len(unreadable) == len(files):
            raise unreadable[0]
        self.damage += [f"{len(unreadable)} file(s) are left out: {error}." for error in unreadable[:1]]

    def _unpacked(self, path: Path, scratch: Path) -> Path:
        """The file itself, or its decompressed copy, as far as it goes."""
        if path.suffix != ".zstd":
            return path
        plain = scratch / path.name.removesuffix(".zstd")
        usual, written = LIMITS.disk_unfolded * path.stat().st_size, 0
        with path.open("rb") as source, plain.open("wb") as target:
            stream = zstandard.ZstdDecompressor().stream_reader(source)
            try:
                while piece := stream.read(PIECE):
                    written += target.write(piece)
                    self.account.ask(
                        written - usual, f"{path.name}, unfolded to more than {LIMITS.disk_unfolded} times its size,"
                    )
                    self.account.check_time()
            except zstandard.ZstdError as error:
                self.damage.append(f"{path.name} is damaged ({one_line(error)}): read as far as it goes.")
        return plain


def _channels(database: sqlite3.Connection, account: Account) -> tuple[dict[int, Channel], int]:
    """Channels by number, and how many rows of the topics are none."""
    definitions = {}
    if database.execute("SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'").fetchone():
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        for name, encoding, text in database.execute(query):
            account.take(LIMITS.sqlite_topic + (len(text) if isinstance(text, str | bytes) else 0), "definitions")
            definitions[name] = encoding, text
    channels, broken = {}, 0
    for identifier, *row in database.execute("SELECT id, name, type, serialization_format FROM topics"):
        if not isinstance(identifier, int) or not all(isinstance(cell, str) for cell in row):
            broken += 1
            continue
        topic, kind, encoding = row
        definition_encoding, text = definitions.get(kind, ("ros2msg", None))
        definition_format = "idl" if definition_encoding == "ros2idl" else "msg"
        text = text if isinstance(text, str) else None
        account.take(LIMITS.sqlite_topic + len(text or ""), "topics")
        channels[identifier] = Channel(topic, normalised_type(kind), encoding, text or None, definition_format)
    return channels, broken


def _listed_files(metadata: Path) -> set[str] | None:
    """Names under `relative_file_paths:` of metadata.yaml; None without that file."""
    if not metadata.is_file():
        return None
    with metadata.open("rb") as file:
        lines = file.read(LONGEST_METADATA).decode(errors="replace").splitlines()
    names, inside = set(), False
    for line in map(str.strip, lines):
        if inside and line.startswith("-"):
            names.add(Path(line[1:].strip().strip("'\"")).name)
        elif line:
            inside = line == "relative_file_paths:"
    return names
