"""Rows of a batch as a Parquet dataset: one file a log, written whole when the log is done, named by its key.

    OUTPUT/run.json                                            what the rows were made by
    OUTPUT/rows/pass=1/vehicle=alpha/date=2026-11-22/KEY.parquet          a log that is done
    OUTPUT/rows/pass=1/vehicle=alpha/date=unknown/KEY.failed.parquet      a log that failed, with its reason

What is done is known from names alone, without opening a file; a folder of a file system and a prefix of an object
store are the same to it (fsspec).
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import PurePosixPath
from typing import Any
from urllib.parse import quote, unquote

import pyarrow as pa
import pyarrow.parquet as pq

from wrenchgap._escaping import storable
from wrenchgap.flight.errors import UsageError
from wrenchgap.replay.batch.sources import opened, reached

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
EPOCH = 10**18
"""Start of a log [ns] before which its clock is no calendar (September 2001)."""
FAILED = ".failed"


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

    def claim(self, identity: Mapping[str, Any]) -> bool:
        """Begin a run here or go on with it (True); raises UsageError where something else is here."""
        system, root = self._at
        with reached(self.url):
            if system.exists(f"{root}/run.json"):
                other = self._differs(identity)
                if other is not None:
                    raise UsageError(f"--output {self.url}: holds another run ({other}); choose another folder")
                return True
            if system.exists(root) and system.ls(root, detail=False):
                raise UsageError(f"--output {self.url}: is not empty and holds no run; choose another folder")
            self._write(f"{root}/run.json", json.dumps(dict(identity), indent=1).encode())
        return False

    def _differs(self, identity: Mapping[str, Any]) -> str | None:
        here = self.identity()
        for name, value in json.loads(json.dumps(dict(identity))).items():
            if here.get(name) != value:
                return f"its {name}: {_short(here.get(name))}, now {_short(value)}"
        return None

    def identity(self) -> dict[str, Any]:
        """What the rows were made by; raises UsageError where no run is here."""
        system, root = self._at
        try:
            with reached(self.url), system.open(f"{root}/run.json", "rb") as stream:
                found = json.loads(stream.read())
        except ValueError:
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
        names = [(p, PurePosixPath(p).name) for p in paths if p.endswith(".parquet")]
        out = {}
        for path, name in names:
            key = name.partition(".")[0]
            if key:
                out[key] = Done(key, FAILED in name, path)
        return out

    def add(self, row: Mapping[str, Any], vehicle: str, number: int = 1) -> None:
        """Write one row, all of it or nothing."""
        _, root = self._at
        start = row.get("start_ns")
        date = "unknown"
        if start is not None and start > EPOCH:
            date = datetime.fromtimestamp(start * 1e-9, UTC).strftime("%Y-%m-%d")
        name = f"{row['key']}{FAILED if row['status'] == 'failed' else ''}.parquet"
        path = f"{root}/rows/pass={number}/vehicle={quote(vehicle, safe='')}/date={date}/{name}"
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
        system, _ = self._at
        system.makedirs(path.rpartition("/")[0], exist_ok=True)
        if "file" not in (system.protocol if isinstance(system.protocol, tuple) else (system.protocol,)):
            system.pipe_file(path, content)
            return
        folder, _, name = path.rpartition("/")
        partial = f"{folder}/.{name}.{os.getpid()}.part"
        with system.open(partial, "wb") as stream:
            stream.write(content)
        os.replace(partial, path)  # noqa: PTH105

    def rows(self, number: int = 1, columns: Sequence[str] | None = None) -> list[dict[str, Any]]:
        """Rows of a pass without their heavy columns, with `vehicle` and `date`, in the order of the logs' names."""
        wanted = list(columns or (c for c in SCHEMA.names if c not in HEAVY))
        out = [{**self._read(one.path, wanted)[0], **_folders(one.path)} for one in self.done(number).values()]
        return sorted(out, key=lambda row: (row["vehicle"], row.get("log") or "", row.get("key") or ""))

    def _read(self, path: str, columns: Sequence[str]) -> list[dict[str, Any]]:
        system, _ = self._at
        with system.open(path, "rb") as stream:
            found: list[dict[str, Any]] = pq.read_table(stream, columns=list(columns), schema=SCHEMA).to_pylist()
        return found

    def evidence(self, keys: Sequence[str], number: int = 1) -> Iterator[bytes]:
        """The evidence of these rows, one after the other."""
        done = self.done(number)
        for key in keys:
            yield self._read(done[key].path, ["evidence"])[0]["evidence"]


def _folders(path: str) -> dict[str, str]:
    parts = (p.partition("=") for p in PurePosixPath(path).parts if "=" in p)
    return {name: unquote(value) for name, _, value in parts if name in ("vehicle", "date")}


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
