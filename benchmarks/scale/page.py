"""The tables of docs/scale.md, written from the runs that are kept."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks import pages
from benchmarks.harm.rows import kept
from benchmarks.paper.running import table

PAGE = Path(__file__).parents[2] / "docs" / "scale.md"
RESULTS = Path(__file__).parent / "results" / "runs.jsonl"

LOGS = 100_000
MEGABYTES = 20.0
"""Assumed size of one log of the estimate [MB]: ten minutes at 50 to 200 Hz."""
MINUTES = 10.0
"""Assumed length of one of them [min]."""
EXPLAINED_SECONDS = 12.4
"""What `explain` takes on ten minutes at 200 Hz on one idle core, docs/performance.md [s]; for comparison."""
CORE_HOUR = 0.05
"""Assumed price of a core hour [USD]: on-demand virtual machines of the large clouds, 2026."""
GET, PUT, GIGABYTE_MONTH = 0.4e-6, 5e-6, 0.023
"""Assumed prices of an object store [USD]: a GET, a PUT, a GB for a month; within a region reading is free."""
TRIANGLES = 8.0 * 11 * 6 * 141 * 142 / 2
"""Bytes of the evidence of a long flight of a hexarotor: a triangle for every band and axis, before compression."""
BANDWIDTH = 100.0
"""Assumed bytes that a worker core reads from the store [MB/s]."""


def of_runs(found: dict[str, dict[str, Any]]) -> str:
    """Costs per log of every run."""
    head = [
        "run",
        "logs",
        "failed",
        "killed",
        "cpu per log, median [s]",
        "mean",
        "most",
        "wall [s]",
        "wall per log [s]",
    ]
    head += ["read per log [kB]", "kept per log [kB]"]
    lines = []
    for key in sorted(
        (k for k in found if k.split()[0] in ("cluster", "serial")), key=lambda k: (k.split()[0], int(k.split()[1]))
    ):
        r = found[key]
        cpu, wall = r["cpu"], r["seconds"]["work"]
        costs = [f"{cpu[name]:.2f}" for name in ("median", "mean", "most")]
        size = [f"{r['bytes'][name] / 1e3:.0f}" for name in ("read", "kept")]
        killed = str(r.get("killed", "-"))
        lines.append(
            [key, str(r["logs"]), str(r["failed"]), killed, *costs, f"{wall:.0f}", f"{wall / r['logs']:.2f}", *size]
        )
    return table(head, lines)


def of_course(found: dict[str, dict[str, Any]]) -> str:
    """Costs per log against the number of logs done before it."""
    key = _largest(found, "course")
    if key is None:
        return ""
    lines = [[v, *(f"{cpu:.2f}" for cpu in quarters)] for v, quarters in found[key]["vehicles"].items()]
    return table(["cpu per log, median [s]", "first quarter of its logs", "second", "third", "last"], lines)


def of_memory(found: dict[str, dict[str, Any]]) -> str:
    """Memory on the way, of the largest run on the cluster."""
    largest = _largest(found, "cluster")
    if largest is None:
        return ""
    lines = []
    for done, driver, *workers in found[largest]["memory"]:
        lines.append(
            [
                str(int(done)),
                f"{driver:.0f}",
                *(f"{w:.0f}" if w == w else "-" for w in (workers + [float("nan")] * 2)[:2]),
            ]
        )
    return table(["logs done", "scheduler and driver [MB]", "worker 1 [MB]", "worker 2 [MB]"], lines)


def of_refused(found: dict[str, dict[str, Any]]) -> str:
    """Memory of the scheduler's process over many files that are no logs."""
    key = _largest(found, "refused")
    if key is None:
        return ""
    noted = found[key]["memory"][1::3]
    head = ["files done", *(f"{int(done):,}" for done, _ in noted)]
    return table(head, [["scheduler and driver [MB]", *(f"{mb:.0f}" for _, mb in noted)]])


def of_difference(found: dict[str, dict[str, Any]]) -> str:
    """The cluster's run against the serial one."""
    key = _largest(found, "difference")
    if key is None:
        return ""
    r = found[key]
    rows = [
        ["logs in both", str(r["logs"])],
        ["largest relative difference of a log's evidence", f"{r['evidence']:.1g}"],
        ["sets ranked; same order", f"{r['sets']}; {'yes' if r['order'] else 'no'}"],
        ["largest relative difference of log odds", f"{r['log_odds']:.1g}"],
        ["largest relative difference of gains on held-out flights", f"{r['gain']:.1g}"],
    ]
    return table(["cluster with a worker killed, against serial", ""], rows)


def of_rankings(found: dict[str, dict[str, Any]]) -> str:
    """What the fleet's rankings name."""
    key = _largest(found, "ranking")
    if key is None:
        return ""
    lines = []
    for r in found[key]["rankings"]:
        values = "; ".join(f"{k} {', '.join(f'{v:.3g}' for v in theta)}" for k, theta in r["values"].items())
        named = ", ".join(r["names"]) or "nothing"
        lines.append(
            [
                r["vehicle"],
                str(r["flights"]),
                named,
                ", ".join(r["set"]),
                f"{100 * r['weight']:.0f} %",
                str(r["words"]),
                values,
            ]
        )
    return table(["vehicle", "flights", "named", "plainest set", "weight of its group", "sets in it", "values"], lines)


def of_estimate(found: dict[str, dict[str, Any]]) -> str:
    """100,000 logs on object storage, from the costs of a log of the largest run."""
    key = _largest(found, "cluster")
    if key is None:
        return ""
    r = found[key]
    short, size = r["cpu"]["mean"], r["bytes"]["read"] / 1e6
    long = short * 60.0 * MINUTES / r["flight_seconds"]
    rows = []
    for name, cpu, megabytes, kept_bytes in (
        (f"as measured: {r['flight_seconds']:.1f} s used, {size:.1f} MB", short, size, r["bytes"]["kept"]),
        (
            f"{MINUTES:.0f} minutes, {MEGABYTES:.0f} MB, all of the cost in proportion (upper end)",
            long,
            MEGABYTES,
            TRIANGLES,
        ),
    ):
        hours = LOGS * cpu / 3600.0
        reading = LOGS * megabytes / BANDWIDTH / 3600.0
        stored = LOGS * kept_bytes / 1e9
        money = (hours + reading) * CORE_HOUR + LOGS * (GET + PUT) + stored * GIGABYTE_MONTH
        cells = [
            f"{cpu:.2f}",
            f"{hours:.0f}",
            f"{reading:.1f}",
            f"{LOGS * megabytes / 1e6:.2f}",
            f"{stored:.0f}",
            f"{money:.0f}",
        ]
        rows.append([name, *cells, f"{(hours + reading) / 64.0 * 60:.0f}"])
    head = ["one log", "cpu [s]", "core hours", "core hours waiting for bytes", "read [TB]", "kept [GB]", "cost [USD]"]
    return table([*head, "64 cores [min]"], rows)


def _largest(found: dict[str, dict[str, Any]], kind: str) -> str | None:
    keys = [k for k in found if k.split()[0] == kind]
    return max(keys, key=lambda k: int(k.split()[1]), default=None)


def renew(page: Path = PAGE) -> None:
    """Write the page with the tables of the runs that are kept."""
    found = kept(RESULTS)
    tables = {
        "runs": of_runs,
        "memory": of_memory,
        "refused": of_refused,
        "difference": of_difference,
        "rankings": of_rankings,
        "course": of_course,
        "estimate": of_estimate,
    }
    pages.renew(page, {name: make(found) for name, make in tables.items()})
