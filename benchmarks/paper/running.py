"""How an experiment is run: two processes, a progress bar, numbers as JSON, figures as PNG, tables as Markdown."""

from __future__ import annotations

import argparse
import importlib
import json
import math
import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

ROOT = Path(__file__).parents[2]
RESULTS, IMAGES = Path(__file__).parent / "results", ROOT / "docs" / "images"
PAGES = ROOT / "docs" / "paper.md", ROOT / "benchmarks" / "notes" / "paper.md"
PROCESSES = 2
DIGITS = 4
"""Significant digits of numbers in the results."""

EXPERIMENTS = ("prediction", "pitch", "figure8", "uncertainty", "compute", "conditioning", "beyond", "feedback")
"""Modules of this package, in the order of the paper."""

A, B = TypeVar("A"), TypeVar("B")
Report = Callable[[float, str], None]
"""Called with the share done (0 to 1) and what is being done."""
Keep = Callable[[dict[str, Any]], None]
"""Called with the numbers whenever a row is added to them."""


@dataclass(frozen=True)
class Output:
    """Where results and figures go."""

    results: Path = RESULTS
    images: Path = IMAGES

    @classmethod
    def under(cls, folder: Path | None) -> Output:
        """Everything in one folder; the repository's own places without one."""
        return cls() if folder is None else cls(folder, folder)

    def image(self, name: str) -> Path:
        """The file of a figure."""
        self.images.mkdir(parents=True, exist_ok=True)
        return self.images / f"paper-{name}.png"

    def write(self, name: str, body: dict[str, Any]) -> None:
        """The numbers of an experiment, rounded."""
        self.results.mkdir(parents=True, exist_ok=True)
        (self.results / f"{name}.json").write_text(json.dumps(plain(body), indent=1) + "\n", encoding="utf-8")

    def read(self, name: str) -> dict[str, Any] | None:
        """The numbers of an experiment, None where it has not been run."""
        path = self.results / f"{name}.json"
        return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None


def experiment(name: str) -> Any:
    """The module of this name.

    Its `run(quick, out, report)` draws the figures and returns the numbers; its `tables(numbers)` makes them Markdown.
    """
    return importlib.import_module(f"benchmarks.paper.{name}")


def in_parallel(function: Callable[[A], B], arguments: Sequence[A], report: Report, words: str) -> list[B]:
    """Results in order, from forked processes; these inherit both arguments, which may be anything."""
    found: list[B] = []
    report(0.0, words)
    _inherited.append(lambda index: function(arguments[index]))
    try:
        with multiprocessing.get_context("fork").Pool(min(PROCESSES, len(arguments))) as pool:
            for result in pool.imap(_inherit, range(len(arguments))):
                found.append(result)
                report(len(found) / len(arguments), words)
    finally:
        _inherited.pop()
    return found


_inherited: list[Callable[[int], Any]] = []


def _inherit(index: int) -> Any:
    return _inherited[-1](index)


def main(names: Sequence[str]) -> None:
    """Command line of one or all experiments."""
    parser = argparse.ArgumentParser(description="The paper's experiments on a simulated VoliroX.")
    parser.add_argument("--quick", action="store_true", help="a small version: short flights, few seeds")
    parser.add_argument("--missing", action="store_true", help="only rows that kept results lack (not all experiments)")
    parser.add_argument("--out", type=Path, help="folder for results and figures (default: the repository's own)")
    a = parser.parse_args()
    if a.quick and a.out is None:
        parser.error("--quick would overwrite the results kept in the repository; give --out FOLDER")
    out = Output.under(a.out)
    console = Console()
    for name in names:
        with _progress(name) as report:
            kept = out.read(name) if a.missing else None
            made = experiment(name)
            if kept is None:
                out.write(name, made.run(a.quick, out, report))
            else:
                made.missing(kept, report, partial(out.write, name))
        console.print(experiment(name).tables(out.read(name) or {}), markup=False, highlight=False, soft_wrap=True)
    if a.out is None:
        from benchmarks.paper.page import renew

        renew(out)


@contextmanager
def _progress(name: str) -> Iterator[Report]:
    columns = (TextColumn("[bold]{task.description}"), BarColumn(), TextColumn("{task.fields[words]}"))
    with Progress(*columns, TimeElapsedColumn()) as progress:
        task = progress.add_task(name, total=1.0, words="")
        yield lambda share, words: progress.update(task, completed=share, words=words)


def plain(value: Any) -> Any:
    """Numbers with `DIGITS` significant digits, in plain types."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value


def median(parts: list[Any]) -> Any:
    """Median, leaf by leaf."""
    if isinstance(parts[0], dict):
        return {k: median([p[k] for p in parts]) for k in parts[0]}
    return np.median(np.array(parts), axis=0)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table; the first column is text, the others numbers."""
    rule = ["---", *["---:"] * (len(head) - 1)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, rule, *rows))


def triple(values: Sequence[float | None], digits: int = 3) -> str:
    """Three numbers with slashes between them."""
    return " / ".join("-" if v is None else f"{v:.{digits}f}" for v in values)


def percent(fall: Sequence[float | None]) -> str:
    """Change of x / y / z in percent, from shares taken off."""
    return " / ".join("-" if v is None else f"{-100 * v:+.1f}" for v in fall)


def falls(error: Sequence[float], base: Sequence[float]) -> list[float]:
    """Shares of `base` taken off."""
    return [1.0 - a / b for a, b in zip(error, base, strict=True)]


def change(error: Sequence[float], base: Sequence[float]) -> str:
    """Change from `base` in percent."""
    return percent(falls(error, base))


def mrad(values: Sequence[float]) -> str:
    """Three angles [rad] in mrad."""
    return triple([1e3 * v for v in values], 1)
