"""Flights that were read once, kept in the user's cache folder, so that a long log opens at once the next time.

A kept flight is found again by what it was made of: the log's content, the mapping of topics, and the source of this
package; whoever changes any of them reads the log anew. A file is arrays and JSON in a zip; loading it runs no code.
What cannot be written or read is not kept, and that is all that happens. Nobody else reads what
is kept: the log may be private.
"""

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from platformdirs import user_cache_path

from wrenchgap.flight.atomic import atomic
from wrenchgap.flight.autopilot import Autopilot, ParameterChange
from wrenchgap.flight.budget import LIMITS, Budget
from wrenchgap.flight.check import Check, TimeLeftOut
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import SERIES, Flight, Gap
from wrenchgap.flight.formats import content_hash
from wrenchgap.flight.load import load as read


def folder() -> Path:
    """Where flights are kept: the user's cache folder on this platform, e.g. ~/.cache/wrenchgap on Linux."""
    return user_cache_path("wrenchgap", appauthor=False)


def load(
    path: str | Path,
    topics: Mapping[str, str] | None = None,
    preferred: Mapping[str, str] | None = None,
    unmeasured: Sequence[str] = (),
    budget: Budget | str | None = None,
) -> Flight:
    """As `flight.load`, from the cache where the flight is there, else from the log, and then it is kept."""
    path = Path(path)
    digest = content_hash(path)
    said = [dict(topics or {}), dict(preferred or {}), list(unmeasured)]
    asked = json.dumps([digest, *said, path.name, _source()], sort_keys=True)
    file = folder() / f"{hashlib.sha256(asked.encode()).hexdigest()[:32]}.npz"
    try:
        _make_private(file.parent)
        found = _unpacked(file, path)
        file.touch()
    except Exception:  # whatever is wrong with what was kept, the log itself is there
        found = read(path, topics, preferred, unmeasured, budget)
        if found.content_hash == digest:  # else another log took its name meanwhile, or it grew
            _keep(found, file)
    return found


def _keep(found: Flight, file: Path) -> None:
    """Write a flight, whole or not at all, and make room for it."""
    try:
        _make_private(file.parent)
        file.unlink(missing_ok=True)  # also a link, or a file that others may read: `atomic` would keep both
        with atomic(file, 0o600) as partial, partial.open("wb") as stream:
            np.savez(stream, **_packed(found))
        left = LIMITS.kept_flights
        for old in sorted(file.parent.glob("*.npz"), key=lambda p: p.stat().st_mtime, reverse=True):
            left -= old.stat().st_size
            if left < 0 and old != file:
                old.unlink()
    except (OSError, UsageError):
        return


def _make_private(folder: Path) -> None:
    """A folder that is ours and that nobody else enters; raises OSError for a link and a folder of another user."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if os.name == "posix":  # elsewhere the user's folders are private already
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        try:
            if os.fstat(descriptor).st_uid != os.geteuid():
                raise PermissionError(f"{folder}: is of another user")
            os.fchmod(descriptor, 0o700)
        finally:
            os.close(descriptor)


def _packed(found: Flight) -> dict[str, Any]:
    arrays: dict[str, Any] = {}
    roles: dict[str, Any] = {}
    for role, series in found.series().items():
        own = {item.name: getattr(series, item.name) for item in fields(series)}
        arrays |= {f"{role}.{name}": value for name, value in own.items() if isinstance(value, np.ndarray)}
        roles[role] = {name: own[name] for name in ("topic", "gaps", "dropped", "unit") if name in own}
    about = {name: getattr(found, name) for name in ("name", "content_hash", "start_ns", "mapping", "notes", "damage")}
    about |= {
        name: getattr(found, name)
        for name in ("unmeasured", "checks", "left_out", "autopilot", "command_option", "firmware")
    }
    text = json.dumps(about | {"roles": roles}, default=asdict)
    return {**arrays, "about": np.frombuffer(text.encode(), dtype=np.uint8)}


def _unpacked(file: Path, path: Path) -> Flight:
    if not file.is_file():  # a pipe would be waited for
        raise FileNotFoundError(file)
    with np.load(file, allow_pickle=False) as archive:
        known = json.loads(archive["about"].tobytes())
        for role, said in known.pop("roles").items():
            values = {name.partition(".")[2]: archive[name] for name in archive.files if name.startswith(f"{role}.")}
            said["gaps"] = tuple(Gap(**gap) for gap in said["gaps"])
            known[role] = SERIES[role](**said, **values)
    known |= {name: tuple(known[name]) for name in ("notes", "damage")}
    known["checks"] = None if known["checks"] is None else tuple(Check(**one) for one in known["checks"])
    known["left_out"] = tuple(TimeLeftOut(**one) for one in known["left_out"])
    if (autopilot := known["autopilot"]) is not None:
        changes = tuple(ParameterChange(**one) for one in autopilot.pop("changes"))
        known["autopilot"] = Autopilot(**autopilot, changes=changes)
    return Flight(path=path, **known)


@lru_cache(maxsize=1)
def _source() -> str:
    """Hash of this package's source."""
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()
