"""Tables and lines, the parts of which every printed result is made. They show; nothing is computed here.

A text is data: what is printed of it is one line of printable characters, and nothing in it is markup. Colours and
weights are said by `styled`. No other module makes what rich prints.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from rich import box
from rich import table as rich_table
from rich.text import Text

from wrenchgap._escaping import printable
from wrenchgap.flight.flight import Array
from wrenchgap.plant.history import Snapshot
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.replay.present.numbers import UNIT_HEADS, change, label, number, row, unit

INTERVAL_LEGEND = (
    "+-: one standard deviation. It never falls below 3 % of the value, because the forms of effects are right to a "
    "few per cent only (docs/decisions/0009-honest-intervals.md)"
)
"""What stands below tables of `parameters`."""

ANSWER_LINES = 8
"""Sentences before the first table of a result, at most."""
NOTES = 4
"""Of them notes where the most important ones come first; the others stand behind the tables."""
COMMAND = ": wrenchgap "
"""In lines that give a command to copy."""


@dataclass(frozen=True)
class Line:
    """A line of text without markup; `style` is one of rich's."""

    text: str = ""
    style: str = ""


def styled(text: str, style: str = "") -> Text:
    """A text to print, in one of rich's styles."""
    return Text(printable(text), style)


class Table(rich_table.Table):
    """A table whose cells are texts, or `styled` ones; a page shows columns, rows, caption and cells as well."""

    def add_row(self, *cells: Any, **options: Any) -> None:
        """A row of cells."""
        super().add_row(*(cell if isinstance(cell, Text) else _cell(str(cell)) for cell in cells), **options)

    @property
    def cells(self) -> list[tuple[Any, ...]]:
        """The cells of each row."""
        return list(zip(*(column.cells for column in self.columns), strict=True))


def _cell(text: str, longest: int = 1000) -> Text:
    """A text in a table, of so many characters: a topic's name of 10 MB was laid out for minutes."""
    return styled(text if len(text) <= longest else f"{text[:longest]}...")


Part = Table | Line


def show(console: Any, part: Part) -> None:
    """Print one part to a console of rich. A line with a command to copy stays one line."""
    if isinstance(part, Line):
        console.print(styled(part.text), style=part.style or None, soft_wrap=COMMAND in part.text)
    else:
        console.print(part)


def note_lines(sentences: Iterable[str], title: str = "note") -> list[Line]:
    """Plain sentences that a user should read, each once."""
    style = "yellow" if title == "warning" else "dim"
    return [Line(f"{title}: {text}", style) for text in dict.fromkeys(sentences)]


def table(
    title: str,
    heads: Sequence[str | Sequence[str]],
    rows: Iterable[Sequence[Any]] = (),
    left: int = 1,
    texts: Sequence[int] = (),
    caption: str = "",
) -> Table:
    """A table of rows; the first `left` columns and those of `texts` are texts. A head is a line, or several."""
    named = {*range(left), *(k % len(heads) for k in texts)}
    look: dict[str, Any] = {"title_justify": "left", "title_style": "bold", "caption_justify": "left"}
    out = Table(title=styled(title) if title else None, caption=caption, box=box.SIMPLE_HEAD, pad_edge=False, **look)
    for index, head in enumerate(heads):
        lines = [_cell(line) for line in ([head] if isinstance(head, str) else head)]
        out.add_column(Text("\n").join(lines), justify="left" if index in named else "right", overflow="fold")
    for values in rows:
        out.add_row(*values)
    return out


def captioned(shown: Table, words: str) -> Table:
    """A table of the terminal with what a page says of it."""
    shown.caption = words
    return shown


def first_only(names: Iterable[str]) -> list[str]:
    """Names of rows, empty where the row above has the same."""
    listed = list(names)
    return [name if k == 0 or name != listed[k - 1] else "" for k, name in enumerate(listed)]


def reductions(values: Iterable[float], coloured: float = 0.1) -> list[Text]:
    """Reductions of rms as changes (-95 % where 95 % are gone); those of a share above `coloured` have a colour."""
    looks = [(float(v), "green" if v > coloured else "red" if v < -coloured else "") for v in values]
    return [styled(change(-value), look) for value, look in looks]


def before_after(title: str, before: Array, after: Array, reduction: Array, noise: Array | None = None) -> Table:
    """Rms (6,) before and after, where given the sensors' noise, and the change."""
    rows = [("rms before", *row(before)), ("rms after", *row(after))]
    rows += [] if noise is None else [("sensor noise", *row(noise))]
    return table(title, ("", *UNIT_HEADS), [*rows, ("change", *reductions(reduction))])


def parameters(effects: Sequence[Snapshot], title: str, vehicle: Vehicle | None = None) -> Table:
    """Effects with their values, standard deviations and units; rotors and arms by the names that `vehicle` has."""
    rows = [
        ("" if k else effect.effect, label(v.name, vehicle), number(v.value, 4), number(v.std, 2), unit(v.unit))
        for effect in effects
        for k, v in enumerate(effect.values)
    ]
    return table(title, ("effect", "parameter", "value", "+-", "unit"), rows, left=2, texts=(-1,))
