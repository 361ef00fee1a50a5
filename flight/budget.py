"""What reading one log may take: memory and time. Every reader asks before it allocates, and while it loops.

A few kilobytes may unfold to gigabytes, and a page of definitions may keep a processor busy for hours. The memory is
counted, not measured: what is kept of the log, and what is unfolded at one moment, each by its size in bytes before it
is allocated. A process takes some 0.3 GB besides, and where series are copied on their way to a flight up to twice as
much for a moment; what waits on disk (`flight.memory`) does not count. The time is that of the processor in the thread
that reads, without what numba compiles, so that neither a busy machine nor the first run uses it up.
"""

from __future__ import annotations

import math
import os
import re
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numba.core import event

from wrenchgap.flight.errors import LogError, UsageError


@dataclass(frozen=True)
class Limits:
    """What readers take at a time, hold at most, and count for what they hold; beside the `Budget` of a log."""

    memory: float = 1e9
    """Memory [bytes] by default, besides `memory_per_byte`."""
    memory_per_byte: float = 100.0
    """Memory [bytes] by default for each byte of the file. Ten hours at 100 Hz are 3.6 GB in MCAP and count some 1 GB;
    a byte of a table counts 30 at most."""
    most_memory: float = 4e9
    """Memory [bytes] by default at most, as half of the machine's is."""
    seconds: float = 20.0
    """Processor time [s] by default, besides `seconds_per_mb`: ten times what the slowest format takes here, for a
    board computer that imports its libraries meanwhile."""
    seconds_per_mb: float = 2.0
    """Processor time [s] by default for each MB of the file."""
    look_interval: float = 0.05
    """Time by the clock [s] between two looks at the processor time, which asks the kernel."""
    batch_messages: int = 8192
    """Messages that a reader gathers before it hands them on, at most."""
    batch_bytes: int = 2**23
    """Bytes of their payloads, about."""
    message_overhead: int = 150
    """Bytes of a message that is held by itself, besides its payload."""
    longest_message: int = 2**26
    """Bytes of a message that was compressed: a few damaged bytes may unfold to terabytes."""
    log_times: int = 150
    """Bytes of an array of log times besides its numbers."""
    fields: int = 5000
    """Fields of a type that are looked at: a recursive definition has no end of them."""
    definition_letters: int = 2**17
    """Letters of a definition: those of the largest types with all that they use are some 20,000, and parsing takes up
    to 0.1 ms for each."""
    names_letters: int = 2**20
    """Letters of all names of a type's fields together: `fields` of 200 letters, which are long ones."""
    field_overhead: int = 600
    """Bytes of a field besides its numbers: name, array and place."""
    fields_at_once: int = 1024
    """Fields for which an account is asked at once."""
    depth: int = 40
    """Messages within messages: a recursive definition has no end of them."""
    layouts: int = 8
    """Layouts of one topic: text or sequences that change with every message have no end of them."""
    layout_bytes: int = 2**16
    """Bytes of a message of which a layout is made: a picture is copied as it is."""
    packed_block: int = 2**20
    """Bytes of packed rows that are gathered in one piece."""
    object_depth: int = 8
    """Objects within objects of JSON and protobuf: a definition may be recursive."""
    array_numbers: int = 256
    """Numbers of an array of theirs: a picture is no signal."""
    object_rows: int = 4096
    """Messages of theirs that become columns at once."""
    decoded_number: int = 200
    """Bytes of a decoded number with its name, or of a column without numbers."""
    decoded_per_byte: int = 10
    """Bytes that a byte of JSON takes meanwhile."""
    schema_fields: int = 2000
    """Names of fields of a schema: a recursive type has no end of them."""
    mcap_piece: int = 2**18
    """Bytes of an MCAP file that are read, or decompressed, at once."""
    mcap_chunk: int = 2**28
    """Bytes of a chunk's records: no recorder holds back more, and a few damaged bytes may claim terabytes."""
    mcap_record: int = 1000
    """Bytes of a schema or channel that is kept, besides its record."""
    mcap_messages: int = 2**15
    """Messages that are handed on at once."""
    mcap_alone: int = 100
    """Messages outside of chunks that are read one by one where the next of `mcap_piece` bytes are few, before several
    are tried again."""
    bag_unfolded: int = 4
    """Bytes that a byte of a chunk of a ROS 1 bag takes, with where its messages lie."""
    bag_connection: int = 1500
    """Bytes of one of its connections or chunks."""
    bag_entries: int = 500
    """Bytes of the entries of its index, besides their numbers."""
    bag_object: int = 150
    """Bytes of an entry of rosbags' own index."""
    disk_unfolded: int = 50
    """Times its size that a compressed file may take on the disk, which is often memory, before it counts."""
    sqlite_fetched: int = 128
    """Rows of a table that are fetched at once."""
    sqlite_rows: int = 4096
    """Rows of a table that are taken at once."""
    sqlite_bytes: int = 2**22
    """Bytes of their messages, about."""
    sqlite_topic: int = 1000
    """Bytes of a topic, besides its definition."""
    sqlite_steps: int = 100_000
    """Steps of a query, after which the time is looked at."""
    sqlite_copies: int = 8
    """Share of the budget, one over this, that a message may have, as it is copied."""
    sqlite_message: int = 10**9
    """Bytes of a message, which is sqlite's own limit."""
    table_column: int = 2700
    """Bytes of a column of a table by itself."""
    table_cell: int = 60
    """Bytes of a number of it."""
    table_letter: int = 8
    """Bytes of a letter of its longest line, as text and in the parser."""
    table_nested: int = 400
    """Bytes of a value of a column of lists or tables."""
    table_dates: int = 10_000
    """Dates that are read between two looks at the time, where each has a form of its own."""
    header_letters: int = 200
    """Letters beyond which a header is no name: searched for meanings, thousands of them would take for ever."""
    ulog_field: int = 1000
    """Bytes of a field of a ULog's subscription: its name, its place and its array, without the numbers."""
    dataflash_block: int = 65536
    """Messages of a dataflash log that are cut at once: their index takes eight times their bytes."""
    dataflash_instances: int = 256
    """Instances of a message: their number is a byte where ArduPilot writes it."""
    dataflash_place: int = 8
    """Bytes that the index of a dataflash log keeps of each message."""
    channel_columns: int = 64
    """Columns of an array that get a channel each: an image is no signal."""
    kept_flights: int = 2_000_000_000
    """Bytes of all flights in the cache together; the oldest go first."""


