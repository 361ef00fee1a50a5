"""One walk through the fields of equally laid out messages: where each number of them lies, and all of them at once.

CDR (ROS 2; OMG CDR 1): a 4-byte header whose second byte tells the byte order, then every primitive aligned to its
size. ROS 1: little-endian, nothing aligned.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

from wrenchgap.flight.budget import LIMITS, Account
from wrenchgap.flight.formats.reader import Columns

Layout = dict[str, tuple[int, np.dtype[Any], int]]
"""Offset [bytes], primitive and their number, of every numeric field of one message."""
Definitions = Mapping[str, tuple[Any, Any]]

DTYPES = {
    **dict.fromkeys(("bool", "byte", "char", "octet"), "u1"),
    **{f"{kind}{8 * size}": f"{kind[0]}{size}" for kind in ("int", "uint") for size in (1, 2, 4, 8)},
    "float32": "f4",
    "float64": "f8",
}
"""The primitive of each of ROS' types."""


class UndecodableError(Exception):
    """The messages do not fit their definition; the text says how."""


class Uneven(Exception):
    """A counter differs between messages: `counts` (N,)."""

    def __init__(self, counts: NDArray[Any]) -> None:
        self.counts = counts


class Walk:
    """Reads the fields of N equally laid out messages, `rows` (N, length), one after another.

    `columns` are what was read, `layout` is where the numbers of it lie, and `fixed` are first byte and number of the
    bytes on which that depends, or which are text. Raises `Uneven` where a counter differs between the messages.
    """

    def __init__(
        self,
        rows: NDArray[np.uint8],
        definitions: Definitions,
        encoding: str,
        order: str,
        account: Account | None = None,
    ) -> None:
        self.rows = rows
        self.account = account or Account(Path())
        self.fields = 0
        self.definitions = definitions
        self.aligned = encoding == "cdr"
        self.origin = self.position = 4 if self.aligned else 0
        self.order = order
        self.columns: Columns = {}
        self.layout: Layout = {}
        self.fixed: list[tuple[int, int]] = []
        self.depth = 0

    def message(self, prefix: str, kind: str) -> None:
        """Read the fields of a message within."""
        if kind not in self.definitions:
            raise UndecodableError(f"type {kind} is not defined")
        self.depth += 1
        if self.depth > LIMITS.depth:
            raise UndecodableError(f"type {kind} contains itself")
        for name, description in self.definitions[kind][1]:
            self.value(f"{prefix}{name}", description)
        self.depth -= 1

    def value(self, path: str, description: Any) -> None:
        """Read one field, whatever it is."""
        node, payload = description
        self.fields += 1
        if self.fields % LIMITS.fields_at_once == 0:
            self.account.ask(LIMITS.field_overhead * self.fields, f"the fields of one message, {self.fields} and more,")
            self.account.check_time()
        if node == Nodetype.BASE:
            self.columns[path] = self.text() if payload[0] == "string" else self.numbers(payload[0], 1, path)[:, 0]
        elif node == Nodetype.NAME:
            self.message(f"{path}.", payload)
        else:
            inner, number = payload
            self.several(path, inner, int(number) if node == Nodetype.ARRAY else self.counter())

    def several(self, path: str, inner: Any, number: int) -> None:
        """Read an array or a sequence."""
        node, payload = inner
        if number > self.rows.shape[1]:  # even messages without fields are not as many as bytes
            raise UndecodableError("shorter than its definition")
        if node == Nodetype.BASE and payload[0] != "string":
            values = self.numbers(payload[0], number, path)
            if path.endswith(("linear_acceleration_covariance", "angular_velocity_covariance")):
                self.columns[path] = values[:, :1]
            elif not path.endswith("covariance"):
                self.columns[path] = values
        elif node == Nodetype.BASE:
            self.account.ask(LIMITS.field_overhead * number, f"{number} texts of one message")
            texts = [self.text() for _ in range(number)]
            self.columns[path] = np.stack(texts, axis=1) if texts else np.zeros((len(self.rows), 0), dtype="S1")
        else:
            for i in range(number):
                self.value(f"{path}.{i}", inner)

    def numbers(self, kind: str, number: int, path: str = "") -> NDArray[Any]:
        """`number` primitives (N, number), after alignment."""
        if kind not in DTYPES:
            raise UndecodableError(f"fields of type {kind} are not read")
        dtype = np.dtype(DTYPES[kind]).newbyteorder(self.order)  # type: ignore[arg-type]
        if self.aligned and number:
            self.position += -(self.position - self.origin) % dtype.itemsize
        self.layout[path] = (self.position, dtype, number)
        raw = self.take(dtype.itemsize * number)
        return raw.view(dtype).reshape(len(self.rows), number).astype(dtype.newbyteorder("="), copy=False)

    def counter(self) -> int:
        """How many elements follow, which must be the same in all messages."""
        counts = self.numbers("uint32", 1)[:, 0]
        if np.any(counts != counts[0]):
            raise Uneven(counts)
        self.fixed.append((self.position - 4, 4))
        return int(counts[0])

    def text(self) -> NDArray[Any]:
        """The bytes of a text (N,)."""
        raw = self.take(self.counter())
        width = raw.shape[1]
        self.fixed.append((self.position - width, width))
        return raw.view(f"S{width}")[:, 0] if width else np.zeros(len(self.rows), dtype="S1")

    def take(self, size: int) -> NDArray[np.uint8]:
        """The next `size` bytes of each message.

        Where they are goes to compiled copies (`layout`, `fixed`), which look no further: an array of a definition may
        have a negative length.
        """
        stop = self.position + size
        if not self.position <= stop <= self.rows.shape[1]:
            raise UndecodableError("shorter than its definition")
        raw = np.ascontiguousarray(self.rows[:, self.position : stop])
        self.position = stop
        return raw
