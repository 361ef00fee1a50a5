"""Figures of the results, with matplotlib: `plot(result, axes)` draws into axes, `save` writes a PNG."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def save(result: Any, path: Path, *, force: bool = False) -> None:
    """Draw a result and write it as PNG, all of it or nothing."""
    raise NotImplementedError(f"{type(result).__name__}: no figure yet")
