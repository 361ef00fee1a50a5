"""Compiled functions that numba keeps on the disk: what a loss of power, or a full disk, left of them."""

from __future__ import annotations

import traceback
from contextlib import suppress
from pathlib import Path


def removed_kernels(error: BaseException) -> str | None:
    """One line where numba could not read back what it had compiled, whose index is then removed; else None.

    numba compiles again what has no index. Its frames are looked at, as it raises whatever unpickling raises; an
    OSError says by itself what is wrong.
    """
    if isinstance(error, OSError):
        return None
    for frame, _ in traceback.walk_tb(error.__traceback__):
        if frame.f_globals.get("__name__") != "numba.core.caching":
            continue
        if (folder := getattr(frame.f_locals.get("self"), "cache_path", None)) is not None:
            for index in Path(folder).glob("*.nbi"):
                with suppress(OSError):
                    index.unlink()
            return f"{folder}: kernels that were compiled before could not be read and were removed; try again"
    return None
