"""Messages whose layout is the same, copied from where they lie: their numbers alone, row by row.

The first message of a topic is walked through once. Every other one of the same length, with the same counters and the
same text, has its numbers in the same places, so they are copied from the bytes that the reader decompressed. That is
asked of every message; those that differ get a layout of their own, and what is left is walked through as before.
"""

import mmap
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.budget import LIMITS, Account
from wrenchgap.flight.flight import Indices
from wrenchgap.flight.formats.kernels import copied
from wrenchgap.flight.formats.message_walk import Definitions, UndecodableError, Walk
from wrenchgap.flight.formats.reader import Columns, Places
from wrenchgap.flight.memory import empty_on_disk

NONE: Indices = np.zeros(0, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Template:
    """Where the numbers of one layout lie. `fixed`, `expected` and `ranges` are those of `kernels.copied`.

    `row` is the type of a packed row, with the numbers `numbers` by name; `constant` are columns (1, ...) of what is
    the same in every message: text, and sequences without elements. `names` are all, in the order of the definition.
    """

    expected: NDArray[np.uint8]
    fixed: NDArray[np.int64]
    ranges: NDArray[np.int64]
    row: np.dtype[Any]
    names: tuple[str, ...]
    constant: Columns

    @classmethod
    def of(
        cls, payload: bytes, kind: str, encoding: str, definitions: Definitions, account: Account | None = None
    ) -> Self | None:
        """The layout of a message; None where it does not fit its definition."""
        if len(payload) > LIMITS.layout_bytes:
            return None
        fixed: list[tuple[int, int]] = []
        order = "<"
        if encoding == "cdr":
            if len(payload) < 4 or payload[0] or payload[1] > 1:
                return None
            order, fixed = "<" if payload[1] else ">", [(0, 2)]
        expected = np.frombuffer(payload, dtype=np.uint8)
        walk = Walk(expected[None], definitions, encoding, order, account)
        try:
            walk.message("", kind)
        except (UndecodableError, RecursionError):
            return None
        places: dict[str, tuple[int, np.dtype[Any], tuple[int, ...]]] = {}
        for name, values in walk.columns.items():
            if values.dtype.kind != "S" and values.size:
                first, dtype, _ = walk.layout[name]
                places[name] = first, dtype, values.shape[1:]
        constant = {name: values for name, values in walk.columns.items() if name not in places}
        ranges, row = _packed(places)
        asked = joined_ranges((first, first, size) for first, size in [*fixed, *walk.fixed])[:, ::2]
        return cls(expected, np.ascontiguousarray(asked), ranges, row, tuple(walk.columns), constant)


def _packed(places: dict[str, tuple[int, np.dtype[Any], tuple[int, ...]]]) -> tuple[NDArray[np.int64], np.dtype[Any]]:
    """Ranges to copy, and the type of a row: numbers in their order, each aligned to its size."""
    ranges: list[tuple[int, int, int]] = []
    formats, end = [], 0
    for first, dtype, shape in places.values():
        place = -(-end // dtype.itemsize) * dtype.itemsize
        size = dtype.itemsize * int(np.prod(shape))
        end = place + size
        ranges.append((first, place, size))
        formats.append((dtype, shape) if shape else dtype)
    width = -(-max(end, 1) // 8) * 8  # in eights
    offsets = [place for _, place, _ in ranges]
    described: Any = {"names": list(places), "formats": formats, "offsets": offsets, "itemsize": width}
    return joined_ranges(ranges), np.dtype(described)


def joined_ranges(ranges: Iterable[tuple[int, int, int]]) -> NDArray[np.int64]:
    """Ranges (R, 3) of bytes: where they begin, where they go to, how many; neighbours in both as one."""
    out: list[list[int]] = []
    for first, place, size in ranges:
        if out and out[-1][0] + out[-1][2] == first and out[-1][1] + out[-1][2] == place:
            out[-1][2] += size
        elif size:
            out.append([first, place, size])
    return np.array(out, dtype=np.int64).reshape(-1, 3)


@dataclass
class Rows:
    """Packed rows of one layout, block by block, and the numbers of the messages that they are of."""

    template: Template
    blocks: list[NDArray[np.uint8]] = field(default_factory=list)
    used: int = 0  # rows of the last block
    count: int = 0
    index: list[range | Indices] = field(default_factory=list)
    account: Account = field(default_factory=lambda: Account(Path()))

    def take(self, places: Places, asked: Indices | None, first: int) -> Indices:
        """Copy those of the messages that fit, of all or of the `asked` (K,); gives the others.

        The first of all has the number `first`.
        """
        known, some = self.template, places if asked is None else places.taken(asked)
        fits = np.empty(len(some), dtype=np.bool_)
        source, done, width = np.frombuffer(places.data, dtype=np.uint8), 0, known.row.itemsize
        while done < len(some):
            if not self.blocks or self.used == len(self.blocks[-1]):
                room = min(max(64, 2 * self.count), max(64, LIMITS.packed_block // width))
                self.account.take(room * width, "messages")
                large = room * width >= LIMITS.packed_block // 2  # in pages of its own, which go back when it is let go
                block = (
                    np.frombuffer(mmap.mmap(-1, room * width), np.uint8) if large else np.empty(room * width, np.uint8)
                )
                self.blocks.append(block.reshape(room, width))
                self.used = 0
            rows = self.blocks[-1]
            part = slice(done, done + len(rows) - self.used)
            where = some.starts[part], some.lengths[part], known.fixed, known.expected, known.ranges
            added = copied(source, *where, fits[part], rows, self.used)
            self.used, self.count, done = self.used + added, self.count + added, part.stop
        if asked is None and fits.all():
            self.index.append(range(first, first + len(places)))
            return NONE
        asked = np.arange(len(places)) if asked is None else asked
        self.index.append(asked[fits] + first)
        return asked[~fits]

    def columns(self) -> Columns:
        """Columns (count, ...) of the rows; a block is given away as soon as it is in them.

        A column in which one value repeats is one value, seen `count` times.
        """
        out = {name: np.broadcast_to(v, (self.count, *v.shape[1:])) for name, v in self.template.constant.items()}
        first = self.blocks[0][:1].view(self.template.row)[0]
        for name in self.template.row.names or ():
            value = first[name].astype(first[name].dtype.newbyteorder("="))
            out[name] = np.broadcast_to(value.copy(), (self.count, *value.shape[1:]))
        del first
        self.blocks.reverse()
        start = 0
        while start < self.count:
            rows = self.blocks.pop()[: self.count - start].view(self.template.row)[:, 0]
            for name in self.template.row.names or ():
                out[name] = _filled(out[name], start, rows[name])
            start += len(rows)
        return {name: out[name] for name in self.template.names}


def _filled(column: NDArray[Any], start: int, values: NDArray[Any]) -> NDArray[Any]:
    """A column with values from `start` on, which is the same as long as one value repeats."""
    if column.strides[0] == 0 and len(column) > 1:
        if values.astype(column.dtype).tobytes() == np.repeat(column[:1], len(values), axis=0).tobytes():
            return column
        whole = empty_on_disk(column.shape, column.dtype)
        whole[:start] = column[:start]
        column = whole
    elif not column.flags.writeable:
        column = column.copy()
    column[start : start + len(values)] = values
    return column


@dataclass
class Packer:
    """Gathers packed rows of one channel, by the definitions and layouts of their messages."""

    kind: str
    encoding: str
    account: Account = field(default_factory=lambda: Account(Path()))
    found: dict[int, list[Rows]] = field(default_factory=dict)
    tried: Counter[int] = field(default_factory=Counter)

    def add(self, places: Places, first: int, definitions: Definitions) -> Indices:
        """Take the messages that fit a layout, the first of which has the number `first`; gives the others (K,)."""
        key = id(definitions)  # which live as long as the channels
        known = self.found.setdefault(key, [])
        left, unfit = None, NONE
        for rows in known:
            left = rows.take(places, left, first)
            if not len(left):
                return left
        left = np.arange(len(places)) if left is None else left
        while len(left) and self.tried[key] < LIMITS.layouts:
            self.tried[key] += 1
            template = Template.of(
                places.taken(left[:1]).payloads()[0], self.kind, self.encoding, definitions, self.account
            )
            if template is None:
                unfit, left = np.append(unfit, left[0]), left[1:]
            else:
                known.append(Rows(template, account=self.account))
                left = known[-1].take(places, left, first)
        return np.concatenate((unfit, left))

    def parts(self) -> list[tuple[Indices, Columns]]:
        """Numbers of messages and their columns, by layout; what was gathered is given away."""
        made = [rows for several in self.found.values() for rows in several]
        self.found = {}
        return [(_numbers(rows.index), rows.columns()) for rows in made]


def _numbers(index: list[range | Indices]) -> Indices:
    return np.concatenate([np.arange(i.start, i.stop) if isinstance(i, range) else i for i in index])
