"""What every log format offers to the rest: channels, and their messages in batches of raw bytes.

A format is one file with one subclass and one line in `flight.formats.READERS`. A `TableReader` gives whole columns, in
the types, units and frames of `flight.formats.standard_topics`. A `Reader` is for containers of messages: it finds
channels and hands out bytes, which `flight.formats.decode` turns into columns. A library that only some formats need is
asked for when such a file is opened (`flight.extras`). How to write one: docs/add-a-log-format.md.
"""

from __future__ import annotations

import contextlib
import io
import os
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
import zstandard
from numpy.typing import NDArray

from wrenchgap.flight.budget import LIMITS, Account, BudgetError
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import Indices

Columns = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Table:
    """One topic's messages: N log times [ns] and, where the topic was wanted, its fields as columns.

    `header_ns` are the header's stamps [ns], or None where the type has none or nobody filled it in. `problem` says
    why a wanted topic could not be decoded. Rows are in the order of the log time. `firmware` is the one whose
    names the columns of a table have.
    """

    topic: str
    type: str
    log_time_ns: NDArray[np.int64]
    header_ns: NDArray[np.int64] | None = None
    columns: Columns = field(default_factory=dict)
    problem: str | None = None
    firmware: str = ""

    def __len__(self) -> int:
        return len(self.log_time_ns)


def in_order(stamps: NDArray[np.int64], what: str, notes: list[str], far: float = 1.0, rare: float = 0.2) -> Indices:
    """The rows of N in the order of their stamps [ns]; the notes are told where they were in another.

    Without those whose stamps are `far` [s], longer than any queue holds a message, from the median of five rows about
    them, which is the middle one's own where time only goes on: a damaged byte makes such a stamp. Where these are more
    than a share `rare`, the rows were in another order.
    """
    from scipy.ndimage import median_filter  # here: a page that only opens needs no scipy

    away = np.abs(stamps - median_filter(stamps, 5, mode="nearest")) > 1e9 * far
    away &= away.mean() < rare if len(away) else False
    if damaged := int(away.sum()):
        notes.append(f"{what}: {damaged} stamp(s) are away from those before and after: left out.")
    rows = np.flatnonzero(~away)
    if moved := int((np.diff(stamps[rows]) < 0).sum()):
        notes.append(f"{what}: time goes back {moved} time(s); the rows were put in order.")
    return np.asarray(rows[np.argsort(stamps[rows], kind="stable")])


def give_away(tables: Mapping[str, Table], keep: Collection[str]) -> None:
    """Let go of the columns of all topics but those to `keep`: nobody will ask for them any more."""
    for topic, table in tables.items():
        if topic not in keep:
            table.columns.clear()


Selection = Callable[[str, str, list[str]], bool]
"""Says from topic, type and dotted field names whether a topic's messages are worth decoding."""


def joined(parts: Sequence[tuple[Any, Columns]], count: int, account: Account, what: str) -> Columns:
    """Columns (count, ...) out of those of some rows each, which are given away column by column.

    Where widths differ or rows are missing, the rest is NaN (text: empty); a number where others have an array is none.
    `what` is a column to the account, with its `{name}`.
    """
    out: Columns = {}
    for name in dict.fromkeys(name for _, columns in parts for name in columns):
        some = [(rows, columns.pop(name)) for rows, columns in parts if name in columns]
        shape = max((values.shape[1:] for _, values in some), key=lambda shape: (len(shape), shape))
        dtype = np.result_type(*{values.dtype for _, values in some})
        account.take(dtype.itemsize * count * int(np.prod(shape)), what.format(name=name[:100]))
        account.check_time()
        complete = sum(len(values) for _, values in some if values.shape[1:] == shape) == count
        if not complete and dtype.kind != "S":
            dtype = np.dtype(float)
        out[name] = np.zeros((count, *shape), dtype=dtype)
        if not complete and dtype.kind == "f":
            out[name][:] = np.nan
        for rows, values in some:
            if not shape:
                out[name][rows] = values
            elif values.ndim > 1:
                out[name][rows, : values.shape[1]] = values
    return out


ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
REPLACED = "was replaced, cut or removed while it was read; read it again"


@dataclass(frozen=True, eq=False)
class Channel:
    """A stream of messages of one type; two of the same content are still two, as they may be two writers'.

    `encoding` is that of the messages: "cdr" (ROS 2), "ros1", or another, which is listed but not decoded.
    `definition` is the text that came with the file, or None; `definition_format` is "msg" or "idl". Of protobuf the
    text is the description in base 64.
    """

    topic: str
    type: str  # normalised, e.g. sensor_msgs/msg/Imu
    encoding: str
    definition: str | None = None
    definition_format: str = "msg"


@dataclass(frozen=True, eq=False)
class Places:
    """N payloads where they lie: in `data`, from byte `starts` (N,) on, `lengths` (N,) of them."""

    data: bytes
    starts: NDArray[np.int64]
    lengths: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.starts)

    def taken(self, rows: Indices) -> Places:
        """Some of them."""
        return Places(self.data, self.starts[rows], self.lengths[rows])

    def payloads(self) -> list[bytes]:
        """Each by itself."""
        return [self.data[a : a + n] for a, n in zip(self.starts.tolist(), self.lengths.tolist(), strict=True)]


class Batch(NamedTuple):
    """Some messages of one channel: log times [ns] and payloads, which are empty or none where none was wanted."""

    channel: Channel
    log_time_ns: list[int] | NDArray[np.int64]
    payloads: list[bytes] | Places


Wanted = Callable[[Channel], bool]
"""Says which channels are worth reading; of the others only the log times are kept."""


