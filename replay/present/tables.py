"""Tables and lines, the parts of which every printed result is made. They show; nothing is computed here."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from rich import box
from rich.markup import escape
from rich.table import Table

from wrenchgap.flight.flight import Array
from wrenchgap.plant.history import Snapshot
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.replay.present.numbers import UNIT_HEADS, change, label, number, row, unit

COLOURED = 0.1
"""Reduction from which on it is coloured."""
INTERVAL_LEGEND = (
    "+-: one standard deviation. It never falls below 3 % of the value, because the forms of effects are right to a "
    "few per cent only (docs/decisions/0009-honest-intervals.md)"
)
"""What stands below tables of `parameters`."""

COMMAND = ": wrenchgap "
"""In lines that give a command to copy."""


@dataclass(frozen=True)
class Line:
    """A line of text without markup; `style` is one of rich's."""

    text: str = ""
    style: str = ""


Part = Table | Line


def show(console: Any, part: Part) -> None:
    """Print one part to a console of rich. A line with a command to copy stays one line."""
    if isinstance(part, Line):
        console.print(part.text, style=part.style or None, markup=False, soft_wrap=COMMAND in part.text)
    else:
        console.print(part)


def note_lines(sentences: Iterable[str], title: str = "note") -> list[Line]:
    """Plain sentences that a user should read, each once."""
    style = "yellow" if title == "warning" else "dim"
    return [Line(f"{title}: {text}", style) for text in dict.fromkeys(sentences)]


def table(title: str, *heads: str, left: int = 1) -> Table:
    """An empty table; the first `left` columns are texts."""
    out = Table(title=escape(title), box=box.SIMPLE_HEAD, title_justify="left", title_style="bold", pad_edge=False)
    for index, head in enumerate(heads):
        out.add_column(escape(head), justify="left" if index < left else "right", overflow="fold")
    return out


def plain(title: str, heads: Sequence[str], rows: Iterable[Sequence[Any]], left: int = 1) -> Table:
    """Any rows of texts."""
    out = table(title, *heads, left=left)
    for values in rows:
        out.add_row(*(escape(str(v)) for v in values))
    return out


def reductions(values: Iterable[float]) -> list[str]:
    """Reductions of rms as changes (-95 % where 95 % are gone), coloured where they say something."""
    out = []
    for value in values:
        text = change(-float(value))
        out.append(f"[green]{text}[/]" if value > COLOURED else f"[red]{text}[/]" if value < -COLOURED else text)
    return out


def before_after(title: str, rows: Sequence[tuple[str, Array]], reduction: Array | None = None) -> Table:
    """Rows of six numbers, and the change from the first to the last."""
    out = table(title, "", *UNIT_HEADS)
    for name, values in rows:
        out.add_row(escape(name), *row(values))
    if reduction is not None:
        out.add_row("change", *reductions(reduction))
    return out


def parameters(effects: Sequence[Snapshot], title: str, vehicle: Vehicle | None = None) -> Table:
    """Effects with their values, standard deviations and units; rotors and arms by the names that `vehicle` has."""
    out = table(title, "effect", "parameter", "value", "+-", "unit", left=2)
    out.columns[-1].justify = "left"
    for effect in effects:
        for k, v in enumerate(effect.values):
            first = escape(effect.effect) if k == 0 else ""
            out.add_row(first, escape(label(v.name, vehicle)), number(v.value, 4), number(v.std, 2), unit(v.unit))
    return out
