"""Background jobs of the page: one thread each; progress and result are handed back under the page's lock."""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Callable
from typing import Any, TypeVar

from wrenchgap.flight.errors import WrenchgapError

T = TypeVar("T")
FOLDERS = re.compile(r"(?<![\w./])(?:[A-Za-z]:)?(?:[/\\][^/\\\s:'\"]+)+[/\\](?=[^/\\\s:'\"]+\.\w)")
"""The folders of an absolute path of a file; names of topics have no suffix."""
_log = logging.getLogger(__name__)
Report = Callable[[float, str], None]
"""Says how far a job is: its share done, 0 to 1, and what it does at present."""


class Job(threading.Thread):
    """A running job. `cancel` makes its next report raise `Cancelled`, which ends it."""

    def __init__(self, name: str, run: Callable[[Job], None]) -> None:
        super().__init__(name=name, daemon=True)
        self.cancelled = False
        self._run = run

    def run(self) -> None:
        """Do it."""
        self._run(self)

    def cancel(self) -> None:
        """Request the end at the next report; the result is discarded."""
        self.cancelled = True


class Cancelled(Exception):
    """Raised inside a cancelled job."""


def start(
    function: Callable[[Report], T],
    on_progress: Report,
    on_done: Callable[[T], None],
    on_error: Callable[[Exception], None],
    lock: Any,
) -> Job:
    """Run `function(report)` on a thread of its own; the other three are called from there, under `lock`."""

    def run(job: Job) -> None:
        def report(share: float, words: str = "") -> None:
            with lock:
                if job.cancelled:
                    raise Cancelled
                on_progress(share, words)

        try:
            result = function(report)
        except Cancelled:
            return
        except Exception as error:  # whatever it is, the page must live on and say so
            with lock:
                if not job.cancelled:
                    on_error(error)
            return
        with lock:
            if not job.cancelled:
                on_done(result)

    job = Job(getattr(function, "__name__", "work"), run)
    job.start()
    return job


def error_text(error: Exception, longest: int = 1000) -> str:
    """An error in one line for whoever sees the page: files by their name, and only the kind of an internal one.

    No more of it than `longest` characters, as `FOLDERS` takes time with their square.
    What an internal error says stands in the terminal: it may hold paths and values that are not a visitor's.
    """
    if isinstance(error, WrenchgapError):
        return FOLDERS.sub("", str(error)[:longest])
    _log.error("%s", WrenchgapError(f"the page goes on after an internal error, please report it: {error!r}"))
    return f"internal error ({type(error).__name__}); the page goes on, the terminal says more; please report it"
