"""ArduPilot's onboard logs (`.bin`, "dataflash"; https://ardupilot.org/copter/docs/logmessages.html).

A message is a mark of two bytes, its type and its fields; messages of the type FMT say how each type is laid out. The
columns are cut from the bytes for all messages of a type at once. Every message is a table under ArduPilot's own name
(`IMU`, further instances as `IMU/1`), in its frames and units; what plays a role is made of them by
`flight.formats.ardupilot`.
"""

import re
import struct
from array import array
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.autopilot import Autopilot, ParameterChange, changes_of
from wrenchgap.flight.budget import LIMITS, Account, Budget
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import Array
from wrenchgap.flight.formats.reader import Columns, Selection, Table, TableReader, in_order, readable

MARK = b"\xa3\x95"
HEADER = 3
"""Bytes before a message: two of a mark, one of the type."""
_PRIMITIVES = """
    b:i1 B:u1 h:<i2 H:<u2 i:<i4 I:<u4 q:<i8 Q:<u8 g:<f2 f:<f4 d:<f8 M:i1
    c:<i2 C:<u2 e:<i4 E:<u4 L:<i4 n:S4 N:S16 Z:S64 a:(32,)<i2
"""
CODES = dict(entry.split(":") for entry in _PRIMITIVES.split())
"""The primitive of each letter of a format."""
FACTORS = {"c": 0.01, "C": 0.01, "e": 0.01, "E": 0.01, "L": 1e-7}
"""Factors that a letter implies."""
INSTANCES = ("I", "Instance", "Inst", "C")
"""Columns that number instances, for logs that do not say which does; `C` is an estimator's core."""
NUMBERED = frozenset({"IMU", "ACC", "GYR", "ESC", "BAT", "XKQ", "XKF1", "NKQ", "NKF1"})


@dataclass
class DataflashReader(TableReader):
    """Reads one dataflash log. `autopilot` is known once the tables are."""

    name: ClassVar[str] = "ArduPilot dataflash"
    expected: ClassVar[str] = "ArduPilot dataflash (.bin)"
    magic: ClassVar[bytes] = MARK + b"\x80"

    autopilot: Autopilot | None = None

    def tables(self, selection: Selection) -> dict[str, Table]:
        """All messages that have a time, by topic; raises LogError where nothing can be read."""
        raw, strange = _messages(self.path, self.account)
        if strange:
            self.notes.append(f"{strange} bytes of {self.path.name} belong to no whole message: left out.")
        found = {table.topic: table for name, columns in raw.items() for table in _instances(name, columns, self.notes)}
        dropped = _most(raw.get("DSF", {}).get("Dp"))
        if dropped > 0:
            self.notes.append(f"The logger dropped {dropped} blocks of messages.")
        self.autopilot = _autopilot(raw, dropped)
        return found


def parameters(path: str | Path, budget: Budget | str | None = None) -> dict[str, float | int]:
    """The autopilot's parameters as last logged, by name. Raises LogError where the file is no dataflash log."""
    with Path(path).open("rb") as file:
        if not file.read(3) == DataflashReader.magic:
            raise LogError(f"{path}: not an ArduPilot dataflash log (.bin); parameters are read from those")
    account = Budget.of(budget).account(Path(path), Path(path).stat().st_size)
    return _parameters(_messages(Path(path), account, only="PARM")[0].get("PARM", {}))


def _parameters(columns: Columns) -> dict[str, float | int]:
    names, values = columns.get("Name"), columns.get("Value")
    if names is None or values is None or kind_of(names) != "S" or kind_of(values) not in "iuf":
        return {}
    pairs = zip(names.tolist(), values.tolist(), strict=True)
    return {name.decode(errors="replace"): int(v) if v == int(v) else v for name, v in pairs if np.isfinite(v)}


