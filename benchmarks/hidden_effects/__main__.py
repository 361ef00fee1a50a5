"""Fly everything, explain everything, and say how often it was right.

    python -m benchmarks.hidden_effects [--fast] [--jobs N] [--only TEXT] [--json FILE] [--page FILE] [--notes FILE]

Rows are written as they come; with --json an interrupted run goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import traceback
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from rich.progress import Progress

from benchmarks.hidden_effects import cases
from benchmarks.hidden_effects.judge import run
from benchmarks.hidden_effects.score import detail, page, score, written_by_hand
from wrenchgap.plant import model_file

Row = dict[str, Any]


def _work(case: cases.Case) -> Row:
    try:
        return run(case, model_file.load("tilt_hexarotor"))
    except Exception as error:  # a lost flight is a row too, not the end of the benchmark
        return {"case": case.name, "kind": case.kind, "error": repr(error), "trace": traceback.format_exc()}


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description="Benchmark of naming hidden effects.")
    parser.add_argument("--fast", action="store_true", help="one flight of each kind")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seed", type=int, default=5000, help="first seed; another one makes other flights")
    parser.add_argument("--only", help="cases whose name has this in it")
    parser.add_argument("--json", type=Path, help="rows and scores")
    parser.add_argument("--page", type=Path, help="the page for docs/")
    parser.add_argument("--notes", type=Path, help="the page with every flight, for benchmarks/notes")
    a = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    wanted = [c for c in (cases.fast() if a.fast else cases.everything(a.seed)) if not a.only or a.only in c.name]
    rows: list[Row] = json.loads(a.json.read_text())["rows"] if a.json and a.json.exists() else []
    done = {row["case"] for row in rows}
    todo = [c for c in wanted if c.name not in done]
    with ProcessPoolExecutor(a.jobs) as pool, Progress() as progress:
        task = progress.add_task("flights", total=len(todo))
        for future in as_completed([pool.submit(_work, c) for c in todo]):
            row = future.result()
            rows.append(row)
            progress.advance(task)
            progress.console.print(line(row), highlight=False, soft_wrap=True)
            if a.json:
                _write(a.json, rows, wanted)
    rows = _ordered(rows, wanted)
    sys.stdout.write(json.dumps(score(rows), indent=1) + "\n")
    if a.json:
        _write(a.json, rows, wanted)
    if a.page:
        a.page.write_text(page(rows, written_by_hand(a.page)), encoding="utf-8")
    if a.notes:
        a.notes.write_text(detail(rows, written_by_hand(a.notes)), encoding="utf-8")


def line(row: Row) -> str:
    """One row for the eye."""
    if "error" in row:
        return f"ERROR   {row['case']}: {row['error'][:150]}"
    groups = " ".join(f"[{' or '.join(g)}]" for g in row["groups"])
    return f"{row['right']:14s} {row['case']:28s} {row['verdict']}: {', '.join(row['effects'])}  {groups}"


def _ordered(rows: list[Row], wanted: list[cases.Case]) -> list[Row]:
    order = {c.name: k for k, c in enumerate(wanted)}
    return sorted(rows, key=lambda r: order.get(r["case"], len(order)))


def _write(path: Path, rows: list[Row], wanted: list[cases.Case]) -> None:
    rows = _ordered(rows, wanted)
    lines = ",\n".join(json.dumps(rounded(row)) for row in rows)
    path.write_text(f'{{"scores": {json.dumps(score(rows))},\n"rows": [\n{lines}\n]}}\n')


def rounded(value: Any) -> Any:
    """Six digits: what a reader compares, and a file that fits a repository."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, dict):
        return {k: rounded(v) for k, v in value.items()}
    return [rounded(v) for v in value] if isinstance(value, list) else value


if __name__ == "__main__":
    main()
