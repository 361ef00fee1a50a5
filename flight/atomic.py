"""Files that are written whole or not at all; every file that a command writes goes through here.

What is written goes to a hidden file beside the target, which takes the target's name when it is complete. Whoever
kills the process, or fills the disk, leaves the old file or the new one, and at most that hidden file
(`.NAME.RANDOM.part`, which nothing reads; process numbers repeat where containers share a folder).

`atomic` is for files that the user named: it follows links, as he may have put them there. `write_below` is for names
that a program makes up, in a folder that others may write to: it follows none, whenever it was put there.
"""

import errno
import hashlib
import os
import secrets
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from wrenchgap.flight.errors import UsageError

Identity = tuple[int, int, int, int]
"""Which file it is, and in which state: another one under its name, or a change from elsewhere, differs."""
NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.ENOSYS, errno.EMLINK)
"""What a file system says that has no hard links."""
LONGEST = 100
"""Bytes of a name up to which the hidden one has all of it: with what is added, the least that file systems take."""


@contextmanager
def atomic(path: Path, mode: int = 0o666) -> Iterator[Path]:
    """A temporary name to write to, in the same folder and with the same suffix; renamed to `path` at the end.

    A link is followed: what it points to is replaced, not the link. A file that is replaced keeps its permissions, and
    meanwhile nobody reads the new one whom the old one kept out; a new one has `mode` less the umask. Raises
    UsageError where the file system does not let it be written, and for what is no ordinary file:
    a device or a pipe would be gone.
    """
    target = resolved(path)
    if target.exists() and not target.is_file():
        raise UsageError(f"{path}: is no ordinary file; expected the name of a file to write")
    stem, suffix = _short(target)
    partial = target.with_name(f".{stem}.{secrets.token_hex(8)}.part{suffix}")
    try:
        kept = stat.S_IMODE(target.stat().st_mode) & 0o777 if target.exists() else None
        # not there before, nor a link that somebody else put there to be followed
        os.close(os.open(partial, os.O_CREAT | os.O_EXCL | os.O_WRONLY, mode if kept is None else kept | 0o200))
        yield partial
        flush(partial)
        if kept is not None:
            partial.chmod(kept)
        partial.replace(target)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        with suppress(OSError):  # of a folder that is gone; what was wrong there is said already
            partial.unlink()


def write_text(path: Path, text: str) -> None:
    """Write a text, all of it or nothing; raises as `atomic`."""
    with atomic(path) as partial:
        partial.write_text(text, encoding="utf-8")


def resolved(path: Path) -> Path:
    """The absolute path, with links followed. Raises UsageError for links in a circle, and for what is no name."""
    try:
        return path.resolve()
    except (RuntimeError, OSError):  # which of them depends on Python's version
        raise UsageError(f"{path}: is a link that leads back to itself; remove it") from None
    except ValueError:
        raise UsageError(f"{path}: is no name that a file can have; choose another") from None


def _short(path: Path) -> tuple[str, str]:
    """Stem and suffix of a name, which a hidden name is made of; of a long name so that the file system takes it."""
    if len(os.fsencode(path.name)) <= LONGEST:
        return path.stem, path.suffix
    return hashlib.sha256(os.fsencode(path.name)).hexdigest()[:16], path.suffix if len(path.suffix) <= 16 else ""


def flush(path: Path) -> None:
    """Put a file on the disk before it has its name: after a loss of power that must not stand over an empty file."""
    with path.open("rb+") as stream:
        os.fsync(stream.fileno())


def write_below(
    root: Path, name: str, content: bytes, check: Callable[[Identity], None] = lambda found: None
) -> Identity:
    """Write the file `name` (its parts divided by "/") below the folder `root`, and return which file it is.

    Folders on the way are opened one in the other, and made where they are missing; the hidden file is made and written
    to in the folder that was opened. No link on the way is followed, and what has the name already is replaced only
    where it is an ordinary file, about which `check` raises nothing. Raises UsageError where it cannot be written.
    """
    path = root / name
    if os.open not in os.supports_dir_fd:  # Windows, where only an administrator makes links
        path.parent.mkdir(parents=True, exist_ok=True)
        check_replaceable(path, check)
        with atomic(path) as partial:
            partial.write_bytes(content)
        return identity(path.lstat())
    try:
        with _opened(root, name.split("/")[:-1]) as place:
            return _written(place, path, content, check)
    except FileExistsError:
        raise UsageError(f"{path}: somebody else made it meanwhile; nothing was replaced, try again") from None
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from None


def identity(found: os.stat_result) -> Identity:
    """Of a file."""
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


@contextmanager
def _opened(root: Path, folders: list[str]) -> Iterator[int]:
    """The descriptor of a folder below `root`, by the names of the folders on the way."""
    place = os.open(root, os.O_RDONLY | os.O_DIRECTORY)
    try:
        for k, folder in enumerate(folders):
            with suppress(FileExistsError):
                os.mkdir(folder, dir_fd=place)
            try:
                below = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=place)
            except OSError as error:
                if error.errno not in (errno.ELOOP, errno.ENOTDIR):
                    raise
                where = root.joinpath(*folders[: k + 1])
                raise UsageError(f"{where}: is a link or a file; expected a folder, remove it") from None
            os.close(place)
            place = below
        yield place
    finally:
        os.close(place)


def _written(place: int, path: Path, content: bytes, check: Callable[[Identity], None]) -> Identity:
    """Write the file of this name in the folder `place`; the rest of the path is for messages.

    Raises FileExistsError for a file that came meanwhile.
    """
    before = check_replaceable(path, check, place)
    partial = f".{''.join(_short(path))}.{secrets.token_hex(8)}.part"
    mode = 0o666 if before is None else stat.S_IMODE(before.st_mode) & 0o777 | 0o200
    made = os.open(partial, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_NOFOLLOW, mode, dir_fd=place)
    try:
        with os.fdopen(made, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(made)
            if before is not None:
                os.fchmod(made, stat.S_IMODE(before.st_mode) & 0o777)
            found = identity(os.fstat(made))
        if before is None:
            try:
                os.link(partial, path.name, src_dir_fd=place, dst_dir_fd=place, follow_symlinks=False)
                return found
            except OSError as error:
                if error.errno not in NO_LINKS:
                    raise
        check_replaceable(path, check, place)
        os.rename(partial, path.name, src_dir_fd=place, dst_dir_fd=place)
    finally:
        with suppress(FileNotFoundError):
            os.unlink(partial, dir_fd=place)
    return found


def check_replaceable(path: Path, check: Callable[[Identity], None], place: int | None = None) -> os.stat_result | None:
    """What is at a path, or has its name in the folder `place`; None for nothing. Raises UsageError for what is no
    ordinary file, and what `check` raises.
    """  # noqa: D205
    try:
        found = os.stat(path if place is None else path.name, dir_fd=place, follow_symlinks=False)
    except FileNotFoundError:
        return None
    if not stat.S_ISREG(found.st_mode):
        raise UsageError(f"{path}: is no ordinary file but a link, a folder or a device; choose another name")
    check(identity(found))
    return found


def check_writable(folder: Path, what: str) -> None:
    """Raise UsageError, which begins with `what`, unless a file can be made in a folder: permissions do not tell."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        raise UsageError(f"{what}: the folder {folder} cannot be written to; choose another") from None
