"""The same function on many items, by this process and workers beside it, with the same result on any number of them.

Workers are started anew by loky (part of joblib), not forked: alike on Linux, macOS and Windows, whatever threads run
here (docs/decisions/0013-processes.md). They take a second to start; meanwhile, and afterwards, this process does items
too, so that a short search loses nothing. They stay for the next call. What is large and the same in all calls of a
search is named as `shared`: every worker reads it once, and keeps what it remembers of it.
"""

from __future__ import annotations

import importlib
import os
import signal
import warnings
import weakref
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import is_dataclass, replace
from functools import cache, wraps
from pathlib import Path
from typing import IO, Any, ParamSpec, TypeVar

import cloudpickle
import numpy as np
from joblib.externals import loky
from joblib.externals.loky import process_executor
from joblib.externals.loky.backend import resource_tracker
from threadpoolctl import ThreadpoolController, threadpool_limits

from wrenchgap.flight.errors import FitError, ModelError, WrenchgapError
from wrenchgap.learn.work_files import remove, written
from wrenchgap.plant import own_effects
from wrenchgap.plant.effects import catalogue
from wrenchgap.plant.rotor_kernels import turned

T = TypeVar("T")
Q = TypeVar("Q")
P = ParamSpec("P")

IDLE_SECONDS = 300
"""A worker that has had nothing to do for so long ends."""
HELD = 6
"""Files that a worker keeps in memory: the shared objects of one search, and its present question."""
ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "BLIS", "NUMBA", "NUMEXPR")} | {
    "VECLIB_MAXIMUM_THREADS": "1"
}
GROWN = 1_500_000_000
"""Bytes by which a worker may have grown when an item is done: columns of a long search and what its evaluators
remember take some 300 MB. One that has grown more is replaced by a new process, which reads everything anew."""
DIED = (
    "the work ended without a result: a process of it died (out of memory, or ended from outside); "
    "use shorter or fewer logs, or try again"
)

warnings.filterwarnings("ignore", "A worker stopped", UserWarning)  # one that has grown is replaced; nothing is lost


def cores() -> int:
    """Cores that this process may use: affinity, the limits of a container and LOKY_MAX_CPU_COUNT count."""
    return int(loky.cpu_count())


def one_thread(work: Callable[P, T]) -> Callable[P, T]:
    """`work` with one BLAS thread: the last digits of a sum depend on how many it is shared out to."""

    @wraps(work)
    def limited(*args: P.args, **options: P.kwargs) -> T:
        with threadpool_limits(1, user_api="blas"):
            return work(*args, **options)

    return limited


@cache
def _pools() -> ThreadpoolController:
    """Looking for all libraries of a process takes 4 ms."""
    return ThreadpoolController()


@contextmanager
def few_threads() -> Iterator[None]:
    """One thread of each library that is loaded: small matrices are not worth more."""
    with _pools().limit(limits=1):
        yield


def by_threads(work: Callable[[Q], T], items: Sequence[Q], jobs: int = 1) -> list[T]:
    """work(item) of every item, in order, by `jobs` threads, each with one thread of the libraries: for work in large
    arrays and in kernels that hold nobody up. The same digits on any number of threads.
    """  # noqa: D205
    with few_threads():
        if min(jobs, len(items)) < 2:
            return [work(item) for item in items]
        with ThreadPoolExecutor(jobs) as pool:
            return list(pool.map(work, items))


def each(work: Callable[[str], T], items: Sequence[str], jobs: int = 1, shared: Sequence[object] = ()) -> Iterator[T]:
    """work(item) of every item, in order, by `jobs` processes of which this is one.

    `work` and what it refers to must survive pickling, but for `shared`: dataclasses that workers are given once, as
    long as they live here. An error of the work is raised here; a worker that dies is a FitError.
    """
    if min(jobs, len(items)) < 2:
        yield from map(work, items)
        return
    question = written(lambda file: _Pickler(file, shared).dump(work))
    pool = _workers(jobs - 1)
    try:
        with threadpool_limits(1, user_api="blas"):
            yield from _shared_out(pool, question, work, items, _done_here(shared))
    except BaseException as error:
        pool.shutdown(kill_workers=True)
        if isinstance(error, BrokenProcessPool):
            raise FitError(DIED) from None
        raise
    finally:
        remove(question)  # from now on no worker begins with an item of it
        for j in range(len(items)):
            remove(_place(question, j))


def get_ready(jobs: int, what: str = "wrenchgap.learn.posterior.explain") -> None:
    """Let the workers of a later `each` start, import the module `what` and load the first of the compiled kernels,
    while this process reads logs.
    """  # noqa: D205
    if jobs > 1:
        with ctrl_c_stays_here():
            pool = _workers(jobs - 1)
            for _ in range(jobs - 1):
                pool.submit(_warm, what)


def _warm(what: str) -> None:
    """In a worker: what the first item would wait for, half a second of imports and numba's own start."""
    importlib.import_module(what)
    importlib.import_module("scipy.optimize")
    catalogue()
    turned(np.zeros((1, 1)))


