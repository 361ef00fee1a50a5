"""What libraries meet outside of a command: compiled functions on the disk, settings in the environment."""

from __future__ import annotations

import os
import traceback
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

SETTINGS = {"dask": "DASK_", "distributed": "DASK_", "numba": "NUMBA_", "matplotlib": "MPL"}
"""How the names of variables begin that a library obeys."""


def refused_setting(error: BaseException) -> str | None:
    """One line where a library failed that variables of the environment change, naming them; else None."""
    passed = {
        str(frame.f_globals.get("__name__")).partition(".")[0] for frame, _ in traceback.walk_tb(error.__traceback__)
    }
    for library in sorted(passed & SETTINGS.keys()):
        if found := [f"{name}={value}" for name, value in os.environ.items() if name.startswith(SETTINGS[library])]:
            said = (str(error).splitlines() or [""])[0] or type(error).__name__
            return (
                f"{library} failed where {', '.join(found)} is set in the environment ({said}); unset it and try again"
            )
    return None


def removed_kernels(error: BaseException) -> str | None:
    """One line where numba could not read back what it had compiled, whose indices are then all removed; else None.

    numba compiles again what has no index. Its frames are looked at, as it raises whatever unpickling raises; an
    OSError says by itself what is wrong.
    """
    if isinstance(error, OSError):
        return None
    for frame, _ in traceback.walk_tb(error.__traceback__):
        if frame.f_globals.get("__name__") != "numba.core.caching":
            continue
        if (folder := getattr(frame.f_locals.get("self"), "cache_path", None)) is not None:
            for index in _indices(Path(folder)):
                with suppress(OSError):
                    index.unlink()
            return f"{folder}: kernels that were compiled before could not be read and were removed; try again"
    return None


def _indices(folder: Path) -> Iterator[Path]:
    """Those in this folder and in all others of our modules, beside them or in numba's cache; not other projects'."""
    ours = [Path(place) for place, _, _ in os.walk(Path(__file__).parent, followlinks=True)]
    if folder.name != "__pycache__":  # numba names a folder by the last name of that of the module, and a hash
        names = {place.name for place in ours}
        ours = [place for place in folder.parent.iterdir() if place.name.rpartition("_")[0] in names]
    return (index for place in (folder, *ours) for index in place.glob("*.nbi"))
