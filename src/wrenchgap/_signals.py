"""Ctrl-C, SIGTERM and SIGHUP while a command runs: it cleans up and ends with 130, 143 or 129, without a traceback.

The first of them is raised in the main thread, as Python does with Ctrl-C, but a moment later where LLVM is at work:
ctypes drops what is raised in a function that LLVM calls, and numba goes on with an address of zero for compiled code
that it was just handed. Where it does not get through (a destructor or a library swallowed it, a thread is waited for),
the command ends `GRACE` seconds later all the same, and at once at the second signal. Worker processes end with this
one, however it ends (`learn.worker`).

Python handles a signal between two of its instructions, hence not while one long call into C holds its lock (MuJoCo
compiles a large mesh). A process that waits beside this one therefore ends it from outside, by SIGKILL, where it is
still there `OUTSIDE` seconds after a signal; it hears of signals through a pipe that C writes to, and of the end by the
pipe's.
"""

from __future__ import annotations

import _thread
import os
import select
import signal
import sys
import time
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else []))
GRACE = 5.0
"""Seconds for cleaning up."""
OUTSIDE = 6.0
"""Seconds, `GRACE` and one more, after which no thread of this process has run to end it."""

_ending: list[int] = []
"""The first signal, once it has come: the end that it leads to is set then."""


class Interrupted(KeyboardInterrupt):
    """A signal asks the command to end."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.code = 128 + number


def interrupt_of(error: BaseException | None) -> KeyboardInterrupt | None:
    """The interrupt behind an error: Python wraps one that hits the making of a class (`__set_name__`) in another."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__
    return error


def catch() -> None:
    """Raise Interrupted at the next signal; one that is ignored, as of a command in the background, stays so."""
    for number in SIGNALS:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _first)
    sys.unraisablehook = _unraisable
    _guard()


def leave() -> None:
    """The command is done: from now on a signal ends the process as the system does it."""
    for number in SIGNALS:
        if signal.getsignal(number) in (_first, _second):
            signal.signal(number, signal.SIG_DFL)


def _first(number: int, frame: FrameType | None) -> None:
    for one in SIGNALS:
        if signal.getsignal(one) is _first:
            signal.signal(one, _second)
    if not _ending:
        _ending.append(number)
        _thread.start_new_thread(_end, (number, GRACE))  # takes no lock that the interrupted code may hold
    if _within_llvm(frame):
        _once_more(number)
    else:
        raise Interrupted(number)


def _within_llvm(frame: FrameType | None) -> bool:
    while frame is not None and not str(frame.f_globals.get("__name__")).startswith("llvmlite."):
        frame = frame.f_back
    return frame is not None


def _second(number: int, frame: FrameType | None) -> None:
    os._exit(128 + number)


def _end(number: int, seconds: float) -> None:
    time.sleep(seconds)
    os._exit(128 + number)


def _guard() -> None:
    """Begin the process that ends this one from outside; none where the system has no fork (Windows)."""
    if not hasattr(os, "fork"):
        return
    read, write = os.pipe()
    if os.fork() == 0:
        try:
            _watch(read, write, os.getppid())
        finally:
            os._exit(0)
    os.close(read)
    os.set_blocking(write, False)
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)


def _watch(read: int, write: int, watched: int) -> None:
    signal.set_wakeup_fd(-1)
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    os.close(write)
    for standard in (0, 1, 2):  # whoever reads the command's output must not wait for this process
        os.close(standard)
    while byte := os.read(read, 1):
        if byte[0] in SIGNALS:
            break
    else:
        return
    end = time.monotonic() + OUTSIDE
    while (remaining := end - time.monotonic()) > 0:
        if select.select([read], [], [], remaining)[0] and not os.read(read, 64):
            return
    os.kill(watched, signal.SIGKILL)


def _unraisable(what: Any) -> None:
    """Of an interrupt that came in a destructor or a callback, where Python drops it: once more, a moment later."""
    if not isinstance(what.exc_value, Interrupted):
        sys.__unraisablehook__(what)
    else:
        _once_more(what.exc_value.code - 128)


def _once_more(number: int) -> None:
    for one in SIGNALS:
        if signal.getsignal(one) is _second:
            signal.signal(one, _first)
    _thread.start_new_thread(_again, (number,))


def _again(number: int) -> None:
    time.sleep(0.01)
    os.kill(os.getpid(), number)
