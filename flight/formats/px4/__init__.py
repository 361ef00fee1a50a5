"""What PX4's messages mean: topics in SI, FLU and ENU, and in the types that every log may have, made of its own.

The same for a ULog and for px4_msgs in a bag. PX4's own topics stay as they are, in its frames; what is made of them
is named `/px4/imu`, `/px4/odometry`, ... and plays the roles. Where there is a choice the first is named plainly and
the others after their source, to be chosen with --topic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from wrenchgap.flight.formats.px4 import topics
from wrenchgap.flight.formats.px4.messages import Messages, by_vehicle, wanted
from wrenchgap.flight.formats.table import Table

__all__ = ["derived", "wanted"]

_MAKERS = (
    topics.imus,
    topics.odometries,
    topics.references,
    topics.wrenches,
    topics.actuators,
    topics.batteries,
)


def derived(
    tables: Mapping[str, Table], parameters: Mapping[str, float | int] | None = None
) -> tuple[dict[str, Table], list[str]]:
    """Topics made of the PX4 messages in a log, by name, and what to say of them; nothing where there are none."""
    out: dict[str, Table] = {}
    notes: list[str] = []
    for said in by_vehicle(tables, parameters or {}):
        made = [entry for make in _MAKERS for entry in _safely(make, said)]
        if not made:
            continue
        out |= {table.topic: table for _, table in made}
        listed = "; ".join(f"{table.topic} from {source}" for source, table in made)
        notes.append(f"PX4's topics in FRD and NED became, in FLU and ENU: {listed}.")
        unarmed = topics.never_armed(said)
        notes += said.notes + ([unarmed] if unarmed else [])
    return out, notes


def _safely(make: Callable[[Messages], Iterator[tuple[str, Table]]], said: Messages) -> list[tuple[str, Table]]:
    """What a maker gives; messages whose fields have other shapes than PX4's come from a damaged file."""
    try:
        with np.errstate(invalid="ignore", over="ignore"):  # what is absurd is left out later, and counted
            return [(source, table) for source, table in make(said) if len(table) > 1]
    except (ValueError, IndexError, TypeError) as error:
        said.notes.append(f"{said.prefix}/px4: {make.__name__} could not be made of damaged messages ({error}).")
        return []
