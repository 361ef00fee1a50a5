"""Files by which processes that work together hand things to each other, in a folder that goes with its process."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import IO

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

FOLDER, LOCK = "wrenchgap-work-", "in use"
YOUNG = 60.0
"""Age [s] below which a folder without a lock may still be about to get one."""
_locks: dict[int, IO[bytes]] = {}
"""Held by this process, by its number."""


def written(write: Callable[[IO[bytes]], None]) -> str:
    """The name of a new file of this process, with what `write` puts into it."""
    number, name = tempfile.mkstemp(suffix=".pickle", dir=_folder(os.getpid()))
    with os.fdopen(number, "wb") as file:
        write(file)
    return name


@cache
def _folder(process: int) -> str:
    """Where this process keeps its files: gone when it ends, and if it was killed, when another one begins to write.

    It holds a lock on a file there for as long as it lives, which the system gives up however a process ends.
    """
    sweep(Path(tempfile.gettempdir()))
    folder = tempfile.mkdtemp(prefix=FOLDER)
    _locks[process] = (Path(folder) / LOCK).open("ab")
    _lock(_locks[process])
    atexit.register(_leave, folder, process)
    return folder


def _leave(folder: str, process: int) -> None:
    if os.getpid() == process:  # and not a fork of it, which ends first
        _locks.pop(process).close()
        shutil.rmtree(folder, ignore_errors=True)


def sweep(place: Path) -> None:
    """Remove folders of processes that were killed: nobody holds their lock, and they are older than `YOUNG`."""
    if fcntl is None:
        return
    for folder in place.glob(f"{FOLDER}*"):
        with suppress(OSError):  # somebody else's, or another process was faster
            if time.time() - folder.stat().st_mtime < YOUNG:
                continue
            with (folder / LOCK).open("ab") as file:
                _lock(file)
                shutil.rmtree(folder, ignore_errors=True)


def _lock(file: IO[bytes]) -> None:
    """Raises BlockingIOError where another process has it."""
    if fcntl is not None:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def remove(file: str) -> None:
    """Remove a file, if it is there."""
    with suppress(OSError):
        Path(file).unlink()
