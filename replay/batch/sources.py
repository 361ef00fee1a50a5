"""Which logs a batch is about: folders, globs, lists and object stores, by the names that fsspec knows."""

import re
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from glob import has_magic
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import quote

from wrenchgap.flight import LogError, UsageError, WrenchgapError, work_files
from wrenchgap.flight.atomic import resolved
from wrenchgap.flight.extras import needed_for
from wrenchgap.flight.formats import content_hash
from wrenchgap.flight.formats.folders import SINGLE, storage
from wrenchgap.plant.reader import text_of

EXTRAS = {"s3": "s3", "s3a": "s3", "gs": "gcs", "gcs": "gcs"}
"""The extra of wrenchgap that reads each kind of address."""
CHAINED = ("reference", "filecache", "simplecache", "blockcache", "cached")
"""Kinds of addresses of fsspec that stand for others."""
ETAGS = ("ETag", "etag", "md5Hash", "content_md5")
"""Names under which object stores tell what identifies a content."""
LONGEST = 255
"""Bytes that file systems take for a name."""
LISTS = (".txt", ".lst")
"""Endings of files with the name of one log in each line."""

PLACE = re.compile(r"vehicle=([^/]+)/date=([^/]+)/([^/.]+)(\.failed)?\.parquet")
"""Of a row, below the folder of its pass: vehicle, date, key, and whether its log failed."""
ROW = re.compile(rf"/rows/pass=\d+/{PLACE.pattern}$")
"""Of a row, which is no log: a batch may write below the folder of its logs."""


@dataclass(frozen=True)
class Source:
    """One log: its `url` (a path, or an address of fsspec), the vehicle that flew it, bytes, and what identifies its
    content where a listing tells (an object store's etag).
    """  # noqa: D205

    url: str
    vehicle: str
    size: int
    etag: str | None = None

    @property
    def name(self) -> str:
        """Of the file."""
        return PurePosixPath(self.url).name


def logs_named(names: Sequence[str], vehicle: str | None = None) -> list[Source]:
    """The logs that these names stand for, each once, in the order of their names.

    The vehicle is `vehicle`, else the folder that a log is in. Raises UsageError where a name stands for no log, or
    what reads it is not installed or lets nobody in.
    """
    out: dict[str, Source] = {}
    for name in names:
        some = [one for one in _expanded(name, vehicle, set()) if not ROW.search(one.url)]
        if not some:
            raise UsageError(
                f"{name}: no logs found; expected .mcap, .bag, .db3, .ulg, .bin, .csv or .parquet files, a folder or "
                "glob of them, or a list (.txt) with one in each line"
            )
        out |= {one.url: one for one in some}
    for one in out.values():
        if len(folder_of(one.vehicle)) > LONGEST:
            raise UsageError(
                f"{one.url}: its vehicle's name is too long for a folder; say a shorter one, --vehicle NAME"
            )
    return sorted(out.values(), key=lambda one: one.url)


def folder_of(vehicle: str) -> str:
    """The name of the folder of a vehicle's rows; a name in another encoding than UTF-8 keeps its bytes."""
    return f"vehicle={quote(vehicle, safe='', errors='surrogateescape')}"


def _expanded(name: str, vehicle: str | None, seen: set[Path]) -> Iterator[Source]:
    """Sources of one name; each of the lists and folders in `seen` is gone through once, whatever names it again."""
    if "://" in name:
        yield from _remote(name, vehicle)
        return
    path = Path(name)
    if path.suffix.lower() in LISTS or path.is_dir():
        if resolved(path) in seen:
            return
        seen.add(resolved(path))
    if path.suffix.lower() in LISTS and path.is_file():
        lines = (line.strip() for line in text_of(path, "as a list of logs", UsageError).splitlines())
        for line in lines:
            if line and not line.startswith("#"):
                yield from _expanded(line, vehicle, seen)
    elif path.is_dir():
        yield from (_local(one, vehicle) for one in _in_folder(path, seen))
    elif path.is_file():  # whatever its name could stand for
        yield _local(path, vehicle)
    elif has_magic(name):
        for one in _matching(path):
            if one.is_dir():
                yield from _expanded(str(one), vehicle, seen)
            elif is_log(one):
                yield _local(one, vehicle)
    else:
        raise UsageError(f"{name}: no such file or folder")


def _matching(pattern: Path) -> list[Path]:
    """What a pattern matches; `**` follows no links, and nothing whose name begins with a dot is found."""
    parts = pattern.parts
    patterns = (k for k, part in enumerate(parts) if has_magic(part) and not Path(*parts[: k + 1]).exists())
    first = next(patterns, len(parts) - 1)
    base = Path(*parts[:first])
    try:
        found = sorted(base.glob(str(Path(*parts[first:]))))
    except ValueError as error:
        raise UsageError(f"{pattern}: {error}; expected one such as logs/**/*.ulg") from None
    return [one for one in found if not any(p.startswith(".") for p in one.relative_to(base).parts)]


