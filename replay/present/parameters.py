"""Which parameters of the autopilot differ between logs."""

from collections.abc import Iterable
from typing import Any

from wrenchgap.flight.autopilot import ParameterDifferences, parameter_differences, why_ignored
from wrenchgap.replay.present.numbers import by_reason, entries, listed
from wrenchgap.replay.present.tables import Line, Part, Table, table

COLUMNS = 5
"""Logs up to which each has a column of its own: more are wider than a screen."""


def of_flights(flights: Iterable[Any]) -> ParameterDifferences:
    """Of the flights of a result; of rows of a batch none are known."""
    return parameter_differences((one.flight.name, one.flight.autopilot) for one in flights)


def parts(found: ParameterDifferences, most: int | None = 12) -> list[Part]:
    """A table, of the first `most` parameters, and what is not in it; nothing where fewer than two logs have any."""
    if len(found.logs) < 2:
        return []
    more = 0 if most is None else len(found.differ) - most
    said = [f"{more} more parameters differ (--details)."] if more > 0 else []
    return [*differences(found, most), *(Line(text, "dim") for text in [*said, *sentences(found)])]


def differences(found: ParameterDifferences, most: int | None = None) -> list[Table]:
    """A column for each log, or one for more of them; no table where no parameter differs."""
    if not found.differ:
        return []
    heads, rows, left = ["parameter", *found.logs], [[one.name, *map(_value, one.values)] for one in found.differ], 1
    if len(found.logs) > COLUMNS:
        heads, rows, left = ["parameter", "values, each with its logs"], [], 2
        for one in found.differ:
            by_value = by_reason((_value(value), log) for log, value in zip(found.logs, one.values, strict=True))
            rows.append([one.name, "; ".join(f"{value}: {', '.join(logs)}" for value, logs in by_value.items())])
    return [table("parameters that differ", heads, rows[:most], left)]


def _value(value: float | None) -> str:
    if value is None:
        return "-"
    return str(int(value)) if float(value).is_integer() and abs(value) < 1e15 else f"{value:.6g}"


def sentences(found: ParameterDifferences) -> list[str]:
    """What is not in the table; nothing where fewer than two logs have parameters."""
    if len(found.logs) < 2:
        return []
    out = [] if found.differ else [f"No parameter differs between the {len(found.logs)} logs that have parameters."]
    ignored = by_reason((why_ignored(name) or "", name) for name in found.ignored)
    out += [f"not compared: {', '.join(names)} ({why})." for why, names in ignored.items()]
    if found.not_in_all:
        out.append(f"{found.not_in_all} parameters are not in all logs, as of another firmware: not compared.")
    if found.without:
        out.append(f"no parameters in {', '.join(found.without)}.")
    return out


def named(found: ParameterDifferences, most: int = 4) -> str:
    """The first `most` differences in a sentence."""
    said = [f"{one.name} {' / '.join(map(_value, one.values))}" for one in found.differ]
    return listed(said, most, last=", and ")


def to_json(found: ParameterDifferences) -> dict[str, Any]:
    """The key `parameters` of results of several logs."""
    return {
        **entries(found, "logs", "without"),
        "differ": [entries(one, "name", "values") for one in found.differ],
        "ignored": [{"name": name, "reason": why_ignored(name)} for name in found.ignored],
        "not_in_all": found.not_in_all,
    }
