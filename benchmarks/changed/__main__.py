"""Fly graded changes and seasons, ask `changed` and `trend`, and say how often they were right.

    python -m benchmarks.changed --json FILE [--page FILE] [--flights FOLDER] [--seed N] [--vehicle NAME] [--seasons N]

Rows are written as they come; the same command goes on where it was interrupted. `--flights` keeps what was flown.
Needs RotorPy for all vehicles but the tilting hexarotor: `pip install -e '.[benchmark]'`. `--no-run` makes the page of
the rows that there are.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.changed.fleet import PUBLISHED, VEHICLES, Case, changed, healthy
from benchmarks.changed.judge import baseline, judged
from benchmarks.changed.page import page
from benchmarks.changed.seasons import SEASONS, season

COMPARED = 3
"""Healthy flights of a baseline."""


def comparisons(vehicle: str, seed: int) -> Iterator[tuple[str, list[Case], list[Case]]]:
    """Name, baseline and suspects: every block of healthy flights against changed flights in turn, and against all
    other healthy ones.
    """  # noqa: D205
    good, bad = healthy(vehicle, seed), changed(vehicle, seed)
    blocks = [good[k : k + COMPARED] for k in range(0, len(good) - COMPARED, COMPARED)]
    for k, block in enumerate(blocks):
        rest = [c for c in good if c not in block]
        mixed = [c for pair in zip(rest, bad[k :: len(blocks)], strict=False) for c in pair]
        yield f"{vehicle}.{k}", block, [*mixed, *(c for c in (*rest, *bad[k :: len(blocks)]) if c not in mixed)]


def main(argv: list[str] | None = None) -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--page", type=Path)
    parser.add_argument("--flights", type=Path)
    parser.add_argument("--seed", type=int, default=PUBLISHED)
    parser.add_argument("--vehicle", choices=VEHICLES)
    parser.add_argument("--seasons", type=int, default=0, help="seasons of each kind")
    parser.add_argument("--no-run", action="store_true")
    a = parser.parse_args(argv)
    kept: dict[str, list[dict[str, Any]]] = {"rows": [], "seasons": []}
    if a.json.exists():
        kept |= json.loads(a.json.read_text())

    def keep(kind: str, row: dict[str, Any]) -> None:
        kept[kind].append(row)
        print(row, flush=True)
        lines = [f'"{k}": [\n' + ",\n".join(json.dumps(r) for r in kept[k]) + "\n]" for k in kept]
        a.json.write_text("{" + ",\n".join(lines) + "}\n", encoding="utf-8")

    if not a.no_run:
        run(a, kept, keep)
    if a.page is not None:
        a.page.write_text(page(kept["rows"], kept["seasons"]), encoding="utf-8")


def run(a: argparse.Namespace, kept: dict[str, list[dict[str, Any]]], keep: Any) -> None:
    """Everything that has no row yet; seasons come first."""
    done = {s["season"] for s in kept["seasons"]}
    for k in range(a.seasons):
        for kind, size in SEASONS:
            if f"{kind}.{size:g}.{a.seed + k}" not in done:
                keep("seasons", season(kind, size, a.seed + k))
    known = {(r["case"], r["baseline"]) for r in kept["rows"]}
    for vehicle in VEHICLES if a.vehicle is None else (a.vehicle,):
        for name, block, suspects in comparisons(vehicle, a.seed):
            left = [c for c in suspects if (c.name, name) not in known]
            usual = baseline(block, a.flights) if left else None
            for case in left:
                assert usual is not None
                keep("rows", judged(case, usual, name, a.flights))


if __name__ == "__main__":
    main()
