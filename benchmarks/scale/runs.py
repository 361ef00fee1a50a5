"""Runs of `wrenchgap batch explain` on the fleet: on a cluster whose worker is killed on the way, and one by one."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
import psutil

from benchmarks.scale.fleet import VEHICLES, make
from wrenchgap.learn.posterior.flight_evidence import unpacked
from wrenchgap.replay.batch import driver
from wrenchgap.replay.batch.fleet import FleetRanking, rankings
from wrenchgap.replay.batch.sources import Source, identity, logs_named
from wrenchgap.replay.batch.store import Store
from wrenchgap.replay.batch.tasks import Plan, Task, model_text, work

WORKERS = 2
KILL_AT = 1 / 3
"""Share of the logs done at which a worker is killed."""
SAMPLES = 10
"""How often memory is noted."""


def plan() -> Plan:
    """One pass of `explain` on three vehicles."""
    return Plan("explain", {v.name: model_text(v.model) for v in VEHICLES}, {"cutoff_hz": 8.0})


def first(folder: Path, count: int) -> list[Source]:
    """The logs of the first flights; what is missing of them is flown."""
    make(folder, count)
    wanted = {(v, f"{k:04d}.mcap") for k in range(count // len(VEHICLES)) for v in (v.name for v in VEHICLES)}
    return [s for s in logs_named([str(folder)]) if (s.vehicle, s.name) in wanted]


def on_cluster(folder: Path, output: Path, count: int, *, kill: bool) -> dict[str, Any]:
    """The cluster's run: seconds, memory on the way, what was killed, and what the vehicles' rankings are."""
    sources, store = first(folder, count), Store(str(output))
    store.claim(plan().identity)
    memory: list[list[float]] = []
    killed: list[int] = []
    begin = monotonic()
    with driver.client(workers=WORKERS) as client:
        driver.agree(client, store)
        ready = monotonic()

        def tell(done: int, total: int, failed: int, name: str) -> None:
            pids = [nanny.pid for nanny in client.cluster.workers.values() if nanny.pid]
            if kill and not killed and done >= KILL_AT * total:
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)
            elif done % max(1, total // SAMPLES) == 0:
                memory.append([done, _mb(os.getpid()), *(_mb(p) for p in pids)])
                print(f"{done}/{total} logs, {failed} failed, {memory[-1]}", flush=True)

        outcome = driver.run(client, sources, plan(), store, tell)
    worked = monotonic() - ready
    seconds = {"start": ready - begin, "work": worked}
    about = {"logs": len(outcome.keys), "done_now": len(outcome.rows), "killed": len(killed), "memory": memory}
    return {**about, "seconds": seconds, **of_rows(store)}


def refused(folder: Path, output: Path, count: int) -> dict[str, Any]:
    """Memory of the scheduler and the driver over very many logs: files of one line, which are rows with a reason."""
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(count):
        (folder / f"{k:06d}.mcap").write_text(f"{k}\n", encoding="utf-8")
    sources, store = logs_named([str(folder)]), Store(str(output))
    memory: list[list[float]] = []
    p = Plan("explain", {"": model_text(VEHICLES[0].model)}, {"cutoff_hz": 8.0})
    store.claim(p.identity)
    with driver.client(workers=WORKERS) as client:

        def tell(done: int, total: int, failed: int, name: str) -> None:
            if done % max(1, count // SAMPLES) == 0:
                memory.append([done, _mb(os.getpid())])
                print(f"{done}/{total}, {failed} failed, {memory[-1][1]:.1f} MB", flush=True)

        outcome = driver.run(client, sources, p, store, tell)
    return {"logs": len(outcome.keys), "memory": memory}


def serial(folder: Path, output: Path, count: int, minutes: float) -> dict[str, Any]:
    """The same logs one after the other in this process, without Dask; the vehicles in turn, until the time is over."""
    store, begin, p = Store(str(output)), monotonic(), plan()
    store.claim(p.identity)
    done = store.done()
    keys = []
    for source in sorted(first(folder, count), key=lambda s: (s.name, s.vehicle)):
        if keys and monotonic() - begin > 60.0 * minutes:
            break
        content = identity(source)
        task = Task(source, content, p.key(content, source.vehicle))
        keys.append(task.key)
        if task.key not in done:
            work(task, p, store.url)
    seconds = {"work": monotonic() - begin}
    return {"logs": len(keys), "done_now": len(set(keys) - set(done)), "seconds": seconds, **of_rows(store)}


def _mb(pid: int) -> float:
    try:
        return float(psutil.Process(pid).memory_info().rss / 2**20)
    except psutil.Error:
        return float("nan")


def of_rows(store: Store) -> dict[str, Any]:
    """What the rows say of costs: medians and sums over logs, bytes that were read and that are kept."""
    rows = store.rows()
    good = [r for r in rows if r["status"] == "ok"]
    cpu = np.array([r["cpu_s"] for r in good])
    kept = sum(p.stat().st_size for p in Path(store.url).rglob("*.parquet"))
    read = sum(r["bytes"] for r in rows)
    return {
        "failed": len(rows) - len(good),
        "flight_seconds": sum(r["seconds"] for r in good) / len(good),
        "cpu": {"median": float(np.median(cpu)), "mean": float(cpu.mean()), "most": float(cpu.max())},
        "peak_mb": max(r["peak_mb"] for r in good),
        "bytes": {"read": read / len(rows), "kept": kept / len(rows)},
    }


def ranked(output: Path) -> dict[str, Any]:
    """The vehicles' rankings from the evidence that a run has kept: no log is read again."""
    store, begin = Store(str(output)), monotonic()
    keys = [d.key for d in store.done().values() if not d.failed]
    found_rankings = rankings(store, keys, 1)
    about = {"logs": len(keys), "seconds": monotonic() - begin}
    return {**about, "rankings": [brief(r) for r in found_rankings]}


