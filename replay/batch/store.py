"""Rows of a batch as a Parquet dataset: one file a log, written whole when the log is done, named by its key.

    OUTPUT/run.json                                            what the rows were made by
    OUTPUT/rows/pass=1/vehicle=alpha/date=2026-11-22/KEY.parquet          a log that is done
    OUTPUT/rows/pass=1/vehicle=alpha/date=unknown/KEY.failed.parquet      a log that failed, with its reason

What is done is known from names alone, without opening a file; a folder of a file system and a prefix of an object
store are the same to it (fsspec).
"""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Annotated, Any
from urllib.parse import unquote

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import Field

from wrenchgap._escaping import storable
from wrenchgap.flight import FitError, Flight, UsageError
from wrenchgap.flight.atomic import write_below
from wrenchgap.flight.budget import default_memory
from wrenchgap.flight.work_files import lock
from wrenchgap.learn.identify.trend import DATED, FlightValues, FollowedFlight
from wrenchgap.learn.posterior.flight_evidence import unpacked
from wrenchgap.plant.reader import Name, Names, NotNegative, Number, Positive, Table, Text, expected, quoted, read
from wrenchgap.replay.batch.sources import PLACE, folder_of, opened, reached
from wrenchgap.replay.present.numbers import entries

SCHEMA = pa.schema(
    [
        *((name, pa.string()) for name in ("key", "log", "flight", "content", "status", "reason", "command")),
        *((name, pa.string()) for name in ("version", "model", "model_sha256", "finished", "host")),
        *((name, pa.int64()) for name in ("start_ns", "bytes")),
        *((name, pa.float64()) for name in ("seconds", "wall_s", "cpu_s", "peak_mb")),
        ("verdict", pa.string()),
        *((name, pa.list_(pa.float64())) for name in ("rms", "rms_nominal", "noise")),
        ("result", pa.string()),
        ("fit", pa.string()),
        ("evidence", pa.binary()),
    ]
)
"""Columns of a row; `vehicle`, `date` and `pass` are folders. docs/batch.md says what they mean."""
HEAVY = ("result", "evidence")
"""Columns that a list of rows goes without."""
FAILED = ".failed"
ALWAYS = ("key", "log", "status")
"""Columns that every row fills."""
LONGEST_RUN = 2**22
"""Bytes of run.json: the text of a model for each vehicle is some 10 kB."""


@dataclass(frozen=True)
class Done:
    """A row by its name alone."""

    key: str
    failed: bool
    path: str


