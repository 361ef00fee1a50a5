"""Whose a topic is: namespaces, and which of them are those of several vehicles in one log."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence

from wrenchgap.flight.topic_names import OTHER_SOURCES, name_words


def apart(topic: str, other: str) -> tuple[str, str] | None:
    """The namespaces in which two topics are called alike, the longest name in common; None where they are not.

    Either may be the root, "". Namespaces that say another source (`/sim/imu`) are no vehicles'.
    """
    own, their = topic.strip("/").split("/"), other.strip("/").split("/")
    count = 0
    while count < min(len(own), len(their)) and own[-1 - count] == their[-1 - count]:
        count += 1
    if count == 0 or len(own) == len(their) == count:
        return None
    found = "/".join(own[: len(own) - count]), "/".join(their[: len(their) - count])
    return None if any(name_words(space) & OTHER_SOURCES for space in found) else found


def within(topic: str, spaces: Iterable[str]) -> str | None:
    """The innermost of the namespaces that a topic is in; None where it is in none."""
    name = topic.strip("/")
    return max((s for s in spaces if not s or name.startswith(f"{s}/")), key=len, default=None)


def namespace(topic: str) -> str:
    """The first component of a topic's name, where there is more than one."""
    parts = topic.strip("/").split("/")
    return parts[0] if len(parts) > 1 else ""


def twins(topic: str, other: str) -> bool:
    """Whether two topics are called alike in different namespaces (or are the same)."""
    own, their = namespace(topic), namespace(other)
    return bool(own and their) and topic.strip("/")[len(own) :] == other.strip("/")[len(their) :]


def fleet(likely: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Namespaces of several vehicles, of the topics that suit each role; empty where there is one vehicle.

    In two of them topics of at least two roles are called alike, commands among them.
    """
    shared: dict[tuple[str, str], set[str]] = {}
    for role, topics in likely.items():
        for one, other in itertools.combinations(sorted(set(topics)), 2):
            spaces = apart(one, other)
            if spaces is not None:
                shared.setdefault((min(spaces), max(spaces)), set()).add(role)
    pairs = [pair for pair, roles in shared.items() if len(roles) > 1 and roles & {"commanded", "actuators"}]
    return tuple(sorted({space for pair in pairs for space in pair}))