def _shared_out(
    pool: Any, question: str, work: Callable[[str], T], items: Sequence[str], here: set[str]
) -> Iterator[T]:
    """Answers in order. Workers are asked for everything, the last item first; this process begins with the first, and
    whoever is the first to claim an item does it. Of `here`, items that were done here before, all that was remembered
    is here too: this process begins with those, and workers end with them.
    """  # noqa: D205
    mine = deque(sorted(range(len(items)), key=lambda j: items[j] not in here))
    here.difference_update(items)
    done: dict[int, T] = {}
    with ctrl_c_stays_here():
        asked = {j: pool.submit(_answer, question, items[j], _place(question, j)) for j in reversed(mine)}
    for k in range(len(items)):
        while k not in done:
            j = None if asked[k].done() else _claimed(question, mine)
            if j is None:  # what a worker has done, or is at
                done[k] = asked[k].result()
            else:
                done[j] = work(items[j])
                here.add(items[j])
        del asked[k]
        yield done.pop(k)


def _claimed(question: str, left: deque[int]) -> int | None:
    """The next of these items that nobody has begun with, which are taken out up to it."""
    while left:
        if _claim(_place(question, j := left.popleft())):
            return j
    return None


def _claim(place: str) -> bool:
    """Whether this process is the first to ask for the file that says that an item was begun. Raises OSError where
    no file can be made.
    """  # noqa: D205
    try:
        os.close(os.open(place, os.O_CREAT | os.O_EXCL))
    except FileExistsError:  # another was
        return False
    return True


def _place(question: str, item: int) -> str:
    """The file that says that an item was begun."""
    return f"{question}.{item}"


def begin(own: Sequence[str]) -> None:
    """How a worker begins: Ctrl-C is its parent's business, and the user's own effects are those of the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    process_executor._MAX_MEMORY_LEAK_SIZE = GROWN
    own_effects.use(map(Path, own))


def own_files() -> tuple[str, ...]:
    """What `begin` has to be given: the files of the user's own effects."""
    return tuple(str(path.resolve()) for path in own_effects.files())


@contextmanager
def ctrl_c_stays_here() -> Iterator[None]:
    """Processes started in here never see Ctrl-C, not even before `begin`; here it counts, if a moment later."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # which unblocks SIGINT when it has started
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def portable(error: Exception) -> Exception:
    """An error of a worker as its parent should raise it: with the line of the user's own file, known only here."""
    said = None if isinstance(error, WrenchgapError) else own_effects.blame(error)
    return error if said is None else ModelError(f"{said} (in an effect of your own, see docs/effects/your-own.md)")


def _workers(count: int) -> Any:
    """The pool: the one of the last call, unless another number of workers or other effects are wanted."""
    with warnings.catch_warnings():  # of another number of them: items that nobody waits for may still be queued
        warnings.filterwarnings("ignore", "Trying to resize", UserWarning)
        return loky.get_reusable_executor(
            count, timeout=IDLE_SECONDS, initializer=begin, initargs=(own_files(),), env=ONE_THREAD
        )


# --- what workers are given, as files that they read once ------------------------------------------------------------

_files: dict[int, str] = {}
"""Shared objects that are written, by identity."""
_here: dict[int, set[str]] = {}
"""Items that were done by this process the last time that an object was shared, by its identity."""
_held: OrderedDict[str, Any] = OrderedDict()
"""In a worker: what was read, by file, the last used last."""


class _Pickler(cloudpickle.Pickler):  # type: ignore[misc]
    """Puts the names of files in the place of shared objects."""

    def __init__(self, file: IO[bytes], shared: Sequence[object]) -> None:
        super().__init__(file)
        self._shared = {id(item): _file_of(item) for item in shared}

    def persistent_id(self, item: object) -> str | None:
        return self._shared.get(id(item))


class _Unpickler(cloudpickle.pickle.Unpickler):  # type: ignore[misc]
    def persistent_load(self, file: str) -> Any:
        return _read(file)


def _answer(question: str, item: str, place: str) -> Any:
    if not Path(question).exists() or not _claim(place):
        return None  # nobody waits for it any more
    try:
        return _read(question)(item)
    except Exception as error:
        raise portable(error) from error


def _read(file: str) -> Any:
    """What is in a file of the parent, read when it is asked for the first time."""
    if file in _held:
        _held.move_to_end(file)
        return _held[file]
    with Path(file).open("rb") as stream:
        found = _held[file] = _Unpickler(stream).load()
    while len(_held) > HELD:
        _held.popitem(last=False)
    return found


def _file_of(item: object) -> str:
    """The file of a shared object, which is there as long as the object; without what it has remembered so far."""
    if id(item) not in _files:
        bare = replace(item) if is_dataclass(item) and not isinstance(item, type) else item
        _files[id(item)] = written(lambda file: cloudpickle.dump(bare, file))
        weakref.finalize(item, _forget, id(item))
    return _files[id(item)]


def _done_here(shared: Sequence[object]) -> set[str]:
    """The items of the last call in which the first of these was shared that were done by this process."""
    return _here.setdefault(id(shared[0]), set()) if shared else set()


def _forget(key: int) -> None:
    _here.pop(key, None)
    remove(_files.pop(key))
