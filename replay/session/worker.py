"""Long work in a process of its own, so that the page stays usable and a cancelled search ends at once.

The process (`learn.worker`) stays for the next work. What it is given and what it gives back must survive pickling. Who
cancels ends it, and so the workers that it has itself.
"""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from functools import partial
from queue import SimpleQueue
from typing import ClassVar, TypeVar

from wrenchgap.flight.errors import FitError, WrenchgapError
from wrenchgap.flight.work_files import folder
from wrenchgap.learn.parallel import DIED, begin, own_files, portable
from wrenchgap.learn.worker import WorkerDied, Workers, tell
from wrenchgap.viewer.session import Report

T = TypeVar("T")


def worker_result(work: Callable[[Report], T], report: Report, patience: float = 0.1) -> T:
    """work(report) in another process; `report` is called in this one, also while there is nothing new.

    It is called every `patience` [s] while the process says nothing. What `report` raises (somebody cancelled) ends the
    process and is passed on. Errors of wrenchgap in the process are raised here; a process that dies is a FitError.
    """
    process = _Process.free()
    future, said = process.submit(work), (0.0, "starting")
    try:
        while wait([future], timeout=patience).not_done:
            for said in process.news():
                report(*said)
            report(*said)
        for said in process.news():
            report(*said)
        result: T = future.result()
    except WorkerDied:
        process.end()
        raise FitError(DIED) from None
    except WrenchgapError:
        process.rest()
        raise
    except BaseException:
        process.end()
        raise
    process.rest()
    return result


class _Process:
    """One process, the way that its progress takes, and a folder for what it writes, removed when it ends."""

    _idle: ClassVar[list[_Process]] = []
    _lock = threading.Lock()

    def __init__(self, own: tuple[str, ...]) -> None:
        self.own = own
        self._folder = tempfile.TemporaryDirectory(dir=folder(), ignore_cleanup_errors=True)
        self._news: SimpleQueue[tuple[float, str]] = SimpleQueue()
        self._worker = Workers(1, threads=None)

    @classmethod
    def free(cls) -> _Process:
        """One that has nothing to do, or a new one."""
        own = own_files()
        with cls._lock:
            found = next((p for p in cls._idle if p.own == own), None)
            if found is not None:
                cls._idle.remove(found)
        return found or cls(own)

    def submit(self, work: Callable[[Report], T]) -> Future[T]:
        """Begin the work."""
        return self._worker.submit(partial(_do, self.own, self._folder.name, work), self._news.put)

    def news(self) -> Iterator[tuple[float, str]]:
        """What it has reported since it was asked last."""
        while not self._news.empty():
            yield self._news.get()

    def rest(self) -> None:
        """Wait for other work."""
        with self._lock:
            self._idle.append(self)

    def end(self) -> None:
        """End it and its workers, whatever they are doing."""
        self._worker.end()
        self._folder.cleanup()


# --- in the other process ---------------------------------------------------------------------------------------------


def _do(own: tuple[str, ...], files: str, work: Callable[[Report], T]) -> T:
    tempfile.tempdir = files
    begin(own)
    try:
        return work(lambda share, words: tell((share, words)))
    except WrenchgapError:
        raise
    except Exception as error:
        found = portable(error)
        raise (RuntimeError(f"{type(error).__name__}: {error}") if found is error else found) from None
