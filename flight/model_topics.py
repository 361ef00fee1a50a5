"""What a model file says of topics, `[topics]`: followed where a log has them, and said where it has not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from wrenchgap.flight.formats import Table
from wrenchgap.flight.mapping_units import parse_source
from wrenchgap.flight.roles import ROLE_PARTS, Assignment, is_none, propose


def assignment(
    tables: Mapping[str, Table], topics: Mapping[str, str] | None, preferred: Mapping[str, str] | None, where: str
) -> Assignment:
    """Who plays what under `topics` and, where the log can follow them, `preferred`; errors as of `propose`."""
    found = propose(tables, merged_topics(topics, preferred, tables), where)
    others = {role: value for role, value in (preferred or {}).items() if role not in (topics or {})}
    return replace(found, notes=(*found.notes, *unfollowed(others, found, tables)))


def merged_topics(
    topics: Mapping[str, str] | None, preferred: Mapping[str, str] | None, tables: Mapping[str, Table]
) -> dict[str, str]:
    """`topics`, after those entries of `preferred` that this log can follow: its topic is there, or none is wanted."""
    wanted = (preferred or {}).items()
    followed = {role: value for role, value in wanted if is_none(value) or parse_source(value).topic in tables}
    return followed | dict(topics or {})


def unfollowed(preferred: Mapping[str, str] | None, assignment: Assignment, tables: Mapping[str, Table]) -> list[str]:
    """Notes of what a model file says a topic's numbers mean, where this log has the role but not that topic."""
    lost = []
    for role, value in (preferred or {}).items():
        said = None if is_none(value) else parse_source(value)
        if said is None or said.topic in tables or (said.words, said.factor, said.columns) == ("", 1.0, None):
            continue
        played = [assignment.sources[p].topic for p in ROLE_PARTS.get(role, (role,)) if p in assignment.sources]
        if played:
            lost.append(
                f"The model file maps {role} to {value}; this log has no {said.topic}, {played[0]} is used as it is."
            )
    return lost
