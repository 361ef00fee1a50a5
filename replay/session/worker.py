"""Long work in a process of its own, so that the page stays usable and a cancelled search ends at once.

The child is forked and so sees what the parent has; what it gives back must survive pickling. It leads a process group:
who cancels it ends its workers too. Where there is no fork (Windows, macOS) the work is done where it was asked for.
"""

from __future__ import annotations

import atexit
import contextlib
import multiprocessing
import os
import signal
import stat
import sys
import warnings
from collections.abc import Callable
from contextlib import AbstractContextManager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

from wrenchgap.flight.errors import FitError, WrenchgapError

T = TypeVar("T")
Report = Callable[[float, str], None]

PATIENCE = 0.1
"""How often the parent looks whether it is still wanted, while the child says nothing [s]."""

_running: set[int] = set()


def apart(work: Callable[[Report], T], report: Report, lock: AbstractContextManager[Any]) -> T:
    """work(report) in a child process; `report` is called in this one, also while there is nothing new.

    The fork happens under `lock`, so that no other thread of this process is then halfway through what the child needs.
    What `report` raises (somebody cancelled) ends the child and is passed on. Errors of wrenchgap in the child are
    raised here; a child that dies is a FitError.
    """
    if not sys.platform.startswith("linux"):
        return work(report)
    receiver, sender = multiprocessing.Pipe(duplex=False)
    with lock, warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # a fork beside the threads of the page, which it closes
        child = multiprocessing.get_context("fork").Process(target=_child, args=(work, sender), name="wrenchgap-work")
        child.start()
    sender.close()
    assert child.pid is not None
    _running.add(child.pid)
    said: tuple[float, str] = (0.0, "")
    try:
        while True:
            if receiver.poll(PATIENCE):
                kind, content = receiver.recv()
                if kind == "done":
                    return content  # type: ignore[no-any-return]
                if kind == "error":
                    raise content
                said = content
            report(*said)
    except EOFError:
        raise FitError("the work ended without a result (out of memory, or ended from outside); try again") from None
    finally:
        _end(child.pid)
        child.join()
        receiver.close()


def _child(work: Callable[[Report], Any], sender: Connection) -> None:
    os.setpgrp()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _let_go_of_sockets()
    try:
        result = work(lambda share, words: sender.send(("progress", (share, words))))
        sender.send(("done", result))
    except WrenchgapError as error:
        sender.send(("error", error))
    except Exception as error:
        sender.send(("error", RuntimeError(f"{type(error).__name__}: {error}")))


def _let_go_of_sockets() -> None:
    """Close the page's sockets, or browsers would not see it end."""
    for entry in Path("/proc/self/fd").iterdir():
        number = int(entry.name)
        with contextlib.suppress(OSError):
            if stat.S_ISSOCK(os.fstat(number).st_mode):
                os.close(number)


def _end(leader: int) -> None:
    """End a child and its workers."""
    _running.discard(leader)
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(leader, signal.SIGKILL)
    with contextlib.suppress(ProcessLookupError):  # it had no time to lead a group
        os.kill(leader, signal.SIGKILL)


@atexit.register
def _end_all() -> None:
    for leader in list(_running):
        _end(leader)