def _changes(columns: Columns) -> tuple[ParameterChange, ...]:
    """Parameters that are logged again with another value."""
    times = columns.get("TimeUS")
    if not _parameters(columns) or times is None or kind_of(times) not in "iuf":
        return ()
    names = (name.decode(errors="replace") for name in columns["Name"].tolist())
    stamps = (1000 * int(time) for time in times.tolist())
    return changes_of(zip(stamps, names, columns["Value"].tolist(), strict=True), {})


def kind_of(values: Array) -> str:
    """The kind of a column's type, "i", "u", "f" or "S"; "array" where every message has several numbers, as the letter
    "a" of a format says, which are no time, no instance and no parameter.
    """  # noqa: D205
    return values.dtype.kind if values.ndim == 1 else "array"


def _most(values: Array | None) -> int:
    """The largest of these counts (N,); 0 of what a damaged log has in their place."""
    if values is None or kind_of(values) not in "iuf":
        return 0
    return int(np.max(values[np.isfinite(values)], initial=0))


def _autopilot(raw: Mapping[str, Columns], dropped: int) -> Autopilot:
    """Of the texts that the firmware logs at its start: its version, the board, the frame."""
    texts = raw.get("MSG", {}).get("Message", np.zeros(0, "S1"))
    said = [text.decode(errors="replace").strip() for text in texts.tolist()] if kind_of(texts) == "S" else []
    firmware = next((text for text in said if re.match(r"(Ardu|APM:)\w* .*\d", text)), "")
    frame = next((text.partition(":")[2].strip() for text in said if text.startswith("Frame:")), "")
    board = next((text for text in said if re.search(r" [0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8}$", text)), "")
    hardware, _, serial = board.partition(" ")
    rows = raw.get("PARM", {})
    parameters, changes = _parameters(rows), _changes(rows)
    return Autopilot("ArduPilot", firmware, hardware, frame, parameters, dropped, serial=serial, changes=changes)


@dataclass(frozen=True)
class Layout:
    """A type of message as its FMT has it: its length in bytes, with the header, a letter and a name for each field."""

    name: str
    length: int
    letters: str
    names: tuple[str, ...]


