"""Libraries that only some formats need, asked for when such a file is opened."""

from __future__ import annotations

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
