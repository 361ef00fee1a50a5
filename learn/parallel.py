"""The same function on many items, on all cores where that is cheap: forked workers, which see what the parent has.

Forking costs milliseconds and copies nothing, so a search may do it at every step. Where there is no fork (Windows,
macOS) or one core only, the items are done one after the other, with the same result.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

T = TypeVar("T")

_work: Callable[[Any], Any] | None = None


def cores() -> int:
    """Cores that this process may use, 1 where work cannot be forked."""
    return len(os.sched_getaffinity(0)) if sys.platform.startswith("linux") else 1


def each(work: Callable[[str], T], items: Sequence[str], jobs: int = 1) -> Iterator[T]:
    """work(item) of every item, in order, by `jobs` processes. What comes back must survive pickling."""
    if min(jobs, len(items)) < 2 or cores() < 2:
        yield from map(work, items)
        return
    global _work
    _work = work
    with warnings.catch_warnings(), threadpool_limits(1, user_api="blas"):
        warnings.simplefilter("ignore", DeprecationWarning)  # a fork beside the thread that draws the progress
        try:
            with multiprocessing.get_context("fork").Pool(min(jobs, len(items)), _quiet) as pool:
                yield from pool.imap(_call, items)
        finally:
            _work = None


def _call(item: str) -> Any:
    assert _work is not None
    return _work(item)


def _quiet() -> None:
    """Ctrl-C is the parent's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
