"""Every number of a log by its name, whether or not it plays a role: for looking, not for computing.

A channel is one numeric field of one topic, or one column of it where it is an array: "/imu/data.angular_velocity.x",
"/esc.data[3]". Its times are those of the flight's clock: header stamps where they were filled in, else log times,
brought to one clock as `flight.load` does.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from wrenchgap.flight.budget import Budget
from wrenchgap.flight.clocks import one_clock
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.flight.formats import Table, read_log

COLUMNS = 64
"""Columns of an array that get a channel each, at most: an image is no signal."""

Channel = tuple[Array, Array]
"""Times (N,) [s since Flight.start_ns] and values (N,), nan where a message lacks it."""


def channels(path: str | Path, found: Flight, budget: Budget | str | None = None) -> dict[str, Channel]:
    """All channels of the log of a flight, topic by topic; `budget` as of `flight.load`."""
    log = read_log(Path(path), lambda topic, kind, fields: True, budget)
    motion = [series.topic for series in (found.imu, found.odometry) if series is not None]
    stamps = one_clock(log.tables, [topic for topic in motion if topic in log.tables]).stamps
    out: dict[str, Channel] = {}
    for topic, table in log.tables.items():
        time = np.asarray(stamps[topic] - found.start_ns, dtype=float) * 1e-9
        for name, values in _numbers(table).items():
            out[f"{topic}.{name}" if name else topic] = (time, values)
    return out


def _numbers(table: Table) -> Mapping[str, Array]:
    """The numeric columns of a topic by their dotted names, without the header's own."""
    out: dict[str, Array] = {}
    for name, values in table.columns.items():
        if name.startswith("header.") or name.endswith("covariance") or values.dtype.kind not in "fiub":
            continue
        if values.ndim == 1:
            out[name] = values.astype(float)
        elif values.shape[1] <= COLUMNS:
            out |= {f"{name}[{i}]": values[:, i].astype(float) for i in range(values.shape[1])}
    return {name: values for name, values in out.items() if np.isfinite(values).any()}
