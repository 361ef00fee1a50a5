"""Which parameters of the autopilot differ between logs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from wrenchgap.flight.autopilot import ParameterDifferences, parameter_differences, why_ignored
from wrenchgap.flight.flight import Flight
from wrenchgap.replay.present.tables import Line, Part, plain

COLUMNS = 5
"""Logs up to which each has a column of its own: more are wider than a screen."""


def of_flights(flights: Iterable[Flight]) -> ParameterDifferences:
    """Of the flights of a result."""
    return parameter_differences((flight.name, flight.autopilot) for flight in flights)


def parts(found: ParameterDifferences, most: int | None = 12) -> list[Part]:
    """A table, of the first `most` parameters, and what is not in it; nothing where fewer than two logs have any."""
    if len(found.logs) < 2:
        return []
    out: list[Part] = []
    shown = found.differ[:most]
    if shown:
        left = 1 if len(found.logs) <= COLUMNS else 2
        rows = [row(found, k) for k in range(len(shown))]
        out.append(plain("parameters that differ", heads(found), rows, left))
    more = len(found.differ) - len(shown)
    said = [f"{more} more parameters differ (--details)."] if more else []
    return [*out, *(Line(text, "dim") for text in [*said, *sentences(found)])]


def heads(found: ParameterDifferences) -> tuple[str, ...]:
    """Heads of the table: a column for each log, or one for all where there are more than `COLUMNS`."""
    return ("parameter", *(found.logs if len(found.logs) <= COLUMNS else ("values, each with its logs",)))


def row(found: ParameterDifferences, k: int) -> tuple[str, ...]:
    """Row `k` of the table."""
    one = found.differ[k]
    if len(found.logs) <= COLUMNS:
        return (one.name, *map(_value, one.values))
    by_value: dict[str, list[str]] = {}
    for log, value in zip(found.logs, one.values, strict=True):
        by_value.setdefault(_value(value), []).append(log)
    return (one.name, "; ".join(f"{value}: {', '.join(logs)}" for value, logs in by_value.items()))


def _value(value: float | None) -> str:
    if value is None:
        return "-"
    return str(int(value)) if float(value).is_integer() and abs(value) < 1e15 else f"{value:.6g}"


def sentences(found: ParameterDifferences) -> list[str]:
    """What is not in the table; nothing where fewer than two logs have parameters."""
    if len(found.logs) < 2:
        return []
    out = [] if found.differ else [f"No parameter differs between the {len(found.logs)} logs that have parameters."]
    by_reason: dict[str, list[str]] = {}
    for name in found.ignored:
        by_reason.setdefault(why_ignored(name) or "", []).append(name)
    out += [f"not compared: {', '.join(names)} ({why})." for why, names in by_reason.items()]
    if found.not_in_all:
        out.append(f"{found.not_in_all} parameters are not in all logs, as of another firmware: not compared.")
    if found.without:
        out.append(f"no parameters in {', '.join(found.without)}.")
    return out


def named(found: ParameterDifferences, most: int = 4) -> str:
    """The first `most` differences in a sentence."""
    listed = ", ".join(f"{one.name} {' / '.join(map(_value, one.values))}" for one in found.differ[:most])
    more = len(found.differ) - most
    return f"{listed}{f', and {more} more' if more > 0 else ''}"


def to_json(found: ParameterDifferences) -> dict[str, Any]:
    """The key `parameters` of results of several logs."""
    differ: Sequence[dict[str, Any]] = [{"name": one.name, "values": list(one.values)} for one in found.differ]
    ignored = [{"name": name, "reason": why_ignored(name)} for name in found.ignored]
    return {
        "logs": list(found.logs),
        "without": list(found.without),
        "differ": differ,
        "ignored": ignored,
        "not_in_all": found.not_in_all,
    }
