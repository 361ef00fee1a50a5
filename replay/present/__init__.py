"""How results read: every sentence, table, figure and JSON document is made here and nowhere else.

    numbers      how a number is printed: digits, signs, units, per cent
    tables       lines and tables, the parts of which printed results are made
    notes        typed notes as sentences, and what the checks of the flights said
    posterior    what a search over sets of effects found
    documents    JSON files with their schema, and files that are written whole or not at all
    figures/     how pictures look
    report/      the HTML page

and one module for each kind of result, with `parts` (all that is printed, the answer first), `to_json`, `frame` (of
what `to_frame` makes its table), `picture` (panels, size, what is drawn), and where they say something `brief` (the
answer in at most `tables.ANSWER_LINES` lines, and the one table that it rests on), `of_axes` (arrays (6,) by name) and
`of_parameters` (a row for each), of which `by_axis` and `by_parameter` are made.
"""

from importlib import import_module
from itertools import takewhile
from pathlib import Path
from typing import Any

MODULES = {
    "AllocationExport": "allocation",
    "FlownExport": "flown",
    "Learnt": "learning",
    "LogReport": "inspection",
    "OpenLoop": "prediction",
    "Sheet": "model",
}
"""Which module presents a result whose class has another name than it; the others have the names of their classes."""


def text(result: Any) -> str:
    """A result as it is printed."""
    return _printed(parts(result))


def brief(result: Any, lines: int = 32) -> str:
    """A result on one screen: all of it, or its answer and as many of its parts as fit so many `lines`."""
    whole = text(result)
    if whole.count("\n") < lines:
        return whole
    some = parts(result, details=False)
    fitting = [k for k in range(1, len(some)) if _printed(some[:k]).count("\n") < lines - 2]
    return f"{_printed(some[: max(fitting, default=1)])}\n\nThat is the answer; print() shows all of it."


def by_axis(result: Any) -> Any:
    """What a result has of each axis of the wrench as a table of pandas: its unit, and a column for each quantity."""
    from wrenchgap.flight import AXES
    from wrenchgap.replay.present.numbers import unit_of

    columns = _asked(result, "of_axes", "compare, where, explain, add, calibrate, learn_gp, changed, counterfactual")
    units, pd = [unit_of(k) for k in range(len(AXES))], _pandas()
    return pd.DataFrame({"unit": units, **columns}, index=pd.Index(AXES, name="axis"))


def by_parameter(result: Any) -> Any:
    """Fitted parameters as a table of pandas, by effect and parameter."""
    pd = _pandas()
    rows = _asked(result, "of_parameters", "explain, add, calibrate, changed")
    return pd.DataFrame(rows).set_index(["effect", "parameter"]) if rows else pd.DataFrame(rows)


def _pandas() -> Any:
    """pandas; raises UsageError where it is not installed."""
    from wrenchgap.flight.extras import needed_for

    with needed_for("tables of pandas"):
        import pandas as pd

    return pd


def _asked(result: Any, what: str, known: str) -> Any:
    """What the module of a result says of it under a name; raises UsageError where it says nothing."""
    from wrenchgap.flight import UsageError

    module = _module(result)
    if not hasattr(module, what):
        raise UsageError(f"{type(result).__name__} has no numbers {what.replace('_', ' ')}; results of {known} have")
    return getattr(module, what)(result)


def _printed(some: Any, width: int = 132) -> str:
    """Lines and tables as text of so many columns."""
    from io import StringIO

    from rich.console import Console

    from wrenchgap.replay.present.tables import show

    console = Console(width=width, highlight=False, file=StringIO(), color_system=None, force_jupyter=False)
    for part in some:
        show(console, part)
    printed: str = console.file.getvalue()  # type: ignore[attr-defined]
    return printed.rstrip()


def parts(result: Any, *, details: bool = True, **how: Any) -> Any:
    """The lines and tables of a printed result, with options of its module: the answer, what its checks say, tables.

    Without `details` the answer and its one table, where there is more than that.
    """
    from wrenchgap.replay.present.notes import banner
    from wrenchgap.replay.present.tables import Line

    module = _module(result)
    whole = details or not hasattr(module, "brief")
    some = module.parts(result, **how) if whole else module.brief(result)
    answer = list(takewhile(lambda part: isinstance(part, Line) and part.text, some))
    return [*answer, *banner(result, details=whole), *some[len(answer) :]]


def to_json(result: Any) -> dict[str, Any]:
    """The body of a result's JSON document, in plain types."""
    from wrenchgap.replay.present.documents import plain
    from wrenchgap.replay.present.notes import checks_json

    body: dict[str, Any] = plain({**checks_json(result), **_module(result).to_json(result)})
    return body


def to_frame(result: Any) -> Any:
    """A result as a table of pandas."""
    return _pandas().DataFrame(_module(result).frame(result))


def plot(result: Any, axes: Any = None) -> Any:
    """A result drawn into axes (new ones of pyplot where none are given), which are returned."""
    from wrenchgap.replay.present.figures import style

    return style.plot(_module(result).picture(result), axes)


def save_figure(result: Any, path: Path, *, force: bool = False) -> None:
    """Write a result's picture as PNG, all of it or nothing, without a window.

    Raises UsageError for a file that exists (unless `force`) or that cannot be written.
    """
    from wrenchgap.flight.atomic import atomic
    from wrenchgap.replay.present.documents import claim
    from wrenchgap.replay.present.figures import style

    claim({"--figure": path}, force=force)
    picture = _module(result).picture(result)
    with atomic(path) as partial:
        style.save(picture, partial)


def save_page(result: Any, path: Path, *, force: bool) -> None:
    """Write the HTML page of a report; raises UsageError where the file exists and `force` is not given."""
    _module(result).save(result, path, force=force)


def _module(result: Any) -> Any:
    """What presents a result: imported when one is printed, not before."""
    name = type(result).__name__
    return import_module(f"{__name__}.{MODULES.get(name, name.lower())}")
