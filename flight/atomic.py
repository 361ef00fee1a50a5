"""Files that are written whole or not at all; every file that a command writes goes through here.

What is written goes to a hidden file beside the target, which takes the target's name when it is complete. Whoever
kills the process, or fills the disk, leaves the old file or the new one, and at most that hidden file
(`.NAME.PID.part`, which nothing reads).
"""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wrenchgap.flight.errors import UsageError


@contextmanager
def atomic(path: Path, mode: int = 0o666) -> Iterator[Path]:
    """A temporary name to write to, in the same folder and with the same suffix; renamed to `path` at the end.

    A link is followed: what it points to is replaced, not the link. A file that is replaced keeps its permissions, and
    meanwhile nobody reads the new one whom the old one kept out; a new one has `mode` less the umask. Raises
    UsageError where the file system does not let it be written, and for what is no ordinary file:
    a device or a pipe would be gone.
    """
    target = path.resolve()
    if target.exists() and not target.is_file():
        raise UsageError(f"{path}: is no ordinary file; expected the name of a file to write")
    partial = target.with_name(f".{target.stem}.{os.getpid()}.part{target.suffix}")
    try:
        kept = stat.S_IMODE(target.stat().st_mode) & 0o777 if target.exists() else None
        _create(partial, mode if kept is None else kept | 0o200)
        yield partial
        with partial.open("rb+") as stream:  # after a loss of power a name must not stand over an empty file
            os.fsync(stream.fileno())
        if kept is not None:
            partial.chmod(kept)
        partial.replace(target)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        partial.unlink(missing_ok=True)


def _create(path: Path, mode: int) -> None:
    """An empty file that was not there, nor a link that somebody else put there to be followed."""
    path.unlink(missing_ok=True)  # of a process of the same number that was killed
    os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, mode))


def check_writable(folder: Path, what: str) -> None:
    """Raise UsageError, which begins with `what`, unless a file can be made in a folder: permissions do not tell."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        raise UsageError(f"{what}: the folder {folder} cannot be written to; choose another") from None
