"""Libraries that only some formats need, asked for when such a file is opened."""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from wrenchgap.flight.errors import LogError


def required(module: str, extra: str, what: str, path: Path) -> Any:
    """A module of one of wrenchgap's extras; raises LogError with the command that installs it."""
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise LogError(
            f"{path}: {what} need {package}, which is not installed; pip install 'wrenchgap[{extra}]'"
        ) from error


class Nowhere(io.TextIOBase):
    """Text that nobody reads, and that is not kept: of a damaged log a library may say a line for every byte."""

    def write(self, text: str) -> int:
        """Forget it."""
        return len(text)


@contextlib.contextmanager
def silenced() -> Iterator[None]:
    """What a library and its C code print of damaged files does not reach the user; we say it in our own words."""
    with Nowhere() as nothing, contextlib.redirect_stdout(nothing), contextlib.redirect_stderr(nothing):
        try:
            kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
        except OSError:  # no standard error to be silenced
            yield
            return
        try:
            os.dup2(nowhere, 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            os.close(nowhere)
