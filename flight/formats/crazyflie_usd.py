"""Binary logs of the Crazyflie's uSD deck, as the firmware's own decoder reads them (its tools/usdlog/cfusdlog.py).

    0xBC, version u16, number of events u16
    of each event: id u16, name, number of variables u16, and of each variable its name with its type, "gyro.x(f)"
    records: id u16, time (version 1: u32 in ms, version 2: u64 in us), the variables without padding
    CRC-32 of all before it

Texts end with a zero byte, numbers are little-endian, types are letters of Python's `struct`. Variables are the
firmware's log variables, so that an event is a table with their names (`flight.formats.named_columns`).
"""

import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.budget import LIMITS
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats.named_columns import tables_of_columns
from wrenchgap.flight.formats.reader import Columns, Selection, Table, TableReader, in_order

TIMES = {1: ("<I", 1_000_000), 2: ("<Q", 1_000)}
"""Of each version: the type of a time, and its unit [ns]."""
LETTERS = "bBhHiIqQefd"
"""Types of variables, which numpy calls as `struct` does."""
START = 5
"""Bytes before the first event."""


@dataclass(frozen=True)
class Event:
    """One kind of record: its name, its fields f0 (id), f1 (time), f2 ..., and the variables from f2 on."""

    name: str
    layout: np.dtype[np.void]
    variables: tuple[str, ...]


@dataclass
class CrazyflieUsdReader(TableReader):
    """Reads one log; what stands behind damage is left out and counted."""

    name: ClassVar[str] = "Crazyflie uSD log"
    expected: ClassVar[str] = "log of the Crazyflie's uSD deck"
    magic: ClassVar[bytes] = b"\xbc"

    @classmethod
    def accepts(cls, path: Path, head: bytes) -> bool:
        """By the first byte and a known version."""
        return head[:1] == cls.magic and int.from_bytes(head[1:3], "little") in TIMES

    def tables(self, selection: Selection) -> dict[str, Table]:
        """A table of each event, and the topics that its variables make."""
        self.account.take(self.path.stat().st_size, "the file")
        data = self.path.read_bytes()
        sound = len(data) > START + 4 and zlib.crc32(memoryview(data)[:-4]) == int.from_bytes(data[-4:], "little")
        if not sound:
            self.damage.append(
                f"{self.path.name}: its checksum is wrong: cut short or damaged. Read as far as it goes."
            )
        events, start = self._events(data)
        places, stop = self._places(data, start, len(data) - 4 * sound, events)
        if (rest := len(data) - 4 * sound - stop) > 0:
            self.notes.append(f"{rest:,} bytes at the end of {self.path.name} belong to no whole record: left out.")
        found: dict[str, Table] = {}
        for number in sorted(places, key=lambda one: -len(places[one])):  # the fastest event makes a topic
            if places[number]:
                found = self._tables(data, events[number], places[number]) | found
        return found

    def _events(self, data: bytes) -> tuple[dict[int, Event], int]:
        """The events by their ids, and where the records begin; raises LogError for a header that is none."""
        version = int.from_bytes(data[1:3], "little")
        at, found, names = START, dict[int, Event](), set[str]()
        try:
            for _ in range(int.from_bytes(data[3:START], "little")):
                number = int.from_bytes(data[at : at + 2], "little")
                name, at = self._text(data, at + 2)
                if number in found or name in names:
                    raise ValueError(f"event {name[:80]!r}, which is there twice,")
                names.add(name)
                count, at = int.from_bytes(data[at : at + 2], "little"), at + 2
                self.account.take(LIMITS.table_column * (count + 1), f"an event of {count:,} variables")
                variables: dict[str, str] = {}
                for _ in range(count):
                    self.account.check_time()
                    text, at = self._text(data, at)
                    spelt = re.fullmatch(r"(.+)\((\w)\)", text)
                    if spelt is None or spelt[2] not in LETTERS or spelt[1] in variables:
                        raise ValueError(f"variable {text[:80]!r} of event {name[:80]!r}")
                    variables[spelt[1]] = f"<{spelt[2]}"
                kinds = enumerate(("<H", TIMES[version][0], *variables.values()))
                layout = np.dtype([(f"f{k}", kind) for k, kind in kinds])  # a variable may have any name
                found[number] = Event(name, layout, tuple(variables))
        except ValueError as error:
            raise LogError(f"{self.path}: not a readable {self.name}: {error} is damaged") from error
        return found, at

    def _text(self, data: bytes, start: int) -> tuple[str, int]:
        """A text, and where it ends."""
        stop = data.find(b"\0", start, start + 4 * LIMITS.header_letters)
        if stop < 0:
            raise ValueError(f"a name at byte {start:,}")
        return data[start:stop].decode("utf-8", errors="replace"), stop + 1

    def _places(self, data: bytes, at: int, end: int, events: dict[int, Event]) -> tuple[dict[int, list[int]], int]:
        """Where the records of each event are, and the end of the last whole one before `end`."""
        sizes = {number: event.layout.itemsize for number, event in events.items()}
        smallest = min(sizes.values(), default=1)
        self.account.take(LIMITS.dataflash_place * (end - at) / smallest, "the places of records")
        places: dict[int, list[int]] = {number: [] for number in events}
        while at + 2 <= end:
            number = data[at] + 256 * data[at + 1]
            size = sizes.get(number, 0)
            if not size or at + size > end:
                break
            places[number].append(at)
            at += size
            if not at % 4096:
                self.account.check_time()
        return places, at

    def _tables(self, data: bytes, event: Event, places: list[int]) -> dict[str, Table]:
        """The table of an event, and what is made of it."""
        width = event.layout.itemsize
        self.account.take((2 * width + LIMITS.table_cell * (len(event.variables) + 1)) * len(places), "the records")
        starts = np.array(places, dtype=np.int64)
        rows = np.empty((len(starts), width), dtype=np.uint8)
        raw = np.frombuffer(data, dtype=np.uint8)
        for first in range(0, len(starts), LIMITS.dataflash_block):
            self.account.check_time()
            some = slice(first, first + LIMITS.dataflash_block)
            rows[some] = raw[starts[some, None] + np.arange(width)]
        fields = rows.view(event.layout)[:, 0]
        unit = TIMES[int.from_bytes(data[1:3], "little")][1]
        known = fields["f1"] <= np.uint64(2**63 // unit - 1)
        stamps: NDArray[np.int64] = fields["f1"][known].astype(np.int64) * unit
        if lost := int((~known).sum()):
            self.notes.append(
                f"{lost} of {len(known)} records of {event.name} have times that no clock shows: left out."
            )
        if not len(stamps):
            return {}
        order = in_order(stamps, event.name, self.notes)
        columns: Columns = {
            name: fields[f"f{k}"][known][order].astype(float) for k, name in enumerate(event.variables, 2)
        }
        made, notes = tables_of_columns(f"/{event.name or 'event'}", columns, stamps[order], self.path)
        self.notes += notes
        return made
