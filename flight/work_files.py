"""Files by which processes that work together hand things to each other, in a folder that goes with its process."""

import atexit
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
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
_locks: dict[str, IO[bytes]] = {}
"""Held by this process, by their folder: threads that ask for the first one at once get two."""


def written(write: Callable[[IO[bytes]], None]) -> str:
    """The name of a new file of this process, with what `write` puts into it."""
    number, name = tempfile.mkstemp(suffix=".pickle", dir=folder())
    with os.fdopen(number, "wb") as file:
        write(file)
    return name


def folder() -> str:
    """Where this process keeps its files, of mode 0700: gone when it ends, and if it was killed, when another begins.

    It holds a lock on a file there for as long as it lives, which the system gives up however a process ends.
    """
    return _folder(os.getpid())


@cache
def _folder(process: int) -> str:
    sweep(Path(tempfile.gettempdir()))
    found = tempfile.mkdtemp(prefix=FOLDER)
    _locks[found] = (Path(found) / LOCK).open("xb")
    lock(_locks[found])
    atexit.register(_leave, found, process)
    return found


def _leave(folder: str, process: int) -> None:
    if os.getpid() == process:  # and not a fork of it, which ends first
        _locks.pop(folder).close()
        shutil.rmtree(folder, ignore_errors=True)


def sweep(place: Path) -> None:
    """Remove folders of processes of this user that were killed: nobody holds their lock, and they are older than
    `YOUNG`. What another user may have prepared in a shared folder under such a name is never entered.
    """  # noqa: D205
    if fcntl is None:
        return
    for found in place.glob(f"{FOLDER}*"):
        with suppress(OSError), _own_folder(found) as number:
            if time.time() - os.fstat(number).st_mtime < YOUNG:
                continue
            with os.fdopen(os.open(LOCK, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=number), "rb+") as file:
                lock(file)
                shutil.rmtree(found, ignore_errors=True)


@contextmanager
def _own_folder(path: Path) -> Iterator[int]:
    """A folder, no link, of this user, to which nobody else has access; raises OSError for any other."""
    number = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        about = os.fstat(number)
        if about.st_uid != os.geteuid() or stat.S_IMODE(about.st_mode) & 0o077:
            raise PermissionError(f"{path}: of somebody else")
        yield number
    finally:
        os.close(number)


def lock(file: IO[bytes]) -> None:
    """Lock a file until it is closed, or this process ends. Raises BlockingIOError where another process has it."""
    if fcntl is not None:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def remove(file: str) -> None:
    """Remove a file, if it is there."""
    with suppress(OSError):
        Path(file).unlink()