class DoubtfulError(Exception):
    """A log is not quite as it should be: it has to be read anew, carefully."""


@dataclass
class Reader(ABC):
    """One log. `notes` grow while it is read: what was missing or skipped; and `damage`: where the file holds less
    than was recorded.

    With `careful` it is read message by message; else a format may raise DoubtfulError at any time.
    """  # noqa: D205

    path: Path
    notes: list[str] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)
    careful: bool = False
    account: Account = field(default_factory=lambda: Account(Path()))
    """What reading may take, and has taken; without one given, anything."""

    name: ClassVar[str]
    """What the format is called, for `inspect` and messages."""
    expected: ClassVar[str] = ""
    """The format with the endings of its files, for errors that list what can be read; empty: another's names it."""
    magic: ClassVar[bytes]
    """With what a file of this format begins."""

    @classmethod
    def accepts(cls, path: Path, head: bytes) -> bool:
        """Whether this is the format of the existing `path`, whose first bytes are `head` (b"" for a folder)."""
        return head.startswith(cls.magic)

    @abstractmethod
    def batches(self, wanted: Wanted) -> Iterator[Batch]:
        """Go through the log once; raises `LogError` where nothing can be read."""

    def data_files(self) -> list[Path]:
        """The files whose bytes are the log's content, in the order in which they are hashed."""
        return [self.path]


class TableReader(Reader):
    """A format whose library or layout gives whole columns, so that there is nothing to decode."""

    @abstractmethod
    def tables(self, selection: Selection) -> dict[str, Table]:
        """Every topic, with columns at least where `selection` wants; raises `LogError` where nothing can be read."""

    def batches(self, wanted: Wanted) -> Iterator[Batch]:
        """No bytes of messages."""
        return iter(())


def normalised_type(name: str) -> str:
    """ROS 2 spelling of a message type: sensor_msgs/Imu becomes sensor_msgs/msg/Imu."""
    package, _, rest = name.partition("/")
    return name if not rest or "/" in rest else f"{package}/msg/{rest}"


def one_line(error: Exception, limit: int = 120) -> str:
    """Another library's message, fit for ours."""
    text = " ".join(str(error).split()).rstrip(".") or type(error).__name__
    return text if len(text) <= limit else f"{text[:limit]}..."


def decompressed(payload: bytes) -> bytes:
    """A CDR message, decompressed if `ros2 bag record --compression-mode message` compressed it.

    No CDR message begins with zstd's magic bytes: its first is 0.
    """
    if not payload.startswith(ZSTD_MAGIC):
        return payload
    with zstandard.ZstdDecompressor().stream_reader(payload) as stream:
        plain = bytearray()
        while piece := stream.read(2**17):
            plain += piece
            if len(plain) > LIMITS.longest_message:
                raise zstandard.ZstdError("a message of more than 64 MB")
    return bytes(plain)


@dataclass
class Gatherer:
    """Sorts messages by channel while a reader walks through a file."""

    account: Account
    pending: dict[Channel, tuple[list[int], list[bytes]]] = field(default_factory=dict)
    sizes: Counter[Channel] = field(default_factory=Counter)
    total: int = 0
    held: int = 0

    def add(self, channel: Channel, log_time_ns: int, payload: bytes) -> Iterator[Batch]:
        """Keep one message; hands out a batch when its channel has gathered enough."""
        self.total += 1
        self.held += len(payload) + LIMITS.message_overhead
        self.account.ask(self.held, "messages side by side")
        times, payloads = self.pending.setdefault(channel, ([], []))
        times.append(log_time_ns)
        payloads.append(payload)
        self.sizes[channel] += len(payload)
        if len(times) >= LIMITS.batch_messages or self.sizes[channel] >= LIMITS.batch_bytes:
            yield self._popped(channel)

    def direct(self, channel: Channel, log_time_ns: NDArray[np.int64], payloads: Places | None) -> Iterator[Batch]:
        """Hand out messages where they lie, after those of the channel that were kept; without payloads, None."""
        self.total += len(log_time_ns)
        if channel in self.pending:
            yield self._popped(channel)
        yield Batch(channel, log_time_ns, [] if payloads is None else payloads)

    def flush(self) -> Iterator[Batch]:
        """Hand out what is left."""
        for channel in list(self.pending):
            yield self._popped(channel)

    def _popped(self, channel: Channel) -> Batch:
        times, payloads = self.pending.pop(channel)
        self.held -= self.sizes.pop(channel) + LIMITS.message_overhead * len(times)
        return Batch(channel, times, payloads)


class Nowhere(io.TextIOBase):
    """Text that nobody reads, and that is not kept: of a damaged log a library may say a line for every byte."""

    def write(self, text: str) -> int:
        """Forget it."""
        return len(text)


@contextlib.contextmanager
def silenced() -> Iterator[None]:
    """What a library and its C code print of damaged files does not reach the user; we say it in our own words."""
    with Nowhere() as nothing, contextlib.redirect_stdout(nothing), contextlib.redirect_stderr(nothing):
        try:
            kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
        except OSError:  # no standard error to be silenced
            yield
            return
        try:
            os.dup2(nowhere, 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            os.close(nowhere)


@contextlib.contextmanager
def readable(path: Path, kind: str) -> Iterator[None]:
    """What a library makes of a file: of a damaged one it raises many kinds of error, which become one LogError."""
    try:
        with silenced():
            yield
    except BudgetError:
        raise
    except Exception as error:
        raise LogError(f"{path}: not a readable {kind} ({one_line(error) or type(error).__name__})") from error
