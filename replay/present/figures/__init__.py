"""Results as pictures: one module for each kind of result, named as its module in `wrenchgap.replay.present`.

A module says what its picture is (`picture(result)`: panels, size, what is drawn); `style` makes figures of it. Drawn
into axes of the user or into a new figure of pyplot (so that a notebook shows it) by `plot`, into a file by `save`.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any


def picture(result: Any) -> Any:
    """What a result looks like: a `style.Picture`."""
    from wrenchgap.replay.present import MODULES

    return import_module(f"{__name__}.{MODULES[type(result).__name__]}").picture(result)


def plot(result: Any, axes: Any = None) -> Any:
    """A result drawn into axes (new ones of pyplot where none are given), which are returned."""
    from wrenchgap.replay.present.figures import style

    return style.plot(picture(result), axes)


def save(result: Any, path: Path, *, force: bool = False) -> None:
    """Write a result's picture as PNG, all of it or nothing, without a window.

    Raises UsageError for a file that exists (unless `force`) or that cannot be written.
    """
    from wrenchgap.replay.present.documents import atomic, claim
    from wrenchgap.replay.present.figures import style

    claim({"--figure": path}, force=force)
    figure = style.figure_of(picture(result))
    with atomic(path) as partial:
        figure.savefig(partial, dpi=110, format="png")
