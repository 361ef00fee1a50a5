"""Messages to columns: every numeric field of N messages becomes one array, read for all N at once.

A serialised message has no table of offsets: where a field lies follows from the definition and from the counters of
the strings and sequences before it. Messages whose counters agree have the same layout, so their bytes, stacked to
(N, length), are cut in columns. Where a counter differs, the messages are parted by its value and each part is read by
itself. Messages that a reader hands on where they lie are copied by the layout of the first.
"""

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache, lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from wrenchgap.flight.budget import LIMITS, Account
from wrenchgap.flight.flight import Indices
from wrenchgap.flight.formats.message_layouts import Packer
from wrenchgap.flight.formats.message_walk import DTYPES as DTYPES
from wrenchgap.flight.formats.message_walk import Definitions, Layout, Uneven, Walk
from wrenchgap.flight.formats.message_walk import UndecodableError as UndecodableError
from wrenchgap.flight.formats.reader import Channel, Columns, Places, joined, one_line

ACTUATORS = {
    "actuator_msgs/msg/Actuators": (
        "std_msgs/Header header\nfloat64[] position\nfloat64[] velocity\nfloat64[] normalized"
    ),
    "mav_msgs/msg/Actuators": (
        "std_msgs/Header header\nfloat64[] angles\nfloat64[] angular_velocities\nfloat64[] normalized"
    ),
}
"""Common types that no ROS distribution ships, for files without definitions."""


NO_SYNTAX = re.compile(r""""(?:[^"\\\n]|\\.)*+"?|'(?:[^'\\\n]|\\.)*+'?|//[^\n]*|/\*.*?(?:\*/|\Z)""", re.DOTALL)
"""Texts and comments of IDL; one that is not closed ends with its line, so that none is looked through twice."""
CONSTANT = re.compile(r"\bconst\b")
LITERAL = re.compile(r"[-+]?[\w.:]*(?:[eE][-+]?\d+)?\s*")
NESTED = re.compile(r"\([^()]*\(")


def definitions_of(channel: Channel) -> Definitions:
    """Field definitions by type name: the file's own first, then the distribution's."""
    store = Stores.ROS1_NOETIC if channel.encoding == "ros1" else Stores.ROS2_HUMBLE
    found = dict(_known(store))
    if channel.definition:
        try:
            found |= _parsed(channel.definition, channel.type, channel.definition_format)
        except UndecodableError:
            raise
        except Exception as error:  # of a damaged definition rosbags raises many kinds
            raise UndecodableError(f"its definition of {channel.type} cannot be read: {one_line(error)}") from error
    if channel.type not in found:
        raise UndecodableError(f"type {channel.type} is neither defined in the file nor known")
    return found


def layout_of(payload: bytes, kind: str, definitions: Definitions) -> Layout:
    """Where the numbers of one CDR message lie; messages with the same counters share it."""
    rows = np.frombuffer(payload, dtype=np.uint8)[None]
    walk = Walk(rows, definitions, "cdr", "<" if payload[1] == 1 else ">")
    walk.message("", kind)
    return walk.layout


@cache
def _known(store: Stores) -> Definitions:
    """What a distribution ships, and common types that none does."""
    found = dict(get_typestore(store).fielddefs)
    for name, text in ACTUATORS.items():
        found |= get_types_from_msg(text, name)
    return found


@lru_cache(maxsize=512)
def _parsed(text: str, kind: str, definition_format: str) -> Definitions:
    if len(text) > LIMITS.definition_letters:
        raise UndecodableError(f"its definition of {kind} is {len(text):,} characters long")
    if definition_format == "msg":
        return get_types_from_msg(text, kind)
    found: dict[str, tuple[Any, Any]] = {}
    for part in text.split("=" * 80 + "\n"):
        body = part.split("\n", 1)[1] if part.startswith("IDL: ") else part
        plain = NO_SYNTAX.sub("", body)
        # parentheses in parentheses are parsed again on every level, constants of constants are evaluated at each use,
        # and a shift makes a number of any length: ROS writes none of these
        statements = [CONSTANT.split(s, maxsplit=1) for s in plain.split(";")[:-1]]
        values = [s[1].partition("=")[2].lstrip() for s in statements if len(s) > 1]
        if NESTED.search(plain) or "<<" in plain or not all(map(LITERAL.fullmatch, values)):
            raise UndecodableError("its definition in IDL computes with constants, which those of ROS do not")
        if body.strip():
            found |= get_types_from_idl(body)
    return found


def flat_fields(kind: str, definitions: Definitions, depth: int = 6) -> list[str]:
    """Dotted names of a type's fields, e.g. twist.linear.x; sequences of messages are not entered."""

    def inner(kind: str) -> Iterator[tuple[str, str | None]]:
        for name, (node, payload) in definitions[kind][1]:
            yield name, payload if node == Nodetype.NAME and payload in definitions else None

    return dotted_names(kind, inner, depth, LIMITS.fields)


