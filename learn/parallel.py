"""The same function on many items, by this process and workers beside it, with the same result on any number of them.

Workers (`learn.worker`) take a second to start; meanwhile, and afterwards, this process does items too, so that a short
search loses nothing. They stay for the next call. What is large and the same in all calls of a search is named as
`shared`: every worker reads it once, and keeps what it remembers of it.
"""

import atexit
import importlib
import os
import re
import threading
import weakref
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import is_dataclass, replace
from functools import cache, partial, wraps
from pathlib import Path
from typing import IO, Any, ParamSpec, TypeVar

import cloudpickle
import numpy as np
from threadpoolctl import ThreadpoolController, threadpool_limits

from wrenchgap.flight.errors import FitError, ModelError, UsageError, WrenchgapError
from wrenchgap.flight.row_kernels import repeats
from wrenchgap.flight.work_files import remove, written
from wrenchgap.learn.worker import WorkerDied, Workers
from wrenchgap.plant import own_effects
from wrenchgap.plant.effects import catalogue

T = TypeVar("T")
Q = TypeVar("Q")
P = ParamSpec("P")

HELD = 6
"""Files that a worker keeps in memory: the shared objects of one search, and its present question."""
CORES = "WRENCHGAP_CORES"
"""Environment: cores that are used at most."""
QUOTA = Path("/sys/fs/cgroup/cpu.max")
"""Of a container on Linux: processor time [us] in a period [us], or `max` where it is not limited."""
DIED = (
    "the work ended without a result: a process of it died (out of memory, or ended from outside); "
    "use shorter or fewer logs, or try again"
)


def cores() -> int:
    """Cores that this process may use: affinity, the limit of a container and WRENCHGAP_CORES count.

    Raises UsageError where that is no number of cores.
    """
    found = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if asked := os.environ.get(CORES, ""):
        if not re.fullmatch(r"[1-9][0-9]{0,5}", asked):
            raise UsageError(f"{CORES}={asked} in the environment: expected a number of cores, 1 or more; or unset it")
        found = min(found, int(asked))
    with suppress(OSError, ValueError):  # no container, or one without a limit
        time, period = QUOTA.read_text(encoding="ascii").split()
        found = min(found, -(-int(time) // int(period)))
    return max(1, found)


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
    """work(item) of every item, in order, by `jobs` threads, each with one thread of the libraries.

    For work in large arrays and in kernels that hold nobody up. The same digits on any number of threads.
    """
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
            here = _here.setdefault(id(shared[0]), set()) if shared else set()
            yield from _shared_out(pool, question, work, items, here)
    except BaseException as error:
        pool.end()
        if isinstance(error, WorkerDied):
            raise FitError(DIED) from None
        raise
    finally:
        remove(question)  # from now on no worker begins with an item of it
        for j in range(len(items)):
            remove(_place(question, j))


def get_ready(jobs: int, what: str = "wrenchgap.learn.posterior.explain") -> None:
    """Let the workers of a later `each` start and import the module `what`, while this process reads logs."""
    if jobs > 1:
        pool = _workers(jobs - 1)
        for _ in range(jobs - 1):
            pool.submit(partial(_warm, own_files(), what))


def _warm(own: tuple[str, ...], what: str) -> None:
    """In a worker: what the first item would wait for, half a second of imports and numba's own start."""
    begin(own)
    importlib.import_module(what)
    importlib.import_module("scipy.optimize")
    catalogue()
    repeats(np.zeros((1, 1)))


def _shared_out(
    pool: Workers, question: str, work: Callable[[str], T], items: Sequence[str], here: set[str]
) -> Iterator[T]:
    """Answers in order. Workers are asked for everything, the last item first; this process begins with the first.

    Whoever is the first to claim an item does it. Of `here`, items that were done here before, all that was remembered
    is here too: this process begins with those, and workers end with them.
    """
    mine = deque(sorted(range(len(items)), key=lambda j: items[j] not in here))
    here.difference_update(items)
    done: dict[int, T] = {}
    own = own_files()
    asked = {j: pool.submit(partial(_answer, own, question, items[j], _place(question, j))) for j in reversed(mine)}
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
    """Whether this process is the first to ask for the file that says that an item was begun. Raises OSError."""
    try:
        os.close(os.open(place, os.O_CREAT | os.O_EXCL))
    except FileExistsError:  # another was
        return False
    return True


def _place(question: str, item: int) -> str:
    """The file that says that an item was begun."""
    return f"{question}.{item}"


@cache
def begin(own: tuple[str, ...]) -> None:
    """In another process, before its first work: the user's own effects are those of its parent."""
    own_effects.use(map(Path, own))


def own_files() -> tuple[str, ...]:
    """What `begin` has to be given: the files of the user's own effects."""
    return tuple(str(path.resolve()) for path in own_effects.files())


def portable(error: Exception) -> Exception:
    """An error of a worker as its parent should raise it: with the line of the user's own file, known only here."""
    said = None if isinstance(error, WrenchgapError) else own_effects.blame(error)
    return error if said is None else ModelError(f"{said} (in an effect of your own, see docs/effects/your-own.md)")


_lock = threading.Lock()
_pool: tuple[tuple[int, tuple[str, ...], int], Workers] | None = None
"""The workers of the last call, and what they are good for."""


def _workers(count: int) -> Workers:
    """Those of the last call, unless another number of them or other effects are wanted, or this is a fork."""
    global _pool
    wanted = count, own_files(), os.getpid()
    with _lock:
        if _pool is None or _pool[0] != wanted or _pool[1].ended:
            _end()
            _pool = wanted, Workers(count)
        return _pool[1]


@atexit.register
def _end() -> None:
    """No worker outlives this process; that of another process, whose fork this is, is its own business."""
    if _pool is not None and _pool[0][-1] == os.getpid():
        _pool[1].end()


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


def _answer(own: tuple[str, ...], question: str, item: str, place: str) -> Any:
    begin(own)
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


def _forget(key: int) -> None:
    _here.pop(key, None)
    remove(_files.pop(key))
