"""One batch: which logs are still to do, and Dask, which does them.

There is one code path. Without an address a LocalCluster of worker processes on this machine is what does the work,
with one the cluster there; scheduling, lost workers and their logs, and the dashboard are Dask's. Logs are handed over
in a window, so that the scheduler holds a few per worker and not all of them.
"""

import logging
import signal
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from multiprocessing import resource_tracker
from threading import Thread
from typing import Any
from uuid import uuid4

from wrenchgap.flight import UsageError, work_files
from wrenchgap.flight.extras import needed_for
from wrenchgap.learn.parallel import cores
from wrenchgap.plant.model_file import tool_version
from wrenchgap.replay.batch.fleet import FleetRanking, moved, rankings
from wrenchgap.replay.batch.sources import Source, identities
from wrenchgap.replay.batch.store import Store
from wrenchgap.replay.batch.tasks import Plan, Task, failed, reason, work

Tell = Callable[[int, int, int, str], None]
"""Called with logs done, all logs, logs failed, and the file that is done."""

OWN = {"distributed.worker.profile.enabled": False, "distributed.scheduler.worker-saturation": 1.0}
"""Workers of this machine do not sample their own stacks: Dask keeps the trees of an hour, 0.1 to 0.5 MB a log. None
has a log that waits beside that which it works on, or the one would be blamed where the other ends the worker."""
LOOPBACK = "127.0.0.1"
PATIENCE = 15.0
"""How long a scheduler is waited for [s]; twice as long for what it says first."""


@dataclass(frozen=True)
class Outcome:
    """What became of a pass: rows (without results) of logs done now, how many were done before, logs with the same
    content as another, by address, and keys of all rows of the logs that were asked for.
    """  # noqa: D205

    rows: tuple[Mapping[str, Any], ...]
    before: int
    same: Mapping[str, str]
    keys: tuple[str, ...]


@dataclass(frozen=True)
class Batch:
    """A batch that is done: what was asked, where rows are, what became of the last pass, all rows, the rankings."""

    plan: Plan
    output: str
    outcome: Outcome
    rows: Sequence[Mapping[str, Any]]
    rankings: Sequence[FleetRanking] = ()
    settled: bool = True

    @property
    def failures(self) -> list[Mapping[str, Any]]:
        """Rows of logs that failed."""
        return [r for r in self.rows if r["status"] == "failed"]


def dask_distributed() -> Any:
    """dask.distributed; raises UsageError where it is not installed."""
    with needed_for("workers of `batch`"):
        import cryptography  # noqa: F401 - of TLS
        import distributed
    return distributed


@contextmanager
def client(
    scheduler: str | None = None, workers: int | None = None, memory: str = "auto", most: int | None = None
) -> Iterator[Any]:
    """A client of a Dask cluster: that at `scheduler`, else one of `workers` processes on this machine (default: one
    for each core), `most` at most. Raises UsageError where there is none at that address.
    """  # noqa: D205
    distributed = dask_distributed()
    logging.getLogger("distributed").setLevel(logging.ERROR)
    if scheduler is None:
        count = workers or cores()
        with _local_cluster(min(count, most or count), memory) as cluster, distributed.Client(cluster) as found:
            yield found
        return
    try:
        found = _client_of(scheduler)
    except (OSError, ValueError, TypeError, TimeoutError, MemoryError) as error:
        said = " ".join(str(error).split()) or type(error).__name__
        raise UsageError(
            f"--scheduler {scheduler}: no Dask scheduler answers ({said}); start one with `dask scheduler` (for tls:// "
            "see docs/batch.md), or leave the option out to work on this machine"
        ) from None
    with found:
        yield found


def _client_of(scheduler: str) -> Any:
    """A client of a scheduler; asked in a thread, as dask waits for ever for one that accepts and says nothing."""
    distributed, answer = dask_distributed(), Future[Any]()

    def ask() -> None:
        try:
            answer.set_result(distributed.Client(scheduler, timeout=PATIENCE))
            for name in ("distributed.client", "distributed.utils"):  # a scheduler that is lost is said in one line
                logging.getLogger(name).setLevel(logging.CRITICAL)
        except BaseException as error:
            answer.set_exception(error)

    Thread(target=ask, daemon=True).start()
    return answer.result(2.0 * PATIENCE)


