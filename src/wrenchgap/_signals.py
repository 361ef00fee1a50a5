"""Ctrl-C and SIGTERM while a command runs: it cleans up and ends with 130 or 143, without a traceback.

The first of them is raised in the main thread, as Python does with Ctrl-C. Where it does not get through (a destructor
or a library swallowed it, a thread is waited for), the command ends `GRACE` seconds later all the same, and at once at
the second signal. Worker processes end with this one, however it ends (`learn.worker`).
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import time
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)
GRACE = 5.0
"""Seconds for cleaning up."""


class Interrupted(KeyboardInterrupt):
    """A signal asks the command to end."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.code = 128 + number


def catch() -> None:
    """Raise Interrupted at the next signal; one that is ignored, as of a command in the background, stays so."""
    for number in SIGNALS:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _first)
    sys.unraisablehook = _unraisable


def leave() -> None:
    """The command is done: from now on a signal ends the process as the system does it."""
    for number in SIGNALS:
        if signal.getsignal(number) in (_first, _second):
            signal.signal(number, signal.SIG_DFL)


def _first(number: int, frame: FrameType | None) -> None:
    for one in SIGNALS:
        if signal.getsignal(one) is _first:
            signal.signal(one, _second)
    _thread.start_new_thread(_end, (number, GRACE))  # takes no lock that the interrupted code may hold
    raise Interrupted(number)


def _second(number: int, frame: FrameType | None) -> None:
    os._exit(128 + number)


def _end(number: int, seconds: float) -> None:
    time.sleep(seconds)
    os._exit(128 + number)


def _unraisable(what: Any) -> None:
    """Of an interrupt that came in a destructor or a callback, where Python drops it: once more, a moment later."""
    if not isinstance(what.exc_value, Interrupted):
        sys.__unraisablehook__(what)
        return
    for one in SIGNALS:
        if signal.getsignal(one) is _second:
            signal.signal(one, _first)
    _thread.start_new_thread(_again, (what.exc_value.code - 128,))


def _again(number: int) -> None:
    time.sleep(0.01)
    os.kill(os.getpid(), number)
