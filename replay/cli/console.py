"""Where the commands print: results on standard output, progress on standard error."""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from wrenchgap._escaping import printable

Report = Callable[[float, str], None]
"""Called with the fraction done (0 to 1) and what is being done."""

PATIENCE = 10.0
"""Seconds between lines of progress where standard error is no terminal."""


def console(least: int = 120, least_prose: int = 60) -> Any:
    """A rich console: sentences are as wide as the terminal, tables wide enough for their numbers on any.

    `least` are the columns that the widest tables need; a narrower terminal wraps their lines, but loses no digit.
    Sentences are not broken into lines shorter than `least_prose`.
    """
    from rich.console import Console
    from rich.table import Table

    known = sys.stdout.isatty() or "COLUMNS" in os.environ
    real = shutil.get_terminal_size().columns if known else 132

    class Terminal(Console):
        def print(self, *objects: Any, **options: Any) -> None:
            tables = any(isinstance(one, Table) and one.show_header for one in objects)
            width = max(real, least if tables else least_prose)
            super().print(*objects, **{"width": width} | options)

    return Terminal(width=max(real, least), highlight=False)


@contextmanager
def progress(label: str, quiet: bool = False) -> Iterator[Report]:
    """Progress of long work: a bar on a terminal that goes away, else a line every `PATIENCE` seconds."""
    if quiet:
        yield lambda fraction, words: None
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(printable(label), total=1.0)
            yield lambda fraction, words: bar.update(task, completed=fraction, description=printable(words or label))
    else:
        said = time.monotonic()

        def plain(fraction: float, words: str) -> None:
            nonlocal said
            if time.monotonic() - said > PATIENCE:
                said = time.monotonic()
                sys.stderr.write(printable(f"{label}: {100 * fraction:.0f} % {words}") + "\n")
                sys.stderr.flush()

        yield plain
