"""Folders: a recording that was split into files, or several flights.

Files of one recording follow one another in time; flights do not. A folder with a metadata.yaml is what that says.
"""

import re
import sqlite3
import struct
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from wrenchgap.flight.budget import LIMITS, Account, Budget
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats.mcap import time_range

STORAGE = (".db3", ".mcap")
SINGLE = (".bag", ".ulg", ".bin", ".csv", ".parquet")
"""Endings of logs that are always one file."""
TABLES = ("messages", "topics", "message_definitions")
"""Of a ROS 2 bag in SQLite; older ones have no definitions."""

Range = tuple[int, int]


def storage(path: Path) -> str | None:
    """The ending of a file of a ROS 2 bag, compressed or not; None for other files."""
    ending = Path(path.name.removesuffix(".zstd")).suffix
    return ending if ending in STORAGE else None


def natural(path: Path) -> list[tuple[int, str]]:
    """Sorts bag_10.db3 after bag_9.db3."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path.name)]


def recordings(folder: Path, joined: float = 5.0, overlap: float = 1.0) -> list[list[Path]]:
    """The bag files of a folder, by recording, in the order of their times; where one tells none, of their names.

    The next file of a recording follows within `joined` [s], or begins up to `overlap` [s] before the last one ends.
    """
    files = sorted((p for p in folder.iterdir() if p.is_file() and storage(p)), key=natural)
    if len(files) < 2:
        return [files] if files else []
    known = [(path, span) for path in files if (span := _time_range(path)) is not None]
    if len(known) < len(files):
        same = len({re.sub(r"(_\d+)?\..*$", "", p.name) for p in files}) == 1
        return [files] if same else [[path] for path in files]
    known.sort(key=lambda entry: entry[1])
    groups = [[known[0][0]]]
    for (_, last), (path, now) in pairwise(known):
        pause = (now[0] - last[1]) * 1e-9
        if now[0] > last[0] and -overlap <= pause <= joined:
            groups[-1].append(path)
        else:
            groups.append([path])
    return groups


def flights_in(path: Path) -> list[Path]:
    """The logs that a name stands for: itself, or the flights of a folder that is no bag.

    Raises LogError where recordings of several files share a folder: one name could not tell them apart.
    """
    if not path.is_dir() or (path / "metadata.yaml").is_file():
        return [path]
    groups = recordings(path)
    others = [p for p in path.iterdir() if p.is_file() and p.suffix.lower() in SINGLE]
    bags = [p for p in path.iterdir() if p.is_dir() and (p / "metadata.yaml").is_file()]
    if len(groups) + len(others) + len(bags) < 2 and not others and not bags:
        return [path]
    split = next((group for group in groups if len(group) > 1), None)
    if split is not None:
        raise LogError(
            f"{path}: {_listed(split)} are one recording, but not alone in the folder; move each recording to a folder "
            "of its own"
        )
    return sorted([*(group[0] for group in groups), *others, *bags], key=natural)


def only_recording(folder: Path) -> list[Path]:
    """The files of a folder that holds one recording; raises LogError for none or several."""
    groups = recordings(folder)
    if not groups:
        raise LogError(f"{folder}: the folder holds no .db3 or .mcap file; expected a ROS 2 bag folder or a file")
    if len(groups) > 1:
        raise LogError(
            f"{folder}: a folder with {len(groups)} logs whose times do not follow one another and no metadata.yaml; "
            f"name one of its files: {_listed([group[0] for group in groups])}"
        )
    return groups[0]


def _listed(paths: Sequence[Path], most: int = 4) -> str:
    return ", ".join(p.name for p in paths[:most]) + (", ..." if len(paths) > most else "")


def bag_database(path: Path, account: Account) -> sqlite3.Connection:
    """The SQLite file of a bag, read only, whose queries end where the account's time does.

    Raises sqlite3.DatabaseError where its tables are none: a view may have no end, and a computed column is not in the
    file, so that its size says nothing.
    """
    database = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    try:
        database.setlimit(
            sqlite3.SQLITE_LIMIT_LENGTH, int(min(account.memory / LIMITS.sqlite_copies, LIMITS.sqlite_message))
        )
        database.set_progress_handler(lambda: account.over_time, LIMITS.sqlite_steps)
        database.text_factory = lambda text: text.decode(errors="replace")
        kinds = dict(database.execute(f"SELECT name, type FROM sqlite_master WHERE name IN {TABLES}"))
        if not {"messages", "topics"} <= kinds.keys() or set(kinds.values()) != {"table"}:
            raise sqlite3.DatabaseError("no tables messages and topics")
        for name in kinds:
            if any(hidden for *_, hidden in database.execute(f"PRAGMA table_xinfo({name})")):
                raise sqlite3.DatabaseError(f"columns of {name} are computed")
    except BaseException:
        database.close()
        raise
    return database


def _time_range(path: Path) -> Range | None:
    """First and last log time [ns] of a bag file, where it tells them without being read whole."""
    try:
        if path.suffix == ".mcap":
            with path.open("rb") as file:
                return time_range(file, Budget().account(path, path.stat().st_size))
        if path.suffix == ".db3":
            database = bag_database(path, Budget().account(path, path.stat().st_size))
            try:
                first, last = database.execute("SELECT MIN(timestamp), MAX(timestamp) FROM messages").fetchone()
            finally:
                database.close()
            return None if first is None else (int(first), int(last))
    except (OSError, struct.error, sqlite3.DatabaseError):
        return None
    return None