@contextmanager
def _local_cluster(workers: int, memory: str) -> Iterator[Any]:
    """One that nobody else on this machine may use: its scheduler and workers run whatever is sent to them.

    They listen on loopback and speak TLS, both ways, with a key that is made for this run. Dask's page listens on
    loopback at a free port. The folders of scheduler and workers, in which they look for modules too, are in one that
    only this user enters.
    """
    import dask

    distributed = dask_distributed()
    local = {"host": LOOPBACK, "security": distributed.Security.temporary(), "dashboard_address": f"{LOOPBACK}:0"}
    size = {"n_workers": workers, "threads_per_worker": 1, "memory_limit": _bytes(memory)}
    size["silence_logs"] = logging.CRITICAL
    with (
        tempfile.TemporaryDirectory(dir=work_files.folder(), ignore_cleanup_errors=True) as folder,
        dask.config.set(OWN | {"temporary-directory": folder}),
    ):
        with ctrl_c_stays_here():
            cluster = distributed.LocalCluster(**size, **local)
        with cluster:
            yield cluster


def _bytes(memory: str) -> int | str:
    """Of a size such as 2GB; `auto` stays. Raises UsageError for anything else."""
    from dask.utils import parse_bytes

    if memory == "auto":
        return memory
    try:
        size = int(parse_bytes(memory))
    except (ValueError, OverflowError):
        size = 0
    if size <= 0:
        raise UsageError(f"--memory {memory}: expected a size, such as 2GB, or auto")
    return size


