"""Fly the field, explain every flight, and say how often the answer was right.

    python -m benchmarks.field [--seed N] [--only TEXT ...] [--vehicle NAME] [--seconds S] [--jobs N]
                               [--json FILE] [--page FILE] [--notes FILE] [--logs FOLDER]

Rows are written as they come; with --json an interrupted run goes on where it was. Needs RotorPy for all vehicles but
the tilting hexarotor: `pip install -e '.[benchmark]'`. `--logs` writes the flights for the command line instead of
explaining them.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import traceback
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from rich.progress import Progress

from benchmarks.field import cases
from benchmarks.field.judge import flown, run
from benchmarks.field.score import detail, page, score
from benchmarks.hidden_effects.__main__ import rounded
from benchmarks.hidden_effects.score import written_by_hand
from wrenchgap import save_log

Row = dict[str, Any]


def _work(case: cases.Case) -> Row:
    try:
        return run(case)
    except Exception as error:  # a lost flight is a row too, not the end of the benchmark
        return {"case": case.name, "kind": case.kind, "error": repr(error), "trace": traceback.format_exc()}


def _options(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Benchmark of explanations on several vehicles.")
    parser.add_argument("--seed", type=int, default=cases.PUBLISHED, help="first seed; 7000 is for tuning")
    parser.add_argument("--only", nargs="+", help="flights whose name has one of these in it")
    parser.add_argument("--vehicle", help="nano, quad, x8, blind or hexa")
    parser.add_argument("--seconds", type=float, help="length of every flight, for a quick look")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json", type=Path, help="rows and scores")
    parser.add_argument("--page", type=Path, help="the page for docs/")
    parser.add_argument("--notes", type=Path, help="the page with every flight, for benchmarks/notes")
    parser.add_argument("--logs", type=Path, help="write logs and model files here instead of explaining")
    return parser.parse_args(argv)


def main(argv: list[str] | None = None) -> None:
    """See the module."""
    a = _options(argv)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    field = list(cases.everything(a.seed))
    if a.seconds:
        field = list(cases.shorter(iter(field), a.seconds))
    wanted = [
        c for c in field if (not a.only or any(text in c.name for text in a.only)) and a.vehicle in (None, c.vehicle)
    ]
    if a.logs:
        write_logs(wanted, a.logs)
        return
    rows: list[Row] = json.loads(a.json.read_text())["rows"] if a.json and a.json.exists() else []
    done = {row["case"] for row in rows}
    todo = [c for c in wanted if c.name not in done]
    with ProcessPoolExecutor(a.jobs) as pool, Progress() as progress:
        task = progress.add_task("flights", total=len(todo))
        for future in as_completed([pool.submit(_work, c) for c in todo]):
            rows.append(future.result())
            progress.advance(task)
            progress.console.print(line(rows[-1]), highlight=False, soft_wrap=True)
            if a.json:
                _write(a.json, rows, field)
    rows = _ordered(rows, field)
    sys.stdout.write(json.dumps(score(rows), indent=1) + "\n")
    if a.json:
        _write(a.json, rows, field)
    if a.page:
        a.page.write_text(page(rows, len(field), written_by_hand(a.page)), encoding="utf-8")
    if a.notes:
        a.notes.write_text(detail(rows, written_by_hand(a.notes)), encoding="utf-8")


def write_logs(wanted: list[cases.Case], folder: Path) -> None:
    """Every flight as MCAP, the model files beside them, and truth.json with what was hidden."""
    folder.mkdir(parents=True, exist_ok=True)
    hidden = {}
    for case in wanted:
        flight, _, model = flown(case)
        save_log(flight, folder / f"{case.name}.mcap", force=True)
        if model.path is not None:
            shutil.copy(model.path, folder)
        hidden[case.name] = {"effects": case.effects, "scales": case.scales, "kind": case.kind}
    (folder / "truth.json").write_text(json.dumps(hidden, indent=1) + "\n")


def line(row: Row) -> str:
    """One row for the eye."""
    if "error" in row:
        return f"ERROR   {row['case']}: {row['error'][:150]}"
    mark = {True: "in class", False: "NOT IN IT", None: ""}[row["in_class"]]
    wrong = f"  FIRM AND WRONG: {', '.join(row['firm_wrong'])}" if row["firm_wrong"] else ""
    return f"{mark:10s} {row['case']:48s} {row['verdict']}: {', '.join(row['effects'])}{wrong}"


def _ordered(rows: list[Row], field: list[cases.Case]) -> list[Row]:
    order = {c.name: k for k, c in enumerate(field)}
    return sorted(rows, key=lambda r: order.get(r["case"], len(order)))


def _write(path: Path, rows: list[Row], field: list[cases.Case]) -> None:
    rows = _ordered(rows, field)
    lines = ",\n".join(json.dumps(rounded(row)) for row in rows)
    path.write_text(f'{{"scores": {json.dumps(rounded(score(rows)))},\n"rows": [\n{lines}\n]}}\n')


if __name__ == "__main__":
    main()
