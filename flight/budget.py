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

MEMORY, MEMORY_PER_BYTE, MOST_MEMORY = 1e9, 100.0, 4e9
"""Bytes, by default: so many, and so many for each byte of the file, but no more than half of the machine's memory or
the third. Ten hours at 100 Hz are 3.6 GB in MCAP and count some 1 GB; a byte of a table counts 30 at most."""
SECONDS, SECONDS_PER_MB = 20.0, 2.0
"""Of processor time, by default: so many, and so many for each MB of the file. Ten times what the slowest format takes
here, for a board computer that imports its libraries meanwhile."""
OFTEN = 0.05
"""Seconds by the clock between two looks at the processor time, which asks the kernel."""
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
        return Account(path, memory, SECONDS + SECONDS_PER_MB * size / 1e6 if self.seconds is None else self.seconds)


def default_memory(size: int) -> float:
    """What a file of so many bytes may take [bytes]: see `MEMORY`. A container's memory is that of the machine."""
    available = 2 * MOST_MEMORY
    with suppress(AttributeError, ValueError, OSError):  # no POSIX
        available = float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    with suppress(OSError, ValueError):  # no container, or one without a limit
        available = min(available, int(Path("/sys/fs/cgroup/memory.max").read_text(encoding="ascii")))
    return min(MEMORY + MEMORY_PER_BYTE * size, max(available / 2, MEMORY), MOST_MEMORY)


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

    def check_time(self) -> None:
        """Raise BudgetError where the reading has taken longer than it may; looks at most every `OFTEN` seconds."""
        if (now := time.monotonic()) < self._look:
            return
        self._look = now + OFTEN
        if _worked() - self._began > self.seconds:
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
