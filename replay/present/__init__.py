"""How results read: every sentence, table, figure and JSON document is made here and nowhere else.

    numbers      how a number is printed: digits, signs, units, per cent
    tables       lines and tables, the parts of which printed results are made
    notes        typed notes as sentences
    checks       what the checks of the flights said
    documents    JSON files with their schema, and files that are written whole or not at all
    figures/     matplotlib
    report/      the HTML page

and one module for each kind of result, with `parts` (what is printed), `to_json` and `to_frame`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

MODULES = {
    "Addition": "addition",
    "Calibration": "calibration",
    "Changed": "changed",
    "Comparison": "comparison",
    "Counterfactual": "counterfactual",
    "Design": "design",
    "Explanation": "explanation",
    "Export": "export",
    "FlownExport": "flown",
    "Learnt": "learning",
    "LogReport": "inspection",
    "Replay": "replay",
    "Report": "report",
    "Sheet": "model",
    "Trend": "trend",
    "Where": "where",
}
"""Which module presents which result, by the name of its class; its figures are in the module of that name in
figures/.
"""
WIDTH = 132
"""Columns of printed text."""


def text(result: Any) -> str:
    """A result as it is printed."""
    from io import StringIO

    from rich.console import Console

    from wrenchgap.replay.present.tables import show

    console = Console(width=WIDTH, highlight=False, file=StringIO(), color_system=None, force_jupyter=False)
    for part in parts(result):
        show(console, part)
    printed: str = console.file.getvalue()  # type: ignore[attr-defined]
    return printed.rstrip()


def parts(result: Any) -> Any:
    """The lines and tables of a printed result; what its checks say stands above."""
    from wrenchgap.replay.present.checks import banner

    return [*banner(result), *_module(result).parts(result)]


def to_json(result: Any) -> dict[str, Any]:
    """The body of a result's JSON document, in plain types."""
    from wrenchgap.replay.present.checks import checks_json
    from wrenchgap.replay.present.documents import plain

    body: dict[str, Any] = plain({**checks_json(result), **_module(result).to_json(result)})
    return body


def to_frame(result: Any) -> Any:
    """A result as a table of pandas."""
    return _module(result).to_frame(result)


def plot(result: Any, axes: Any = None) -> Any:
    """A result drawn into axes (new ones where none are given), which are returned."""
    return import_module(f"{__name__}.figures").plot(result, axes)


def save_page(result: Any, path: Path, *, force: bool) -> None:
    """Write the HTML page of a report; raises UsageError where the file exists and `force` is not given."""
    _module(result).save(result, path, force=force)


def _module(result: Any) -> Any:
    return import_module(f"{__name__}.{MODULES[type(result).__name__]}")
