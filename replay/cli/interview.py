"""Questions on the terminal, for `model new --interactive`."""

from __future__ import annotations

from collections.abc import Sequence

import typer


def questions(question: str, kind: type, default: str | None, choices: Sequence[str]) -> str:
    """The answer to one question as text, asked again until it is of its kind; "" where it may be left open.

    `kind` is float or str; `default` None makes an answer necessary, "" makes it optional.
    """
    words = question + (f" ({', '.join(choices)})" if choices else "")
    while True:
        answer = str(typer.prompt(words, default=default, show_default=bool(default), err=True)).strip()
        if answer == "" and default == "":
            return ""
        if choices and answer not in choices:
            typer.echo(f"got {answer!r}, expected one of {', '.join(choices)}", err=True)
        elif kind is float and not _positive(answer):
            typer.echo(f"got {answer!r}, expected a positive number", err=True)
        else:
            return answer


def _positive(text: str) -> bool:
    try:
        return 0.0 < float(text) < float("inf")
    except ValueError:
        return False