def is_log(path: Path | PurePosixPath) -> bool:
    """Whether a file is a log by its ending."""
    return path.suffix.lower() in SINGLE or storage(Path(path)) is not None


def _in_folder(folder: Path, seen: set[Path]) -> Iterator[Path]:
    """Logs of a folder and of all in it; a ROS 2 bag is one. Links may lead to a folder that is in `seen`."""
    if (folder / "metadata.yaml").is_file():
        yield folder
        return
    for one in sorted(folder.iterdir()):
        if one.is_dir() and not one.name.startswith(".") and one.resolve() not in seen:
            seen.add(one.resolve())
            yield from _in_folder(one, seen)
        elif one.is_file() and is_log(one) and not one.name.startswith("."):
            yield one


def _local(path: Path, vehicle: str | None) -> Source:
    path = path.resolve()
    files = [path] if path.is_file() else [p for p in path.iterdir() if p.is_file()]
    return Source(str(path), vehicle or path.parent.name, sum(p.stat().st_size for p in files))


def _remote(name: str, vehicle: str | None) -> Iterator[Source]:
    system, path = opened(name)
    scheme = name.partition("://")[0]
    with reached(name):
        if has_magic(path) and not system.exists(path):
            listed = system.glob(path, detail=True)
        elif system.isdir(path):
            listed = system.find(path, detail=True)
        else:
            listed = {path: system.info(path)}
    for key, about in sorted(listed.items()):
        if about.get("type") == "file" and is_log(PurePosixPath(key)):
            tag = next((str(about[k]).strip('"') for k in ETAGS if about.get(k)), None)
            folder = PurePosixPath(key).parent.name
            yield Source(f"{scheme}://{key.lstrip('/')}", vehicle or folder, int(about.get("size") or 0), tag)


def opened(url: str) -> tuple[Any, str]:
    """The file system of an address, and the path in it; raises UsageError where nothing installed knows it."""
    with needed_for("addresses of logs"):
        from fsspec.core import url_to_fs

    scheme = url.partition("://")[0]
    if "::" in url or scheme in CHAINED:  # file systems in one another, whose index may name any other
        raise UsageError(f"{url}: is no address of one store; expected one such as s3://bucket/folder")
    try:
        with reached(url):
            system, path = url_to_fs(url)
    except ImportError:
        extra = EXTRAS.get(scheme)
        how = f"pip install 'wrenchgap[{extra}]'" if extra else f"install what fsspec needs for {scheme}://"
        raise UsageError(f"{url}: what reads {scheme}:// is not installed; {how}") from None
    return system, str(path)


@contextmanager
def reached(url: str) -> Iterator[None]:
    """What an object store says instead of an answer, in one line."""
    try:
        yield
    except (WrenchgapError, ImportError):
        raise
    except FileNotFoundError:
        raise UsageError(f"{url}: no such file or folder") from None
    except Exception as error:
        kind, said = type(error).__name__, " ".join(str(error).split())
        if isinstance(error, PermissionError) and "://" not in url:
            raise UsageError(f"{url}: no access; choose another folder or change its permissions") from None
        if "credential" in f"{kind} {said}".lower() or isinstance(error, PermissionError):
            raise UsageError(
                f"{url}: no access ({kind}: {said}); check the credentials (environment or profile) of the machines "
                "that read it"
            ) from None
        why = said if isinstance(error, ValueError) else f"{kind}: {said}"
        raise UsageError(f"{url}: cannot be read ({why})") from None


@contextmanager
def at_hand(source: Source) -> Iterator[Path]:
    """The log as a file of this machine; one of an object store is copied, and gone afterwards."""
    if "://" not in source.url:
        yield Path(source.url)
        return
    system, path = opened(source.url)
    with tempfile.TemporaryDirectory(dir=work_files.folder()) as folder:
        copy = Path(folder) / source.name
        try:
            with reached(source.url):
                system.get_file(path, str(copy))
        except UsageError as error:
            raise LogError(str(error)) from None
        yield copy


def identities(sources: Iterable[Source]) -> list[str]:
    """The SHA-256 of each content; of one that cannot be read its address: who works on it finds the reason."""
    out = []
    for one in sources:
        try:
            with at_hand(one) as path:
                out.append(f"sha256:{content_hash(path)}")
        except (WrenchgapError, OSError):
            out.append(f"unread:{one.url}:{one.size}")
    return out
