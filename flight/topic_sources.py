"""What stands behind a role in an override, in its pieces: `/topic.field[columns]*factor:words`."""

from __future__ import annotations

import re
from dataclasses import dataclass

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.meaning import NUMBER


def topic_of(value: str) -> str:
    """The topic alone."""
    return re.split(r"[.\[*:]", value, maxsplit=1)[0]


@dataclass(frozen=True)
class Said:
    """An override in its pieces: `/topic.field[columns]*factor:words`."""

    topic: str
    field: str | None
    columns: tuple[int, ...] | None
    factor: float
    words: str


def parse_source(value: str) -> Said:
    """Split `/topic.field[columns]*factor:words`; raises `UsageError` where it is not of this form."""
    form = rf"([^.\[\]*:]+)(?:\.([\w.]+))?(?:\[([\d,:\s]+)\])?(?:\*({NUMBER}))?(?::(.+))?"
    match = re.fullmatch(form, value.strip())
    if match is None:
        raise UsageError(
            f"topic {value!r}: expected /topic, /topic.field, /topic[0:6] or /topic[3,2,1,0], with *FACTOR or :WORDS "
            "behind it, as in /imu:frd,g"
        )
    topic, place, columns, factor, words = match.groups()
    return Said(topic, place, None if columns is None else _columns(columns, value), float(factor or 1.0), words or "")


def _columns(text: str, value: str) -> tuple[int, ...]:
    chosen: list[int] = []
    for piece in text.split(","):
        bounds = piece.split(":")
        if len(bounds) > 2 or not all(bound.strip().isdigit() for bound in bounds):
            raise UsageError(
                f"topic {value!r}: columns {piece.strip()!r}; expected numbers or first:last+1, as in [0:6]"
            )
        first = int(bounds[0])
        chosen += range(first, int(bounds[1]) if len(bounds) == 2 else first + 1)
    if not chosen:
        raise UsageError(f"topic {value!r}: selects no column")
    return tuple(chosen)
