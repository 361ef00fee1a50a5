"""Log formats: one file each, one table, one function that reads any of them into columns."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from wrenchgap.flight.budget import Budget
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats import ardupilot, px4
from wrenchgap.flight.formats.collector import Collector
from wrenchgap.flight.formats.dataflash import DataflashReader
from wrenchgap.flight.formats.mcap import McapReader
from wrenchgap.flight.formats.reader import DoubtfulError, Reader, TableReader
from wrenchgap.flight.formats.rosbag1 import Rosbag1Reader
from wrenchgap.flight.formats.rosbag2 import Rosbag2FolderReader, Rosbag2SqliteReader
from wrenchgap.flight.formats.table import Selection as Selection
from wrenchgap.flight.formats.table import Table as Table
from wrenchgap.flight.formats.table import give_away as give_away
from wrenchgap.flight.formats.tabular import CsvReader, ParquetReader
from wrenchgap.flight.formats.ulog import UlogReader
from wrenchgap.flight.memory import give_back

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

    Raises LogError: no such file, no log, or no message in it; BudgetError where it takes more than the `budget`.
    """
    reader = reader_of(path)
    files = reader.data_files()
    before = _sizes(files)
    reader.account = Budget.of(budget).account(path, before)
    tables, notes = _tables(reader, selection)
    if not tables:
        detail = f" ({' '.join(reader.notes)})" if reader.notes else ""
        raise LogError(f"{path}: the {reader.name} holds no message{detail}")
    for derived in (px4.derived, ardupilot.derived):
        made, said = derived(tables, getattr(reader, "parameters", {}))
        tables, notes = tables | made, notes + said
    tables = dict(sorted(tables.items()))
    give_back(max(map(len, tables.values())))
    if (after := _sizes(files)) != before:
        notes.append(f"{path.name} grew from {before} to {after} bytes while it was read: its end is missing here.")
    size = before
    return Log(path, reader.name, size, _hash(files), tables, tuple(reader.notes + notes))


def _tables(reader: Reader, selection: Selection) -> tuple[dict[str, Table], list[str]]:
    """What a reader gives, decoded, and what the decoding has to say."""
    if isinstance(reader, TableReader):
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
        return _tables(reader, selection)
    return collector.tables(), collector.notes


def _sizes(files: list[Path]) -> int:
    """Of all files [bytes]."""
    return sum(file.stat().st_size for file in files)


def _hash(files: list[Path]) -> str:
    digest = hashlib.sha256()
    for path in files:
        with path.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()
