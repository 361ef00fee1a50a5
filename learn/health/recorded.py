"""An autopilot's own messages on the clock of a flight: what it says of itself, and no role of a flight needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.flight.formats import Table


@dataclass(frozen=True, eq=False)
class Recorded:
    """The tables of a log by topic, with times from the flight's start [ns]; empty where no autopilot wrote it."""

    tables: Mapping[str, Table]
    start_ns: int

    def columns(self, topic: str, *names: str) -> tuple[Array, Array] | None:
        """Times (N,) [s] and fields (N, K) of a topic; None where it lacks one or has no message."""
        table = self.tables.get(topic)
        if table is None or not len(table) or any(_number(table, name) is None for name in names):
            return None
        time = np.asarray((table.log_time_ns - self.start_ns) * 1e-9, dtype=float)
        parts = [np.asarray(_number(table, name), dtype=float).reshape(len(table), -1) for name in names]
        return time, np.hstack(parts)

    def instances(self, topic: str) -> list[str]:
        """All instances of a topic that are logged: `imu`, `imu/0`, `imu/1`, ..."""
        return [name for name in (topic, *(f"{topic}/{k}" for k in range(10))) if name in self.tables]


def _number(table: Table, name: str) -> Array | None:
    values = table.columns.get(name)
    return values if values is not None and values.dtype.kind in "fiub" else None
