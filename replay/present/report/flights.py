"""What pages about several flights have in common."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Flight
from wrenchgap.replay.present.checks import raised, warnings
from wrenchgap.replay.present.documents import atomic
from wrenchgap.replay.present.report.elements import Table
from wrenchgap.replay.present.report.page import environment


def check(path: Path | None) -> None:
    """Raise UsageError where the name is not that of a web page."""
    if path is not None and path.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"--page {path}: the page is a web page; expected a name that ends in .html")


def save(text: str, path: Path) -> None:
    """Write a page, all of it or nothing."""
    with atomic(path) as partial:
        partial.write_text(text, encoding="utf-8")


class LogFlight(Protocol):
    """Anything made of one log."""

    @property
    def flight(self) -> Flight:
        """The log."""


def rendered(tool: str, flights: Sequence[LogFlight], **parts: Any) -> str:
    """The page of a command, with today's date, the logs, and at the top what the checks of the logs warn of."""
    said = [f"check: {text}" for text in warnings(raised(list(flights)))]
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    return (
        environment()
        .get_template("flights.html.jinja")
        .render(**{"tool": tool, "date": date, "files": files(flights), "warnings": said, "inspect": [], **parts})
    )


def files(flights: Sequence[LogFlight]) -> Table:
    """The logs and their hashes."""
    rows = [[str(k + 1), f.flight.path.name, f.flight.content_hash] for k, f in enumerate(flights)]
    return Table(("", "log", "SHA-256"), rows, left=3, code=(2,), caption="Logs.")
