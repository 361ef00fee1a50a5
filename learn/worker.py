"""Other processes that answer what they are asked, and end with whoever asks.

Each is a new interpreter, alike on Linux, macOS and Windows, whatever threads run here; its standard input and output
are pipes (docs/decisions/0013-processes.md). A thread of it reads its input all the time. Where that ends, because this
process closed it or died in whatever way, the other ends at once, whatever it is computing. It is in a process group of
its own: Ctrl-C on the terminal is this process's business.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Any, BinaryIO, TypeVar

import cloudpickle

from wrenchgap._safe_path import absolute, environment

T = TypeVar("T")
Work = Callable[[], Any]
Hear = Callable[[Any], None]

IDLE_SECONDS = 300.0
"""A process that has had nothing to do for so long ends."""
SOON = 10.0
"""Seconds before that from which on it is asked nothing any more."""
GROWN = 1_500_000_000
"""Bytes by which a process may have grown when an answer is given: columns of a long search and what its evaluators
remember take some 300 MB. One that has grown more is replaced by a new process, which reads everything anew."""
ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "BLIS", "NUMBA", "NUMEXPR")} | {
    "VECLIB_MAXIMUM_THREADS": "1"
}
START = "import sys; sys.path[:] = sys.argv[1:]; from wrenchgap.learn.worker import serve; serve()"
NEWS, ERROR, ANSWER = range(3)


class WorkerDied(Exception):
    """The process ended before it had answered."""


class Workers:
    """So many processes that take what is submitted in turn; `end` them, or they end with this process."""

    def __init__(self, count: int, threads: int | None = 1) -> None:
        """`threads`: of the libraries of numbers, in each process; None leaves that to them."""
        self._threads, self.ended, self._lock = threads, False, threading.Lock()
        self._asked: SimpleQueue[tuple[Future[Any], Work, Hear | None] | None] = SimpleQueue()
        self._processes = [_Process(threads) for _ in range(count)]
        for place in range(count):  # daemons: whoever leaves this process waits for no answer
            threading.Thread(target=self._serve, args=(place,), daemon=True).start()

    def submit(self, work: Callable[[], T], hear: Hear | None = None) -> Future[T]:
        """Ask for work(), of which `hear` is called with what it tells meanwhile (`tell`), in another thread.

        The future has the answer, what the work raised, or WorkerDied.
        """
        future: Future[T] = Future()
        self._asked.put((future, work, hear))
        return future

    def end(self) -> None:
        """Kill the processes, whatever they are doing."""
        with self._lock:
            self.ended = True
            for process in self._processes:
                process.kill()
                self._asked.put(None)

    def _serve(self, place: int) -> None:
        while (asked := self._asked.get()) is not None:
            future, work, hear = asked
            try:
                future.set_result(self._process(place).ask(work, hear))
            except BaseException as error:
                future.set_exception(error)
            del asked, future, work  # what they hold must not wait for the next question

    def _process(self, place: int) -> _Process:
        with self._lock:
            if self.ended:
                raise WorkerDied
            if not self._processes[place].fit():
                self._processes[place].kill()
                self._processes[place] = _Process(self._threads)
            return self._processes[place]


class _Process:
    """One of them, from here."""

    def __init__(self, threads: int | None) -> None:
        env = environment() | (ONE_THREAD if threads == 1 else {})
        group: dict[str, Any] = {"process_group": 0}
        if sys.platform == "win32":
            group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
        pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        command = [sys.executable, "-c", START, *absolute(sys.path)]
        self._process: Any = subprocess.Popen(command, env=env, **pipes, **group)
        self._lasts, self._asked = True, time.monotonic()

    def fit(self) -> bool:
        """Whether it is there, and will be for the next question."""
        resting = time.monotonic() - self._asked
        return self._lasts and resting < IDLE_SECONDS - SOON and self._process.poll() is None

    def ask(self, work: Work, hear: Hear | None) -> Any:
        """work() in the other process; raises what that raises, and WorkerDied."""
        question = cloudpickle.dumps(work)
        try:
            _write(self._process.stdin, question)
            kind: int = NEWS
            content: Any = None
            while kind == NEWS:
                kind, content, self._lasts = pickle.loads(pickle.load(self._process.stdout))
                if kind == NEWS and hear is not None:
                    hear(content)
        except (EOFError, OSError, pickle.UnpicklingError):
            self._lasts = False
            raise WorkerDied from None
        self._asked = time.monotonic()
        if kind == ERROR:
            raise content
        return content

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            with suppress(OSError, ValueError):
                pipe.close()


def _write(stream: BinaryIO, message: bytes) -> None:
    """A message as it is read by pickle.load: bytes alone, whose content is unpickled by whoever wants it."""
    pickle.dump(message, stream)
    stream.flush()


# --- in the other process ---------------------------------------------------------------------------------------------

_answers: Any = None
_one = threading.Lock()


def serve() -> None:
    """Answer until nobody asks any more."""
    import psutil

    global _answers
    _answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever prints, prints where errors go
    asked: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_listen, args=(sys.stdin.buffer, asked), daemon=True).start()
    start, own = None, psutil.Process()
    while True:
        try:
            question = asked.get(timeout=IDLE_SECONDS)
        except Empty:
            os._exit(0)
        kind, content = _answer(question)
        size = own.memory_info().rss
        start = size if start is None else start
        _send(kind, content, lasts=size - start < GROWN)
        del content, question


def tell(news: Any) -> None:
    """Say something to whoever asked, before the answer."""
    _send(NEWS, news)


def _listen(stream: BinaryIO, asked: SimpleQueue[bytes]) -> None:
    with suppress(EOFError, OSError, pickle.UnpicklingError):
        while True:
            asked.put(pickle.load(stream))
    os._exit(0)  # the parent is gone, or wants nothing more


def _answer(question: bytes) -> tuple[int, Any]:
    try:
        return ANSWER, pickle.loads(question)()
    except BaseException as error:
        error.add_note("In another process:\n" + "".join(traceback.format_exception(error)))
        return ERROR, error


def _send(kind: int, content: Any, lasts: bool = True) -> None:
    with _one:
        try:
            _write(_answers, _message(kind, content, lasts))
        except OSError:
            os._exit(0)  # the parent is gone, which `_listen` may not have heard yet


def _message(kind: int, content: Any, lasts: bool) -> bytes:
    """Pickled; an answer or error that does not survive that is an error that says so."""
    try:
        message: bytes = cloudpickle.dumps((kind, content, lasts))
        if kind == ERROR:
            pickle.loads(message)
    except Exception as error:
        said = content if kind == ERROR else error
        return pickle.dumps((ERROR, RuntimeError(f"{type(said).__name__}: {said}"), lasts))
    return message