FORMATS = Layout("FMT", 89, "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))
KNOWN = {128: FORMATS}
"""The type of message that no message has to say."""


def _messages(path: Path, account: Account, only: str | None = None) -> tuple[dict[str, Columns], int]:
    """Columns of every type of message, by its name; how many bytes are of no message."""
    with readable(path, "dataflash log"), path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as raw:
        layouts, places = _index(raw, account)
    data = np.memmap(path, dtype=np.uint8, mode="r")
    out, strange = {}, len(data)
    for kind, layout in layouts.items():
        account.check_time()
        at = np.array(places[kind], dtype=np.int64)
        at = at[at + layout.length <= len(data)]  # a damaged FMT may say another length later
        strange -= len(at) * layout.length
        if len(at) and layout.name not in ("FMT", "UNIT", "MULT") and only in (None, layout.name):
            account.take(2 * len(at) * layout.length, f"messages of {layout.name:.20}")
            out[layout.name] = _columns(data, at, layout)
    for kind, column in _instance_columns(out.pop("FMTU", {})):
        layout = layouts.get(kind, FORMATS)
        if column < len(layout.names) and layout.names[column] in out.get(layout.name, {}):
            out[layout.name]["#"] = out[layout.name][layout.names[column]]
    return {name: columns for name, columns in out.items() if columns}, max(strange, 0)


def _index(raw: mmap, account: Account) -> tuple[dict[int, Layout], "dict[int, array[int]]"]:
    """The layout of every type, and where its messages are.

    A message counts where its type is known and another mark, or the end of the file, follows it: damaged bytes cost
    the message that they are in, and no other.
    """
    layouts, places = dict(KNOWN), defaultdict[int, "array[int]"](lambda: array("q"))
    at, size, count = raw.find(MARK), len(raw), 0
    while 0 <= at <= size - HEADER:
        if count % LIMITS.dataflash_block == 0:
            account.check_time()
            account.take(LIMITS.dataflash_place * min(LIMITS.dataflash_block, size - at), "the places of messages")
        count += 1
        layout = layouts.get(raw[at + 2])
        end = size + 1 if layout is None else at + layout.length
        following = raw.find(MARK, end)
        if layout is None or end > size or following > end:
            at = raw.find(MARK, at + 1)
            continue
        places[raw[at + 2]].append(at)
        told = _layout(raw[at + HEADER : end]) if layout is FORMATS else None
        if told is not None and raw[at + HEADER] not in KNOWN:
            layouts[raw[at + HEADER]] = told
        at = following
    return layouts, places


def _layout(body: bytes) -> Layout | None:
    """What a message FMT says; None where that is no layout."""
    _, length, name, letters, names = struct.unpack("<BB4s16s64s", body)
    words = [text.partition(b"\0")[0].decode(errors="replace") for text in (name, letters, names)]
    return Layout(words[0], length, words[1], tuple(words[2].split(","))) if length >= HEADER else None


def _instance_columns(units: Columns) -> Iterator[tuple[int, int]]:
    """Types of messages that are numbered, with the number of the column that does it: its unit is "#"."""
    kinds = "".join(kind_of(units[name]) for name in ("FmtType", "UnitIds") if name in units)
    if kinds in ("uS", "iS"):
        for kind, letters in zip(units["FmtType"].tolist(), units["UnitIds"].tolist(), strict=True):
            if b"#" in letters:
                yield int(kind), letters.index(b"#")


def _columns(data: NDArray[np.uint8], places: NDArray[np.int64], layout: Layout) -> Columns:
    """The fields of N messages; none where names and format, or format and length, contradict each other."""
    names, letters = layout.names, [letter for letter in layout.letters if letter in CODES]
    if len(set(names)) < len(names) or not all(names) or len(letters) != len(names) or not letters:
        return {}
    dtype = np.dtype([(name, CODES[letter]) for name, letter in zip(names, letters, strict=True)])
    if dtype.itemsize != layout.length - HEADER:
        return {}
    rows = np.empty((len(places), dtype.itemsize), dtype=np.uint8)
    for first in range(0, len(places), LIMITS.dataflash_block):
        some = slice(first, first + LIMITS.dataflash_block)
        rows[some] = data[places[some, None] + np.arange(HEADER, layout.length)]
    fields = rows.view(dtype)[:, 0]
    found: Columns = {name: fields[name] for name in names}
    factors = {name: FACTORS[code] for name, code in zip(names, letters, strict=True) if code in FACTORS}
    return found | {name: fields[name] * factor for name, factor in factors.items()}


def _instances(name: str, columns: Columns, notes: list[str]) -> Iterator[Table]:
    """A table for each instance, in the order of the stamps; none for messages without a time.

    Nor for more than `LIMITS.dataflash_instances`, of which the notes are told.
    """
    clock, unit = next(((c, u) for c, u in (("TimeUS", 1000), ("TimeMS", 1_000_000)) if c in columns), ("", 0))
    if not unit or kind_of(columns[clock]) not in "iu":
        return
    column = "#" if "#" in columns else next((c for c in INSTANCES if name in NUMBERED and c in columns), None)
    number = np.zeros(len(columns[clock]), dtype=int) if column is None else columns[column]
    if kind_of(number) not in "iu":  # instances that are named, as of NVF, stay together
        number = np.zeros(len(number), dtype=int)
    known = columns[clock] <= 2**63 // unit - 1
    instances = np.unique(number[known]).tolist()
    if len(instances) > LIMITS.dataflash_instances:
        notes.append(
            f"{name} numbers {len(instances):,} instances, and no vehicle has {LIMITS.dataflash_instances}: left out."
        )
        return
    for instance in instances:
        rows = np.flatnonzero(known & (number == instance))
        stamps = columns[clock][rows].astype(np.int64) * unit
        topic = f"{name}/{instance}" if instance else name
        order = in_order(stamps, topic, notes)
        kept = {key: values[rows[order]] for key, values in columns.items() if key != "#"}
        yield Table(topic, f"ardupilot/{name}", stamps[order], stamps[order], kept)
