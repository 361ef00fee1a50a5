"""Memory of hours of log that the C library keeps when it is free.

Columns of less than 32 MB come from glibc's heap, and go back to the machine only from its end: after ten hours at
100 Hz, columns of 29 MB, half a gigabyte stayed (mallopt(3), M_MMAP_THRESHOLD; malloc_trim(3)).
"""

from __future__ import annotations

import ctypes
import sys

HOURS = 1 << 20
"""Samples of a series from which on it is asked for: three hours at 100 Hz."""


def give_back(samples: int) -> None:
    """Return free memory to the machine after work on a series of so many samples; nothing where there is no glibc."""
    if samples < HOURS or not sys.platform.startswith("linux"):
        return
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