def course(output: Path) -> dict[str, Any]:
    """Median processor seconds of the logs of each vehicle, by the quarter in which they were done: first to last."""
    rows = sorted((r for r in Store(str(output)).rows() if r["status"] == "ok"), key=lambda r: r["finished"])
    out = {}
    for vehicle in sorted({r["vehicle"] for r in rows}):
        own = [r["cpu_s"] for r in rows if r["vehicle"] == vehicle]
        out[vehicle] = [float(np.median(part)) for part in np.array_split(own, 4)]
    return {"vehicles": out, "logs": len(rows)}


def brief(one: FleetRanking) -> dict[str, Any]:
    """The heaviest group of a vehicle: its weight, how many sets it has, and the plainest of them."""
    r = one.ranking
    assert r is not None
    best = r.sets[0]
    values = {k: [float(v) for v in theta] for k, theta in best.theta.items()}
    about = {"vehicle": one.vehicle, "flights": len(r.flights), "names": list(best.names), "set": list(best.keys)}
    group = r.groups[0]
    about |= {"weight": sum(s.weight for s in group), "words": len(group)}
    return {**about, "log_odds": best.log_odds, "gain": best.gain, "values": values}


def differences(first_run: Path, second_run: Path) -> dict[str, Any]:
    """The largest relative differences between two runs: of evidence log by log, and of everything in the rankings."""
    stores = [Store(str(p)) for p in (first_run, second_run)]
    good = [{d.key for d in s.done().values() if not d.failed} for s in stores]
    keys = sorted(good[0] & good[1])
    worst = 0.0
    for a, b in zip(*(s.evidence(keys) for s in stores), strict=True):
        for name, value in vars(unpacked(a)).items():
            if isinstance(value, np.ndarray):
                other = getattr(unpacked(b), name)
                size = max(float(np.max(np.abs(value), initial=0.0)), 1e-300)
                worst = max(worst, float(np.max(np.abs(value - other), initial=0.0)) / size)
    both = [rankings(s, keys, 1) for s in stores]
    odds = [_numbers(r, lambda s: s.log_odds) for r in both]
    gains = [_numbers(r, lambda s: s.gain) for r in both]
    order = [[s.keys for one in r if one.ranking for s in one.ranking.sets] for r in both]
    return {
        "logs": len(keys),
        "evidence": worst,
        "order": order[0] == order[1],
        "sets": len(order[0]),
        "log_odds": _worst(*odds),
        "gain": _worst(*gains),
    }


def _numbers(
    found_rankings: list[FleetRanking], of: Callable[[Any], float]
) -> dict[tuple[str, tuple[str, ...]], float]:
    return {(r.vehicle, s.keys): of(s) for r in found_rankings if r.ranking for s in r.ranking.sets}


def _worst(a: dict[Any, float], b: dict[Any, float]) -> float:
    return max((abs(a[k] - b[k]) / max(abs(a[k]), 1.0) for k in a.keys() & b.keys()), default=0.0)