def dotted_names(kind: Any, inner: Callable[[Any], Iterable[tuple[str, Any]]], depth: int, most: int) -> list[str]:
    """Dotted names of a type's fields; `inner` gives the names within a type, each with its type where it has names.

    Of `most` names at most, a type that is entered counting as one: it may have none, and contain itself. And as many
    as `LIMITS.names_letters` have room for: those within a type whose name is long are long as well.
    """

    def walk(kind: Any, depth: int) -> Iterator[str]:
        for name, below in inner(kind):
            if below is None or not depth:
                yield name
            else:
                yield ""
                for rest in walk(below, depth - 1):
                    yield rest and f"{name}.{rest}"

    names, letters = [], 0
    for name in islice(walk(kind, depth), most):
        letters += len(name)
        if letters > LIMITS.names_letters:
            break
        if name:
            names.append(name)
    return names


@dataclass
class Decoder:
    """Gathers the columns of one channel, batch by batch.

    Covariances are left out: they are most of an odometry message and nothing here reads them. Of those of an IMU the
    first element stays: -1 says that the readings are none.
    """

    channel: Channel
    definitions: Definitions
    account: Account = field(default_factory=lambda: Account(Path()))
    parts: list[tuple[Indices, Columns]] = field(default_factory=list)
    count: int = 0
    malformed: int = 0
    _packer: Packer = field(init=False)

    def __post_init__(self) -> None:
        self._packer = Packer(self.channel.type, self.channel.encoding, self.account)

    def add(self, payloads: list[bytes] | Places, definitions: Definitions | None = None) -> None:
        """Decode some messages; those that do not fit their definition are counted in `malformed`.

        `definitions` are those of another writer of the topic, where they differ.
        """
        known, first = self.definitions if definitions is None else definitions, self.count
        self.count += len(payloads)
        self.account.check_time()
        number = None
        if isinstance(payloads, Places):
            rest = self._packer.add(payloads, first, known)
            if not len(rest):
                return
            payloads, number = payloads.taken(rest).payloads(), rest + first
        self._walk(payloads, np.arange(first, self.count) if number is None else number, known)

    def _walk(self, payloads: list[bytes], number: Indices, definitions: Definitions) -> None:
        """Read messages of every length one field after another."""
        lengths = np.fromiter(map(len, payloads), dtype=np.intp, count=len(payloads))
        for length in np.unique(lengths):
            index = np.flatnonzero(lengths == length)
            raw = b"".join([payloads[i] for i in index]) if len(index) < len(payloads) else b"".join(payloads)
            rows = np.frombuffer(raw, dtype=np.uint8).reshape(len(index), length)
            known = len(self.parts), self.malformed
            try:
                self._add_rows(number[index], rows, definitions)
            except RecursionError:  # thousands of counters, all different in every message
                del self.parts[known[0] :]
                self.malformed = known[1] + len(index)

    def _add_rows(self, index: Indices, rows: NDArray[np.uint8], definitions: Definitions) -> None:
        try:
            for order, part in _by_byte_order(rows, self.channel.encoding):
                walk = Walk(rows[part], definitions, self.channel.encoding, order, self.account)
                walk.message("", self.channel.type)
                self.account.take(
                    LIMITS.field_overhead * len(walk.columns) + sum(v.nbytes for v in walk.columns.values()), "messages"
                )
                self.parts.append((index[part], walk.columns))
        except Uneven as uneven:
            for value in np.unique(uneven.counts):
                chosen = uneven.counts == value
                self._add_rows(index[chosen], rows[chosen], definitions)
        except UndecodableError:
            self.malformed += len(index)

    def columns(self) -> Columns:
        """All columns, (count,) or (count, K). Where lengths differ, the shorter are filled with NaN (text: empty).

        Once: what was gathered is given away column by column, so that hours of log are not held twice.
        """
        self.parts = sorted([*self.parts, *self._packer.parts()], key=lambda part: int(part[0][0]))
        if len(self.parts) == 1 and len(self.parts[0][0]) == self.count:  # all of one layout, in their order
            return self.parts.pop()[1]
        return joined(self.parts, self.count, self.account, f"the column {{name}} of {self.count} messages")


def _by_byte_order(rows: NDArray[np.uint8], encoding: str) -> list[tuple[str, Indices]]:
    """Rows of each byte order; CDR's header names it: 0 big-endian, 1 little-endian."""
    every = np.arange(len(rows))
    if encoding != "cdr":
        return [("<", every)]
    if rows.shape[1] < 4:
        raise UndecodableError("shorter than the CDR header")
    kinds = rows[:, 1]
    if np.any(rows[:, 0]) or np.any(kinds > 1):
        raise UndecodableError("not plain CDR")
    parts = [("<", np.flatnonzero(kinds == 1)), (">", np.flatnonzero(kinds == 0))]
    return [(order, index) for order, index in parts if len(index)]
