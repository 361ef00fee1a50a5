"""Names are data: what a log, a model or a file is called, made harmless for each kind of output.

One function for each kind, called by the outermost writer of that kind and nowhere else, so that whoever prints a name
need not think of it:

    terminal, errors   `printable`      replay.present.tables, replay.cli.requests, flight.errors
    HTML               `html_templates` the report and the panels of the page
    C                  `c_comment`      replay.export
    Makefile, CMake    `build_text`     replay.export
    Markdown           `markdown`       replay.export (the page shows no Markdown)
    figures            `figure_text`    replay.present.figures.style
    JSON               `json_text`      replay.present.documents, viewer.view_state
    CSV                `csv_cell`       replay.present.documents, viewer.panels.export
    TOML, MCAP         `storable`       plant.model_file, plant.trajectory.file, flight.write, replay.batch.store
    TOML's comments    `printable`      plant.drafts.model_text
    XML, Python        `comment`        plant.targets.written, replay.export
    shell              `file_word`      flight.formats, plant.drafts: a file of another program's command
    shell completion   `completable`    replay.cli.values
"""

from __future__ import annotations

import json
import re
import shlex
from typing import TYPE_CHECKING, Any
from unicodedata import category

if TYPE_CHECKING:
    from pathlib import Path

    from jinja2 import BaseLoader, Environment

UNKNOWN = "\N{REPLACEMENT CHARACTER}"
FORMULAE = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20")
"""Begin what a spreadsheet computes, the full-width forms too."""


class _Printable(dict[int, int | str]):
    """What stands for a character: itself, or a replacement for what a terminal obeys or nobody sees."""

    def __missing__(self, code: int) -> int | str:
        c = chr(code)
        self[code] = code if c.isprintable() or category(c) == "Zs" else UNKNOWN
        return self[code]


_PRINTABLE = _Printable()
_SEVERAL_LINES = _Printable({ord("\n"): "\n", ord("\t"): "\t"})


def printable(text: object, *, lines: bool = False) -> str:
    """Text without control characters, marks of direction and lone surrogates; line breaks stay where `lines`."""
    return str(text).translate(_SEVERAL_LINES if lines else _PRINTABLE)


def file_word(path: Path) -> str:
    """A file in a command that is proposed: one word of a shell, where the file is, and no option."""
    return shlex.quote(f"./{path}" if str(path).startswith("-") else str(path))


def completable(text: str) -> bool:
    """Whether a shell that completes this name takes it as a name: shells put it, unquoted, on the command line."""
    return re.fullmatch(r"[\w./+@%,:][\w./+@%,:=-]*", text, re.ASCII) is not None


def storable(text: str) -> str:
    """Text that UTF-8 can hold: half characters, as of a file name in another encoding, are replaced."""
    return re.sub(r"[\ud800-\udfff]", UNKNOWN, text)


def html_templates(loader: BaseLoader) -> Environment:
    """Templates of HTML: every value is printable and escaped, and nothing may be missing."""
    from jinja2 import Environment, StrictUndefined

    return Environment(
        loader=loader,
        autoescape=True,
        finalize=lambda value: printable(value, lines=True) if type(value) is str else value,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def c_comment(text: str) -> str:
    """A name inside a comment of C99: it neither ends it, nor begins one, nor joins lines (a backslash, trigraphs)."""
    out = re.sub(r"\*(?=/)|/(?=\*)|\?(?=\?)", r"\g<0> ", printable(text))
    return re.sub(r"\\(?=\s*$)", UNKNOWN, out)


def comment(text: str) -> str:
    """A name in a comment of XML or Python: it does not end it, and names no encoding of the file (PEP 263)."""
    return re.sub(r"-(?=-)|coding(?=[:=])", r"\g<0> ", printable(text))


def build_text(text: str) -> str:
    """A value in a Makefile or of CMake, where most other characters mean something."""
    return re.sub(r"[^A-Za-z0-9_.]", "_", text)


def markdown(text: str) -> str:
    """A name in a line of Markdown, or in a cell of a table: no element, no HTML, no link, by itself neither."""
    out = re.sub(
        r"[^\w\s.,;:()/%=+'-]|:(?!\s|$)|(?<![^\W_])_|_(?![^\W_])", lambda c: f"&#{ord(c[0])};", printable(text)
    )
    return re.sub(r"(?i)(www)\.", r"\1&#46;", out)


def figure_text(text: str, most: int) -> str:
    """A text of a figure: no control character, no line of more than `most` characters."""
    lines = printable(text, lines=True).split("\n")
    return "\n".join(one if len(one) <= most else f"{one[: most - 3]}..." for one in lines)


def json_text(value: Any, indent: int | None = None) -> str:
    """A document of JSON: strict; what is not printable as its number, lone surrogates as U+FFFD, the rest readable."""
    text = json.dumps(value, indent=indent, allow_nan=False, ensure_ascii=False)
    text = storable(text)
    if text.replace("\n", "").isprintable():
        return text
    return "".join(c if c == "\n" or c.isprintable() else json.dumps(c)[1:-1] for c in text)


def csv_cell(value: Any) -> Any:
    """A cell of a table: text without line breaks, which no spreadsheet computes; numbers as they are.

    A spreadsheet of a language whose numbers have a comma begins a cell at each semicolon.
    """
    if not isinstance(value, str):
        return value
    text = re.sub(rf"(;\s*)(?=[{re.escape(''.join(FORMULAE))}])", r"\1'", printable(value))
    return f"'{text}" if text.startswith(FORMULAE) and len(text) > 1 and not _is_number(text) else text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
