"""Fly graded changes and seasons, ask `changed` and `trend`, and say how often they were right.

    python -m benchmarks.changed --rows FILE.jsonl [--page FILE] [--flights FOLDER] [--seed N] [--vehicle NAME]
                                 [--seasons N] [--minutes M]

Rows are appended as they come, a line each; the same command goes on where it was interrupted, and ends after
`--minutes` of processor time. Vehicles, effects and sizes take turns: a run that ends early has some of all.
`--flights` keeps what was flown. Needs RotorPy for all vehicles but the tilting hexarotor:
`pip install -e '.[benchmark]'`. `--no-run` makes the page of the rows that there are.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.changed.fleet import PUBLISHED, VEHICLES, Case, changed, healthy
from benchmarks.changed.judge import baseline, judged
from benchmarks.changed.page import page
from benchmarks.changed.seasons import SEASONS, season
from wrenchgap.learn.changed.changed import Baseline

Row = dict[str, Any]
COMPARED = 3
"""Healthy flights of a baseline."""


def comparisons(vehicle: str, seed: int) -> Iterator[tuple[str, list[Case], list[Case]]]:
    """Name, baseline and suspects: every block of healthy flights against changed flights in any order, in turn with
    all other healthy ones.
    """  # noqa: D205
    good, graded = healthy(vehicle, seed), changed(vehicle, seed)
    bad = [graded[k] for k in np.random.default_rng([seed, 73]).permutation(len(graded))]
    blocks = [good[k : k + COMPARED] for k in range(0, len(good) - COMPARED, COMPARED)]
    for k, block in enumerate(blocks):
        rest, mine = [c for c in good if c not in block], bad[k :: len(blocks)]
        turns = itertools.zip_longest(rest, mine)
        yield f"{vehicle}.{seed}.{k}", block, [c for pair in turns for c in pair if c is not None]


def main(argv: list[str] | None = None) -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=Path, required=True)
    parser.add_argument("--page", type=Path)
    parser.add_argument("--flights", type=Path)
    parser.add_argument("--seed", type=int, default=PUBLISHED)
    parser.add_argument("--vehicle", choices=VEHICLES)
    parser.add_argument("--seasons", type=int, default=0, help="seasons of each kind")
    parser.add_argument("--minutes", type=float, default=1e9, help="of processor time, after which the run ends")
    parser.add_argument("--no-run", action="store_true")
    a = parser.parse_args(argv)
    kept = [json.loads(line) for line in a.rows.read_text().splitlines()] if a.rows.exists() else []

    def keep(row: Row) -> bool:
        kept.append(row)
        print(row, flush=True)
        with a.rows.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        return time.process_time() < 60.0 * a.minutes

    if not a.no_run:
        run(a, kept, keep)
    if a.page is not None:
        planned = sum(len(suspects) for v in VEHICLES for *_, suspects in comparisons(v, a.seed))
        rows, seasons = ([r for r in kept if key in r] for key in ("case", "season"))
        a.page.write_text(page(rows, seasons, planned), encoding="utf-8")


def run(a: argparse.Namespace, kept: list[Row], keep: Callable[[Row], bool]) -> None:
    """Everything that has no row yet, until `keep` says that it is enough; seasons come last."""
    known = {(r["case"], r["baseline"]) for r in kept if "case" in r}
    vehicles = VEHICLES if a.vehicle is None else (a.vehicle,)
    usual: dict[str, Baseline] = {}
    for queues in zip(*(comparisons(vehicle, a.seed) for vehicle in vehicles), strict=True):
        for turn in range(max(len(suspects) for *_, suspects in queues)):
            for name, block, suspects in queues:
                if turn >= len(suspects) or (suspects[turn].name, name) in known:
                    continue
                if name not in usual:
                    usual[name] = baseline(block, a.flights)
                if not keep(judged(suspects[turn], usual[name], name, a.flights)):
                    return
    done = {r["season"] for r in kept if "season" in r}
    for k in range(a.seasons):
        for kind, size in SEASONS:
            if f"{kind}.{size:g}.{a.seed + k}" not in done and not keep(season(kind, size, a.seed + k)):
                return


if __name__ == "__main__":
    main()
