"""PX4's messages as they come, from ULog or from px4_msgs in a bag: found by vehicle, name and instance.

Their times are microseconds since the autopilot's start; `timestamp_sample` is when the sensor was read, `timestamp`
when the message was sent.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.flight.formats.standard_topics import Stamps
from wrenchgap.flight.formats.table import Table

NAMES = frozenset(
    {
        "sensor_combined",
        "vehicle_imu",
        "vehicle_acceleration",
        "vehicle_angular_velocity",
        "sensor_accel",
        "sensor_gyro",
    }
    | {"vehicle_attitude", "vehicle_local_position", "vehicle_odometry", "battery_status", "esc_status"}
    | {"vehicle_attitude_groundtruth", "vehicle_local_position_groundtruth", "vehicle_angular_velocity_groundtruth"}
    | {"vehicle_attitude_setpoint", "vehicle_local_position_setpoint", "trajectory_setpoint", "vehicle_rates_setpoint"}
    | {"vehicle_thrust_setpoint", "vehicle_torque_setpoint", "actuator_controls_0", "actuator_motors"}
    | {"actuator_outputs", "actuator_armed"}
)
"""Messages that something here is made of."""


@dataclass(frozen=True)
class Messages:
    """Tables of one vehicle by name and instance. `parameters` are the autopilot's, where the log has them.

    `prefix` is the namespace that the derived topics go to. `notes` grow: what was repaired.
    """

    prefix: str
    tables: Mapping[tuple[str, int], Table]
    parameters: Mapping[str, float | int]
    notes: list[str] = field(default_factory=list)

    def get(self, name: str, instance: int = 0) -> Table | None:
        """A message's table, if it holds any."""
        found = self.tables.get((name, instance))
        return found if found is not None and len(found) and found.columns else None

    def several(self, name: str) -> list[tuple[int, Table]]:
        """All instances of a message."""
        return sorted(((i, table) for (other, i), table in self.tables.items() if other == name and table.columns))

    def topic(self, name: str) -> str:
        """A derived topic."""
        return f"{self.prefix}/px4/{name}"


def by_vehicle(tables: Mapping[str, Table], parameters: Mapping[str, float | int]) -> list[Messages]:
    """The PX4 messages among a log's tables, one entry a vehicle."""
    found: dict[str, dict[tuple[str, int], Table]] = {}
    for topic, table in tables.items():
        place = _place(topic, table.type)
        if place is not None:
            prefix, name, instance = place
            found.setdefault(prefix, {}).setdefault((name, instance), table)
    return [Messages(prefix, own, parameters) for prefix, own in sorted(found.items())]


def wanted(topic: str, kind: str) -> bool:
    """Whether something is made of a topic's messages."""
    return _place(topic, kind) is not None


def _place(topic: str, kind: str) -> tuple[str, str, int] | None:
    """Namespace, name and instance; None for what is no PX4 message or of no use here."""
    package, _, type_name = kind.rpartition("/")
    if "px4" not in package:
        return None
    match = re.fullmatch(
        r"(?P<space>.*?)(?:/fmu/(?:in|out))?/?(?P<name>[a-z]\w*?)(?:_v\d+)?(?:/(?P<number>\d+))?", topic
    )
    snake = re.sub(r"(?<=[a-z0-9])([A-Z])", r"_\1", type_name).lower()
    if match is None:
        return ("", snake, 0) if snake in NAMES else None
    name = match["name"] if match["name"] in NAMES else snake
    return (match["space"].rstrip("/"), name, int(match["number"] or 0)) if name in NAMES else None


def sent(table: Table) -> Stamps:
    """When each message was sent [ns]."""
    return np.asarray(table.columns["timestamp"]).astype(np.int64) * 1000


def sampled(table: Table, oldest: int = 1_000_000_000) -> Stamps:
    """When what each message tells was measured [ns]; a stamp that is `oldest` [ns] before the message's is none."""
    stamps = sent(table)
    if "timestamp_sample" not in table.columns:
        return stamps
    sample = np.asarray(table.columns["timestamp_sample"]).astype(np.int64) * 1000
    return np.where((sample > 0) & (np.abs(stamps - sample) < oldest), sample, stamps)


def numbers(table: Table, *names: str) -> Array | None:
    """Fields (N, K) side by side; arrays give all their columns. None where the messages lack one."""
    if any(name not in table.columns for name in names):
        return None
    return np.hstack([np.asarray(table.columns[name], dtype=float).reshape(len(table), -1) for name in names])


def true(table: Table, *names: str) -> NDArray[np.bool_]:
    """Where (N,) none of the flags that the messages have is down."""
    known = [np.asarray(table.columns[name], dtype=float) > 0 for name in names if name in table.columns]
    return np.asarray(np.all(known, axis=0)) if known else np.ones(len(table), dtype=bool)
