"""Where the commands print: results on standard output, progress on standard error."""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

Report = Callable[[float, str], None]
"""Called with the fraction done (0 to 1) and what is being done."""

LEAST_WIDTH = 120
"""Columns that the widest tables need; a narrower terminal wraps lines, but loses no digit."""
PATIENCE = 10.0
"""Seconds between lines of progress where standard error is no terminal."""


def console() -> Any:
    """A rich console; wide enough for the tables, whose numbers must not be cut, on a narrow terminal too."""
    from rich.console import Console

    known = sys.stdout.isatty() or "COLUMNS" in os.environ
    wide = max(shutil.get_terminal_size().columns, LEAST_WIDTH) if known else 132
    return Console(width=wide, highlight=False)


@contextmanager
def progress(label: str, quiet: bool = False) -> Iterator[Report]:
    """Progress of long work: a bar on a terminal that goes away, else a line every `PATIENCE` seconds."""
    if quiet:
        yield lambda fraction, words: None
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(label, total=1.0)
            yield lambda fraction, words: bar.update(task, completed=fraction, description=words or label)
    else:
        said = time.monotonic()

        def plain(fraction: float, words: str) -> None:
            nonlocal said
            if time.monotonic() - said > PATIENCE:
                said = time.monotonic()
                sys.stderr.write(f"{label}: {100 * fraction:.0f} % {words}\n")
                sys.stderr.flush()

        yield plain
