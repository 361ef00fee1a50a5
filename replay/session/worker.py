"""Long work in a process of its own, so that the page stays usable and a cancelled search ends at once.

The process is started anew by loky, on every platform (docs/decisions/0013-processes.md), and stays for the next work.
What it is given and what it gives back must survive pickling. Who cancels ends it, and the workers that it has itself.
"""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, ClassVar, TypeVar

from joblib.externals import loky
from joblib.externals.loky.backend import get_context

from wrenchgap.flight.errors import FitError, WrenchgapError
from wrenchgap.learn.parallel import DIED, IDLE_SECONDS, begin, ctrl_c_stays_here, own_files, portable

T = TypeVar("T")
Report = Callable[[float, str], None]

PATIENCE = 0.1
"""How often the parent looks whether it is still wanted, while the process says nothing [s]."""


def apart(work: Callable[[Report], T], report: Report) -> T:
    """work(report) in another process; `report` is called in this one, also while there is nothing new.

    What `report` raises (somebody cancelled) ends the process and is passed on. Errors of wrenchgap in the process are
    raised here; a process that dies is a FitError.
    """
    process = _Process.free()
    future, said = process.submit(work), (0.0, "")
    try:
        while wait([future], timeout=PATIENCE).not_done:
            for said in process.news():
                report(*said)
            report(*said)
        for said in process.news():
            report(*said)
        result: T = future.result()
    except BrokenProcessPool:
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
        self.own, context = own, get_context()
        self._folder = tempfile.TemporaryDirectory(prefix="wrenchgap-", ignore_cleanup_errors=True)
        self._news = context.SimpleQueue()
        given = (own, self._folder.name, self._news)
        self._pool = loky.ProcessPoolExecutor(
            1, timeout=IDLE_SECONDS, context=context, initializer=_begin, initargs=given
        )

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
        with ctrl_c_stays_here():
            future: Future[T] = self._pool.submit(_do, work)
        return future

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
        self._pool.shutdown(kill_workers=True)
        self._folder.cleanup()


# --- in the other process ---------------------------------------------------------------------------------------------

_news: Any = None


def _begin(own: tuple[str, ...], folder: str, news: Any) -> None:
    global _news
    _news, tempfile.tempdir = news, folder
    begin(own)


def _do(work: Callable[[Report], T]) -> T:
    try:
        return work(lambda share, words: _news.put((share, words)))
    except WrenchgapError:
        raise
    except Exception as error:
        found = portable(error)
        raise (RuntimeError(f"{type(error).__name__}: {error}") if found is error else found) from None
