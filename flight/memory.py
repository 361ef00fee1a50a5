"""Memory of hours of log: what the C library keeps when it is free, and arrays that wait on disk.

Columns of less than 32 MB come from glibc's heap, and go back to the machine only from its end: after ten hours at
100 Hz, columns of 29 MB, half a gigabyte stayed (mallopt(3), M_MMAP_THRESHOLD; malloc_trim(3)).

Of a flight of hours, arrays are kept in temporary files without a name, mapped into memory (`on_disk`), and so is what
a search of several minutes asks for now and then. What is worked on becomes resident like any other memory; `give_back`
and `let_go` take it out of the process again, and the numbers stay in the file (madvise(2), MADV_DONTNEED of a shared
mapping). The kernel may hold the file's pages in its cache for as long as nobody else wants that memory.
"""

import ctypes
import mmap
import os
import sys
import tempfile
import weakref
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

HOURS = 1 << 20
"""Samples of a series from which on it is asked for: three hours at 100 Hz."""
SMALL = 1 << 18
"""Bytes below which an array is not worth a file."""
RESIDENT = 128
"""Pieces of `SMALL` bytes of a copy that are resident at most."""

_mapped: weakref.WeakSet[mmap.mmap] = weakref.WeakSet()


def give_back(samples: int) -> None:
    """Return memory to the machine after work on a series of so many samples: what is free, and what is on disk.

    Does nothing for shorter series, and nothing of the first where there is no glibc.
    """
    if samples < HOURS or not sys.platform.startswith("linux"):
        return
    for mapped in tuple(_mapped):
        mapped.madvise(mmap.MADV_DONTNEED)
    trim()


def trim() -> None:
    """Return to the machine what the C library keeps although it is free; nothing where it is not glibc."""
    returned = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform.startswith("linux") else None
    if returned is not None:
        returned(0)


def on_disk(values: NDArray[Any], least: int | None = None) -> NDArray[Any]:
    """The same numbers in a file that is mapped into memory; `values` themselves where few, or where no disk has room.

    Arrays of fewer rows than `least` (`HOURS`) stay where they are. The order in memory is C.
    """
    few = len(values) < (HOURS if least is None else least)
    if few or values.nbytes < SMALL or not sys.platform.startswith("linux") or _is_mapped(values):
        return values
    mapped = _file(values.nbytes)
    if mapped is None:
        return values
    out = np.frombuffer(mapped, dtype=values.dtype).reshape(values.shape)
    rows = max(1, SMALL // max(values[:1].nbytes, 1))
    for number, start in enumerate(range(0, len(values), rows)):
        out[start : start + rows] = values[start : start + rows]
        if number % RESIDENT == RESIDENT - 1:  # so that what is copied is not resident twice
            mapped.madvise(mmap.MADV_DONTNEED)
    mapped.madvise(mmap.MADV_DONTNEED)
    return out


def empty_on_disk(shape: tuple[int, ...], dtype: DTypeLike = float, least: int | None = None) -> NDArray[Any]:
    """An array to be filled, whose numbers are any: as `on_disk`, where that would put it in a file."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    few = shape[0] < (HOURS if least is None else least)
    small = few or size < SMALL or np.dtype(dtype).hasobject or not sys.platform.startswith("linux")
    mapped = None if small else _file(size)
    return np.empty(shape, dtype) if mapped is None else np.frombuffer(mapped, dtype=dtype).reshape(shape)


def let_go(values: NDArray[Any]) -> None:
    """Take an array that is on disk, and what it is a view of, out of memory until it is read again."""
    mapped = _mapping(values)
    if mapped is not None:
        mapped.madvise(mmap.MADV_DONTNEED)


def _is_mapped(values: NDArray[Any]) -> bool:
    """Whether an array is, or is a view of, one that is on disk already."""
    return _mapping(values) is not None


def _mapping(values: NDArray[Any]) -> mmap.mmap | None:
    base: Any = values
    while isinstance(base, np.ndarray):
        base = base.base
    base = base.obj if isinstance(base, memoryview) else base
    return base if isinstance(base, mmap.mmap) else None


def _file(size: int) -> mmap.mmap | None:
    """A mapped file of `size` bytes that vanishes with the process; None where there is no room for it.

    /var/tmp before the usual place, which is often memory itself.
    """
    for folder in _folders():
        try:
            with tempfile.TemporaryFile(dir=folder, prefix="wrenchgap-") as partial:
                os.posix_fallocate(partial.fileno(), 0, size)  # a full disk says so here, and kills nobody later
                mapped = mmap.mmap(partial.fileno(), size)
                _mapped.add(mapped)
                return mapped
        except OSError:
            continue
    return None


def _folders() -> Iterable[str]:
    chosen = os.environ.get("TMPDIR")
    return [chosen] if chosen else [str(p) for p in (Path("/var/tmp"), Path(tempfile.gettempdir())) if p.is_dir()]