LIMITS = Limits()
UNITS = {"kB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12, "s": 1.0, "min": 60.0, "h": 3600.0}


class BudgetError(LogError):
    """A log that would take more memory or time than it may."""


@dataclass(frozen=True)
class Budget:
    """Memory [bytes] and processor time [s] for one log; None for the default, which for the time grows with the file.

    As text: `8GB`, `120s`, `8GB,2min`.
    """

    memory: float | None = None
    seconds: float | None = None

    @classmethod
    def of(cls, said: Budget | str | None) -> Budget:
        """The budget that a text says, or that it is; raises UsageError for a text that says none."""
        if not isinstance(said, str):
            return said or cls()
        found: dict[str, float] = {}
        for part in said.split(","):
            match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(\w+)\s*", part)
            if match is None or match[2] not in UNITS or not 0.0 < float(match[1]) < math.inf:
                raise UsageError(f"--budget {said}: expected a memory, a time or both, as in --budget 8GB,120s")
            kind = "memory" if match[2].endswith("B") else "seconds"
            if kind in found:
                raise UsageError(f"--budget {said}: says the {kind} twice; say it once, as in --budget 8GB,120s")
            found[kind] = float(match[1]) * UNITS[match[2]]
        return cls(**found)

    def account(self, path: Path, size: int) -> Account:
        """What is left of the budget for a log of so many bytes, from now on."""
        memory = default_memory(size) if self.memory is None else self.memory
        seconds = LIMITS.seconds + LIMITS.seconds_per_mb * size / 1e6 if self.seconds is None else self.seconds
        return Account(path, memory, seconds)


def default_memory(size: int) -> float:
    """What a file of so many bytes may take [bytes]: see `Limits`. A container's memory is that of the machine."""
    available = 2 * LIMITS.most_memory
    with suppress(AttributeError, ValueError, OSError):  # no POSIX
        available = float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    with suppress(OSError, ValueError):  # no container, or one without a limit
        available = min(available, int(Path("/sys/fs/cgroup/memory.max").read_text(encoding="ascii")))
    return min(LIMITS.memory + LIMITS.memory_per_byte * size, max(available / 2, LIMITS.memory), LIMITS.most_memory)


@dataclass
class Account:
    """What the reading of one log has taken so far of its `memory` [bytes] and `seconds`."""

    path: Path
    memory: float = math.inf
    seconds: float = math.inf
    taken: float = 0.0
    _began: float = field(default_factory=lambda: _worked())
    _look: float = 0.0

    def take(self, size: float, what: str) -> None:
        """Count bytes that are kept from now on; raises BudgetError, which says of `what`, where they are too many."""
        self.ask(size, what)
        self.taken += size

    def ask(self, size: float, what: str) -> None:
        """Whether bytes that are needed for a moment are there besides those taken; raises BudgetError."""
        if (total := self.taken + size) > self.memory:
            raise BudgetError(
                f"{self.path}: {what} would take {in_bytes(size)} of memory, {in_bytes(self.taken)} are taken, and the "
                f"budget is {in_bytes(self.memory)}. If the file is sound, allow more: --budget "
                f"{in_bytes(1.25 * total).replace(' ', '')}"
            )

    @property
    def over_time(self) -> bool:
        """Whether the reading has taken longer than it may."""
        return _worked() - self._began > self.seconds

    def check_time(self) -> None:
        """Raise BudgetError where the reading has taken longer than it may; looks now and then."""
        if (now := time.monotonic()) < self._look:
            return
        self._look = now + LIMITS.look_interval
        if self.over_time:
            raise BudgetError(
                f"{self.path}: reading it takes more than {self.seconds:.3g} s of processor time, which is the budget. "
                f"If the file is sound, allow more: --budget {math.ceil(4 * self.seconds)}s"
            )


def in_bytes(size: float) -> str:
    """`4.2 GB`."""
    unit = next((unit for unit in ("TB", "GB", "MB") if size >= UNITS[unit]), "kB")
    return f"{size / UNITS[unit]:.3g} {unit}" if size < 1e15 else f"{size / 1e12:.0e} TB"


class _Compiling(event.Listener):
    """Sums the seconds for which numba compiles, of this process."""

    depth = 0
    began = total = 0.0

    def on_start(self, event: Any) -> None:
        """Kernels that are called by kernels are compiled within them."""
        if not self.depth:
            self.began = time.thread_time()
        self.depth += 1

    def on_end(self, event: Any) -> None:
        """The outermost one ends."""
        self.depth -= 1
        if not self.depth:
            self.total += time.thread_time() - self.began


_compiling = _Compiling()
event.register("numba:compile", _compiling)  # type: ignore[no-untyped-call]


def _worked() -> float:
    """Seconds of processor time of this thread, without those for which it compiled."""
    return time.thread_time() - _compiling.total
