"""Messages that are not ROS': JSON and protobuf in MCAP, as Foxglove's schemas and own programs write them.

Both are read message by message, by their libraries: a field's place in the bytes depends on the values before it.
Columns are dotted names as for ROS messages; what a message lacks is NaN. A protobuf number that was not sent is zero,
by the rules of protobuf; a message within that was not sent is NaN.
"""

import base64
import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from wrenchgap.flight.budget import LIMITS, Account
from wrenchgap.flight.extras import needed_for
from wrenchgap.flight.formats.decode import UndecodableError, dotted_names
from wrenchgap.flight.formats.reader import Channel, Columns, joined, one_line

Value = float | list[float]


@dataclass
class Encoded(ABC):
    """Gathers the columns of one channel, batch by batch; `fields` are the dotted names that its schema tells.

    Messages become columns `LIMITS.object_rows` at a time: a message by itself takes twenty times the bytes of its
    numbers.
    """

    channel: Channel
    fields: list[str] = field(default_factory=list)
    account: Account = field(default_factory=lambda: Account(Path()))
    malformed: int = 0
    count: int = 0
    _rows: list[Mapping[str, Value]] = field(default_factory=list)
    _held: int = 0
    _parts: list[tuple[slice, Columns]] = field(default_factory=list)

    @abstractmethod
    def numbers(self, payload: bytes) -> Iterator[tuple[str, Value]]:
        """The numbers of one message with their dotted names; raises ValueError where it is none."""

    def add(self, payloads: list[bytes]) -> None:
        """Decode some messages; those that cannot be are counted in `malformed`."""
        for payload in payloads:
            self._hold(2 * LIMITS.decoded_number + LIMITS.decoded_per_byte * len(payload))
            row: dict[str, Value] = {}
            try:
                for name, value in self.numbers(payload):
                    self._hold(LIMITS.decoded_number + len(name) + 8 * (len(value) if isinstance(value, list) else 1))
                    row[name] = value
            except (ValueError, RecursionError, OverflowError):
                row = {}
                self.malformed += 1
            self._rows.append(row)
            self.count += 1
            if len(self._rows) == LIMITS.object_rows:
                self._gather()

    def _hold(self, size: int) -> None:
        """Count bytes of a message until it is made columns; a few bytes may have names without end."""
        self._held += size
        self.account.ask(self._held, "decoded messages")
        self.account.check_time()

    def _gather(self) -> None:
        """Make columns of the last messages."""
        rows, self._rows, self._held = self._rows, [], 0
        cells: dict[str, tuple[list[int], list[Value]]] = {}
        for i, row in enumerate(rows):
            for name, value in row.items():
                where, values = cells.setdefault(name, ([], []))
                where.append(i)
                values.append(value)
        columns: Columns = {}
        for name, (where, values) in cells.items():
            width = max((len(cell) for cell in values if isinstance(cell, list)), default=0)
            self.account.take(
                LIMITS.decoded_number + 8 * len(rows) * max(width, 1), f"columns, of which {name:.100} is one,"
            )
            self.account.check_time()
            if not width:
                columns[name] = np.full(len(rows), np.nan)
                columns[name][where] = values
                continue
            columns[name] = np.full((len(rows), width), np.nan)
            for i, cell in zip(where, values, strict=True):
                if isinstance(cell, list):
                    columns[name][i, : len(cell)] = cell
        self._parts.append((slice(self.count - len(rows), self.count), columns))

    def columns(self) -> Columns:
        """All columns, (count,) or (count, K), nan where a message lacks one; what was gathered is given away."""
        if self._rows:
            self._gather()
        return joined(self._parts, self.count, self.account, "columns, of which {name} is one,")


class JsonMessages(Encoded):
    """JSON objects."""

    def numbers(self, payload: bytes) -> Iterator[tuple[str, Value]]:
        """Numbers and arrays of numbers, however deep."""
        return _within(json.loads(payload), "", LIMITS.object_depth)