@dataclass(frozen=True)
class Store:
    """A batch's output: a folder, or an address of fsspec."""

    url: str

    @cached_property
    def _at(self) -> tuple[Any, str]:
        return opened(self.url if "://" in self.url else os.path.abspath(self.url))  # noqa: PTH100

    def claim(self, identity: Mapping[str, Any]) -> None:
        """Begin a run here or go on with it; raises UsageError where something else is here."""
        system, root = self._at
        with reached(self.url):
            if system.exists(f"{root}/run.json"):
                here = self.identity()
                for name, value in json.loads(json.dumps(dict(identity))).items():
                    if here.get(name) != value:
                        other = f"its {name}: {_cut(json.dumps(here.get(name)))}, now {_cut(json.dumps(value))}"
                        raise UsageError(f"--output {self.url}: holds another run ({other}); choose another folder")
                return
            if system.exists(root) and system.ls(root, detail=False):
                raise UsageError(f"--output {self.url}: is not empty and holds no run; choose another folder")
            self._write(f"{root}/run.json", json.dumps(dict(identity), indent=1).encode())

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Keep others from writing to this run meanwhile; raises UsageError where somebody does. Not in object stores.

        The lock is the system's, on run.json: it goes with the process, however that ends.
        """
        if not self._local:
            yield
            return
        _, root = self._at
        with os.fdopen(os.open(f"{root}/run.json", os.O_RDONLY | os.O_NOFOLLOW), "rb") as file:
            try:
                lock(file)
            except BlockingIOError:
                raise UsageError(
                    f"--output {self.url}: another `wrenchgap batch` writes there now; run the same command when it "
                    "has ended, or choose another folder"
                ) from None
            except OSError:  # a file system without locks
                pass
            yield

    @property
    def _local(self) -> bool:
        """Whether it is a folder of a file system, and no object store."""
        system, _ = self._at
        return "file" in (system.protocol if isinstance(system.protocol, tuple) else (system.protocol,))

    def identity(self) -> dict[str, Any]:
        """What the rows were made by; raises UsageError where no run is here."""
        system, root = self._at
        try:
            with reached(self.url):
                _check_file(system, f"{root}/run.json", LONGEST_RUN)
                with system.open(f"{root}/run.json", "rb") as stream:
                    content = stream.read()
            found = json.loads(content)
        except (ValueError, RecursionError):
            raise UsageError(f"{self.url}: run.json cannot be read; expected the output of `wrenchgap batch`") from None
        if not isinstance(found, dict) or "command" not in found:
            raise UsageError(f"{self.url}: run.json is not that of `wrenchgap batch`")
        return found

    def done(self, number: int = 1) -> dict[str, Done]:
        """Rows of a pass by key, from their names."""
        system, root = self._at
        system.invalidate_cache()
        try:
            paths = system.find(f"{root}/rows/pass={number}")
        except FileNotFoundError:
            return {}
        out = {}
        for path in paths:
            name = PurePosixPath(path).name
            key = name.partition(".")[0]
            if key and name.endswith(".parquet"):  # the hidden file of a write that was killed has none
                out[key] = Done(key, FAILED in name, path)
        return out

    def add(self, row: Mapping[str, Any], vehicle: str, number: int = 1) -> None:
        """Write one row, all of it or nothing."""
        _, root = self._at
        start = row.get("start_ns")
        date = "unknown"
        if start is not None and start > DATED:
            date = datetime.fromtimestamp(start * 1e-9, UTC).strftime("%Y-%m-%d")
        name = f"{row['key']}{FAILED if row['status'] == 'failed' else ''}.parquet"
        path = f"{root}/rows/pass={number}/{folder_of(vehicle)}/date={date}/{name}"
        cells = {c: storable(v) if isinstance(v := row.get(c), str) else v for c in SCHEMA.names}
        table = pa.Table.from_pylist([cells], schema=SCHEMA)
        sink = pa.BufferOutputStream()
        pq.write_table(table, sink, compression="zstd")
        self._write(path, sink.getvalue().to_pybytes())

    def drop(self, rows: Sequence[Done]) -> None:
        """Take rows out, so that their logs are done again."""
        system, _ = self._at
        for one in rows:
            system.rm_file(one.path)

    def _write(self, path: str, content: bytes) -> None:
        """An object of a store appears when it is whole; a file of a folder gets its name when it is."""
        system, root = self._at
        if self._local:
            Path(root).mkdir(parents=True, exist_ok=True)
            write_below(Path(root), path.removeprefix(f"{root}/"), content)
        else:
            system.makedirs(path.rpartition("/")[0], exist_ok=True)
            system.pipe_file(path, content)

    def rows(self, number: int = 1, columns: Sequence[str] | None = None) -> list[dict[str, Any]]:
        """Rows of a pass without their heavy columns, with `vehicle` and `date`, in the order of the logs' names.

        Raises UsageError for a row that is none; see `unreadable`.
        """
        wanted = list(columns or (c for c in SCHEMA.names if c not in HEAVY))
        out = [self._read(one.path, number, wanted) for one in self.done(number).values()]
        return sorted(out, key=lambda row: (row["vehicle"], row["log"], row["key"]))

    def unreadable(self, rows: Sequence[Done], number: int = 1) -> list[Done]:
        """Those of these rows that are none: damaged, or put there by something else."""
        out = []
        for one in rows:
            try:
                row = self._read(one.path, number, SCHEMA.names)
                if row["evidence"] is not None:
                    unpacked(row["evidence"])
                if row["fit"] is not None:
                    from_fit_json(row["fit"], one.path)
            except (UsageError, FitError):
                out.append(one)
        return out

    def _read(self, path: str, number: int, columns: Sequence[str]) -> dict[str, Any]:
        """The one reader of rows: these columns and those of `ALWAYS`, with `vehicle` and `date`, checked."""
        system, root = self._at
        place = PLACE.fullmatch(path.removeprefix(f"{root}/rows/pass={number}/"))
        try:
            if place is None:
                raise ValueError("expected rows/pass=1/vehicle=NAME/date=DATE/KEY.parquet")
            _check_file(system, path)
            with system.open(path, "rb") as stream:
                row = _only_row(stream, list(dict.fromkeys([*ALWAYS, *columns])))
            if row["key"] != place[3] or row["status"] != ("failed" if place[4] else "ok"):
                raise ValueError(f"its name and what it says differ: key {row['key']}, status {row['status']}")
        except (pa.ArrowException, ValueError, OSError, MemoryError) as error:
            said = " ".join(str(error).split()) or type(error).__name__
            raise UsageError(
                f"{path}: is no row of a batch, or a damaged one ({_cut(said)}); to do its log again, run the same "
                "`wrenchgap batch` with --again"
            ) from None
        return {**row, "vehicle": unquote(place[1], errors="surrogateescape"), "date": unquote(place[2])}

    def evidence(self, keys: Sequence[str], number: int = 1) -> Iterator[tuple[str, bytes | None]]:
        """Path and evidence of these rows, one after the other."""
        done = self.done(number)
        for key in keys:
            yield done[key].path, self._read(done[key].path, number, ["evidence"])["evidence"]


def _check_file(system: Any, path: str, most: int | None = None) -> None:
    """Raise ValueError for what is no ordinary file: a pipe or a device would be read without end."""
    about = system.info(path)
    if about["type"] != "file" or about.get("islink"):
        raise ValueError(f"{PurePosixPath(path).name} is no ordinary file but a link, a folder, a pipe or a device")
    if most is not None and (about.get("size") or 0) > most:
        raise ValueError(f"{PurePosixPath(path).name} has {about['size']:,} bytes")


def _only_row(stream: Any, columns: list[str], most_values: int = 10_000) -> dict[str, Any]:
    """The row of a Parquet file that has one. Raises ValueError or pyarrow's errors for any other, and for one of more
    than so many values: lists of a row are a few hundred long, and a few bytes may stand for millions.
    """  # noqa: D205
    with pq.ParquetFile(stream, pre_buffer=False) as file:  # no threads, which may outlive an error
        about = file.metadata
        groups = [about.row_group(i) for i in range(about.num_row_groups)]
        unfolded = sum(group.total_byte_size for group in groups)
        values = sum(group.column(i).num_values for group in groups for i in range(group.num_columns))
        if about.num_rows != 1 or unfolded > default_memory(0) or values > most_values:
            raise ValueError(f"{about.num_rows} rows of {unfolded:,} bytes and {values:,} values")
        if not file.schema_arrow.equals(SCHEMA):
            raise ValueError("other columns than those of docs/batch.md")
        found: list[dict[str, Any]] = file.read(columns=columns, use_threads=False).to_pylist()
    if len(found) != 1 or any(found[0][name] is None for name in ALWAYS):
        raise ValueError(f"{len(found)} rows, or one without {', '.join(ALWAYS)}")
    return found[0]


def _cut(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:77]}..."


OrNull = NotNegative | None
SixOrNull = Annotated[tuple[OrNull, OrNull, OrNull, OrNull, OrNull, OrNull], expected("six numbers or null")]
Time = Annotated[int, Field(strict=True, ge=-(2**63), lt=2**63), expected("a time in nanoseconds")]


class StoredFit(Table):
    """What one flight says alone, for `trend` (docs/batch.md): the keys, and what each may be; null is not known."""

    effects: Annotated[tuple[Name, ...], Field(min_length=1), expected("a list of effects")]
    theta: Annotated[tuple[Number, ...], expected("a list of finite numbers, of a size up to 1e12")]
    std: Annotated[tuple[OrNull, ...], expected("a list of numbers that are not negative, or null")]
    at_bound: Names
    left: SixOrNull
    name: Text
    file: Text
    sha256: Text
    start_ns: Time
    noise: SixOrNull
    cutoff_hz: Positive
    signature: Annotated[tuple[int, ...], expected("a list of whole numbers")] = ()
    span: tuple[Time, Time] | None = None


def fit_json(found: FlightValues, one: FollowedFlight) -> dict[str, Any]:
    """The values of a flight, and what identifies it."""
    values = entries(found, "effects", "theta", "std", "at_bound", "left")
    values |= entries(one, "noise", "cutoff_hz", "signature", "span")
    about = {"name": one.flight.name, "file": one.flight.path.name, "sha256": one.flight.content_hash}
    return {**values, **about, "start_ns": one.flight.start_ns}


def from_fit_json(text: str, where: str) -> tuple[FollowedFlight, FlightValues]:
    """Back from `fit_json`; raises UsageError, which begins with `where`, for anything else."""
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{where}: is no JSON ({quoted(str(error))}); expected what `batch compare` wrote") from None
    body = read(StoredFit, values, where=where, error=UsageError)
    flight = Flight(body.name, Path(body.file), body.sha256, body.start_ns)
    theta, std, left, noise = (np.array(v, dtype=float) for v in (body.theta, body.std, body.left, body.noise))
    found = FlightValues(body.effects, theta, std, body.at_bound, left)
    span = body.span or (body.start_ns, body.start_ns)
    return FollowedFlight(flight, (), noise, body.cutoff_hz, body.signature, span), found
