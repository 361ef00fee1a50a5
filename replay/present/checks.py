"""What the checks of the flights said, for every result alike: at the top of what is printed, and in its JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from wrenchgap.flight.check import Check, Finding, TimeLeftOut
from wrenchgap.replay.present.tables import Line

PLACES = ("flights", "unseen", "training", "validation", "inference", "recording", "explanation")
"""Attributes of results in which their flights, or the notes of these, are found."""
DEEPEST = 3
SEVERAL = 3
"""Flights of which one check is said by itself; of more, once for all."""


def raised(result: Any, depth: int = 0) -> Iterator[Finding | TimeLeftOut]:
    """What was found of the flights of a result, and the times that were left out."""
    if isinstance(result, list | tuple):
        for item in result:
            yield from raised(item, depth)
        return
    for note in getattr(result, "notes", ()):
        if isinstance(note, Finding | TimeLeftOut):
            yield note
    for place in PLACES if depth < DEEPEST else ():
        if (inside := getattr(result, place, None)) is not None and not isinstance(inside, str):
            yield from raised(inside, depth + 1)


def warnings(found: Iterable[object]) -> list[str]:
    """What a user should know before any number, as sentences; alike ones of many flights once."""
    by_name: dict[str, dict[str, str]] = {}
    for note in found:
        if isinstance(note, Finding) and note.check.level != "ok":
            by_name.setdefault(note.check.name, {}).setdefault(f"{note.flight}: {_words(note.check)}", note.flight)
    out = []
    for name, said in by_name.items():
        flights = list(dict.fromkeys(said.values()))
        if len(flights) > SEVERAL:
            out.append(f"{name}: {len(flights)} flights, e.g. {next(iter(said))}")
        else:
            out += [f"{name}: {words}" for words in said]
    return out


def _words(check: Check) -> str:
    if check.level == "bad":
        return f"{check.words.rstrip('. ')} (accepted)"
    return check.words + (f" Mend it with {check.mend}" if check.mend else "")


def banner(result: Any) -> list[Line]:
    """The warnings of a result, to stand above it."""
    return [Line(f"check: {text}", "yellow") for text in warnings(raised(result))]


def checks_json(result: Any) -> dict[str, Any]:
    """The keys `checks` and `left_out` of every result."""
    notes = list(dict.fromkeys(raised(result)))
    keys = ("name", "level", "words", "mend", "accepted")
    return {
        "checks": [
            {"flight": n.flight, **{key: getattr(n.check, key) for key in keys}}
            for n in notes
            if isinstance(n, Finding)
        ],
        "left_out": [vars(n) for n in notes if isinstance(n, TimeLeftOut)],
    }