def _within(value: Any, path: str, depth: int) -> Iterator[tuple[str, Value]]:
    """Numbers of a JSON value by dotted name; JSON has any number of digits, and those beyond 1e300 are no number."""
    kind = type(value)
    if kind is dict:
        for name, inner in value.items() if depth else ():
            yield from _within(inner, f"{path}.{name}" if path else name, depth - 1)
    elif kind is float:
        yield path, value
    elif kind is int or kind is bool:
        yield path, float(value) if abs(value) < 1e300 else float("nan")
    elif kind is list and 0 < len(value) <= LIMITS.array_numbers and all(isinstance(x, int | float) for x in value):
        yield path, [float(x) if isinstance(x, float) or abs(x) < 1e300 else float("nan") for x in value]


@dataclass
class ProtobufMessages(Encoded):
    """Protobuf messages of the class that the file describes."""

    kind: Any = None

    def numbers(self, payload: bytes) -> Iterator[tuple[str, Value]]:
        """Numbers and arrays of numbers; of messages within, those that were sent."""
        try:
            message = self.kind.FromString(payload)
        except Exception as error:  # protobuf's DecodeError, which is only known where it is installed
            raise ValueError(one_line(error)) from error
        return _leaves(message, "")


def _leaves(message: Any, path: str, depth: int = LIMITS.object_depth) -> Iterator[tuple[str, Value]]:
    """Numbers by dotted name; one that was not sent has its default, a message within that was not sent is none."""
    for described in message.DESCRIPTOR.fields:
        name = f"{path}.{described.name}" if path else described.name
        if _repeated(described):
            value = getattr(message, described.name)
            known = described.message_type is None and 0 < len(value) <= LIMITS.array_numbers
            if known and isinstance(value[0], int | float):
                yield name, [float(item) for item in value]
        elif described.message_type is not None:
            if depth and message.HasField(described.name):
                yield from _leaves(getattr(message, described.name), name, depth - 1)
        elif isinstance(value := getattr(message, described.name), int | float):
            yield name, float(value)


def _repeated(described: Any) -> bool:
    return bool(described.is_repeated) if hasattr(described, "is_repeated") else described.label == 3


def encoded(channel: Channel, account: Account) -> Encoded:
    """What decodes a channel of JSON or protobuf. Raises UndecodableError where its schema cannot be used."""
    if channel.encoding == "json":
        try:
            schema = json.loads(channel.definition or "{}")
        except (ValueError, RecursionError):
            schema = {}
        return JsonMessages(channel, _names(_properties(schema), _properties_within), account)
    with needed_for("protobuf messages", UndecodableError):
        from google.protobuf import descriptor_pb2 as pb2
        from google.protobuf import descriptor_pool as pools
        from google.protobuf import message_factory as factory
    try:
        files = pb2.FileDescriptorSet.FromString(base64.b64decode(channel.definition or ""))
        pool = pools.DescriptorPool()
        for file in files.file:
            pool.Add(file)
        kind = pool.FindMessageTypeByName(channel.type)
        return ProtobufMessages(channel, _names(kind, _fields_within), account, kind=factory.GetMessageClass(kind))
    except Exception as error:  # of a damaged description protobuf raises many kinds
        raise UndecodableError(f"its description of {channel.type} cannot be read: {one_line(error)}") from error


def _names(kind: Any, inner: Callable[[Any], Iterable[tuple[str, Any]]]) -> list[str]:
    return dotted_names(kind, inner, LIMITS.object_depth, LIMITS.schema_fields)


def _properties(schema: Any) -> dict[Any, Any] | None:
    """Those of a JSON schema; None where it has none."""
    found = schema.get("properties") if isinstance(schema, dict) else None
    return found if isinstance(found, dict) else None


def _properties_within(properties: dict[Any, Any] | None) -> Iterator[tuple[str, Any]]:
    return ((str(name), _properties(inner)) for name, inner in (properties or {}).items())


def _fields_within(kind: Any) -> Iterator[tuple[str, Any]]:
    return ((one.name, None if _repeated(one) else one.message_type) for one in kind.fields)