@contextmanager
def ctrl_c_stays_here() -> Iterator[None]:
    """Processes and threads that begin in here never see Ctrl-C; in this process it counts, if a moment later."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # which unblocks SIGINT when it has started
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def agree(found: Any, store: Store) -> None:
    """Raise UsageError where workers have another version, or do not see what is written to."""
    if not found.scheduler_info(n_workers=-1)["workers"]:
        raise UsageError(
            f"the Dask scheduler at {found.scheduler.address} has no workers; start some (`dask worker`), or give "
            "those of this machine more memory with --memory"
        )
    try:
        answers = found.run(_about, store.url)
    except dask_distributed().comm.core.CommClosedError:
        raise UsageError(
            "a worker ended as soon as it began; give those of this machine more memory with --memory"
        ) from None
    for said in answers.values():
        version, sees = said
        if version != tool_version():
            raise UsageError(f"a worker has wrenchgap {version}, this is {tool_version()}; install the same version")
        if not sees:
            raise UsageError(
                f"--output {store.url}: a worker does not see that folder; name one that all machines share, or s3://..."
            )


def _about(output: str) -> tuple[str, bool]:
    try:
        Store(output).identity()
    except UsageError:
        return tool_version(), False
    return tool_version(), True


def passes(
    found: Any,
    sources: Sequence[Source],
    plan: Plan,
    store: Store,
    progress: Callable[[float, str], None],
    most: int = 1,
    *,
    again: bool = False,
) -> Batch:
    """Do a plan, `explain` until values move no more from pass to pass, but no more than `most` times."""
    while True:
        first = f"pass {plan.number}, " if most > 1 else ""

        def tell(done: int, total: int, failed: int, name: str, first: str = first) -> None:
            progress(done / max(total, 1), f"{first}{done}/{total} logs, {failed} failed")

        outcome = run(found, sources, plan, store, tell, again=again)
        ranked: list[FleetRanking] = []
        if plan.command == "explain":
            progress(1.0, "ranking")
            ranked = rankings(store, outcome.keys, plan.number)
        settled = not moved(ranked)
        if settled or plan.number >= most:
            break
        found_at = {
            f.vehicle: {k: list(v) for k, v in f.ranking.points.items()} for f in ranked if f.ranking is not None
        }
        plan = replace(plan, points=found_at, number=plan.number + 1)  # where candidates are linearised next
    keys = set(outcome.keys)
    rows = [row for row in store.rows(plan.number) if row["key"] in keys]
    return Batch(plan, store.url, outcome, rows, ranked, settled)


def run(found: Any, sources: Sequence[Source], plan: Plan, store: Store, tell: Tell, *, again: bool = False) -> Outcome:
    """One pass: do the command on every log whose row is not there yet. Those that failed are done only `again`, and
    then those too whose row cannot be read.

    Raises UsageError where the scheduler is lost; what is done by then is kept.
    """  # noqa: D205
    distributed = dask_distributed()
    try:
        tasks, same = _tasks(found, sources, plan)
        done = store.done(plan.number)
        if again:
            own = [d for t in tasks if (d := done.get(t.key)) is not None]
            gone = [d for d in own if d.failed]
            gone += store.unreadable([d for d in own if not d.failed], plan.number)
            store.drop(gone)
            done = {k: d for k, d in done.items() if d not in gone}
        todo = [t for t in tasks if t.key not in done]
        before = len(tasks) - len(todo)
        bad = sum(d.failed for t in tasks if (d := done.get(t.key)) is not None)
        rows = []
        tell(before, len(tasks), bad, "")
        for row in _worked(found, todo, plan, store):
            rows.append(row)
            bad += row["status"] == "failed"
            tell(before + len(rows), len(tasks), bad, row["log"])
    except (distributed.comm.core.CommClosedError, distributed.client.FutureCancelledError) as error:
        raise UsageError(
            f"the Dask scheduler was lost ({type(error).__name__}); run the same command to go on"
        ) from None
    return Outcome(tuple(rows), before, same, tuple(t.key for t in tasks))


def _tasks(found: Any, sources: Sequence[Source], plan: Plan) -> tuple[list[Task], dict[str, str]]:
    """One for each log with a content of its own; logs that have that of another, by address. 16 are read by a task."""
    known = {s.url: f"etag:{s.etag}" for s in sources if s.etag is not None}
    unknown = [s for s in sources if s.etag is None]
    chunks = [unknown[k : k + 16] for k in range(0, len(unknown), 16)]
    for chunk, names in zip(chunks, found.gather(found.map(identities, chunks, pure=False)), strict=True):
        known |= {s.url: name for s, name in zip(chunk, names, strict=True)}
    tasks: dict[str, Task] = {}
    same: dict[str, str] = {}
    for source in sources:
        key = plan.key(known[source.url], source.vehicle)
        if key in tasks:
            same[source.url] = tasks[key].source.url
        else:
            tasks[key] = Task(source, known[source.url], key)
    return list(tasks.values()), same


def _itself(plan: Plan) -> Plan:
    return plan


def _worked(found: Any, todo: Sequence[Task], plan: Plan, store: Store) -> Iterator[Mapping[str, Any]]:
    """Rows as logs are done; three are handed over for each thread of a worker, so that none waits for the next."""
    distributed = dask_distributed()
    waiting = iter(todo)
    by_key = {task.key: task for task in todo}
    shared = found.submit(_itself, plan, key=f"plan-{plan.number}-{uuid4().hex}")  # made again where a worker dies

    def hand_over(count: int) -> list[Any]:
        return [
            found.submit(work, task, shared, store.url, key=f"log-{plan.number}-{task.key}", pure=False)
            for task in islice(waiting, count)
        ]

    threads = max(1, sum(found.nthreads().values()))
    finished = distributed.as_completed(hand_over(3 * threads))
    for future in finished:
        task = by_key[future.key.rpartition("-")[2]]
        error = future.exception()
        if error is None:
            yield future.result()
        elif isinstance(error, distributed.scheduler.KilledWorker):
            why = "every worker that had it died: of too little memory (--memory gives more), or of a crash"
            yield failed(task, plan, store.url, why)
        else:  # of the row that could not be written, say
            raise UsageError(f"{task.source.url}: {reason(error)}") from None
        future.release()
        for more in hand_over(1):
            finished.add(more)
