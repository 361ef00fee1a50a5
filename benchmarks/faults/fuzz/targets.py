"""What is fuzzed: bytes in; a value, or an error in one line."""

from __future__ import annotations

import io
import os
import resource
import tempfile
import time
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.faults.opening import LONGEST, opened

Target = Callable[[bytes], None]


MEGABYTES, SECONDS = 1500.0, 40.0
"""Of one execution: what the default budget of a file of 16 kB allows, with copies and an instrumented interpreter."""


class AppetiteError(Exception):
    """An execution that takes more memory or processor time than a small file may."""


def _used() -> tuple[float, float]:
    """Peak memory of this process so far [MB], and the processor time of this thread [s]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, time.thread_time()


class SeveralLinesError(Exception):
    """A refusal that is not one line."""


@cache
def _folder() -> Path:
    """One of this process, in memory where the machine has such a place."""
    memory = Path("/dev/shm")
    return Path(tempfile.mkdtemp(prefix=f"wrenchgap-fuzz-{os.getpid()}-", dir=memory if memory.is_dir() else None))


def _opened(kind: str, name: str, data: bytes) -> None:
    from wrenchgap.flight.errors import WrenchgapError

    path = _folder() / name
    path.write_bytes(data)
    memory, seconds = _used()
    try:
        opened(kind, path)
    except WrenchgapError as error:
        text = str(error)
        if not text or "\n" in text or len(text) > LONGEST:
            raise SeveralLinesError(repr(text[:300])) from None
    except OSError as error:
        if error.filename is None:
            raise
    more, took = (after - before for after, before in zip(_used(), (memory, seconds), strict=True))
    if more > MEGABYTES or took > SECONDS:
        raise AppetiteError(f"{len(data)} bytes took {more:.0f} MB and {took:.0f} s")


def log(data: bytes) -> None:
    """A log of any format; the first bytes say which."""
    _opened("log", "log.any", data)


def model(data: bytes) -> None:
    """A model file."""
    _opened("model", "model.toml", data)


def trajectory(data: bytes) -> None:
    """A trajectory file."""
    _opened("trajectory", "trajectory.toml", data)


def process(data: bytes) -> None:
    """A stored GP: the first byte says which part has the rest for its content, 255 the whole file."""
    if not data:
        return
    if data[0] == 255:
        _opened("gp", "process.gp", data[1:])
        return
    parts = dict(_parts())
    name = sorted(parts)[data[0] % len(parts)]
    parts[name] = data[1:]
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w") as archive:
        for key, content in parts.items():
            archive.writestr(zipfile.ZipInfo(key), content)
    _opened("gp", "process.gp", whole.getvalue())


@cache
def _parts() -> dict[str, bytes]:
    from benchmarks.faults.valid import FORMS

    with zipfile.ZipFile(FORMS["gp"](_folder())) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def definition(data: bytes) -> None:
    """A message definition and messages of it: what a log brings with it and is read by."""
    from wrenchgap.flight.formats.decode import Decoder, UndecodableError, definitions_of, flat_fields
    from wrenchgap.flight.formats.reader import Channel

    head, _, load = data.partition(b"\x00\x00")
    flags = head[0] if head else 0
    encoding, form = ("cdr", "ros1")[flags & 1], ("msg", "idl")[flags >> 1 & 1]
    channel = Channel("/x", "lab_msgs/msg/Thing", encoding, head[1:].decode(errors="replace"), form)
    try:
        definitions = definitions_of(channel)
        flat_fields(channel.type, definitions)
        decoder = Decoder(channel, definitions)
        decoder.add([load, load, load[: len(load) // 2], bytes(len(load))])
        for values in decoder.columns().values():
            np.asarray(values)
    except UndecodableError:
        return


TARGETS: dict[str, Target] = {
    "log": log,
    "compiled": log,
    "definition": definition,
    "model": model,
    "process": process,
    "trajectory": trajectory,
}
"""By name; `compiled` is `log` with compiled kernels (`child`)."""
