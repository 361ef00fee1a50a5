"""Tables that readers make of what a format calls otherwise: in ROS types, SI, FLU and ENU, so that they play roles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array, SpeedUnit
from wrenchgap.flight.formats.merging import Stamps
from wrenchgap.flight.formats.table import Columns, Table


def vector(prefix: str, values: Array, axes: str = "xyz") -> Columns:
    """Columns `prefix.x`, `prefix.y`, ... of an array (N, 3), or of quaternions (N, 4) with `axes` "wxyz"."""
    return {f"{prefix}.{axis}": values[:, i] for i, axis in enumerate(axes)}


@dataclass(frozen=True)
class Made:
    """A topic to be: its name, and when its N messages were logged and stamped [ns]."""

    topic: str
    log_time_ns: Stamps
    stamps: Stamps

    def imu(self, omega_B: Array | None, specific_force_B: Array | None) -> Table:
        """Of gyroscope and accelerometer (N, 3); what is None was not measured."""
        columns = vector("angular_velocity", self._or_unknown(omega_B))
        return self._table(
            "sensor_msgs/msg/Imu", columns | vector("linear_acceleration", self._or_unknown(specific_force_B))
        )

    def odometry(
        self, position_E: Array, quat_EB: Array, velocity_E: Array | None = None, omega_B: Array | None = None
    ) -> Table:
        """Of a pose, a velocity in E (which the type wants in the body) and body rates."""
        columns = vector("pose.pose.position", position_E) | vector("pose.pose.orientation", quat_EB, "wxyz")
        velocity_B = None if velocity_E is None else so3.rotate_inverse(quat_EB, velocity_E)
        columns |= vector("twist.twist.linear", self._or_unknown(velocity_B))
        return self._table("nav_msgs/msg/Odometry", columns | vector("twist.twist.angular", self._or_unknown(omega_B)))

    def wrench(self, force_B: Array, torque_B: Array) -> Table:
        """Of force and torque (N, 3); the topic's name says where they are normalised."""
        columns = vector("wrench.force", force_B) | vector("wrench.torque", torque_B)
        return self._table("geometry_msgs/msg/WrenchStamped", columns)

    def actuators(self, rotors: Array | None, tilt: Array | None = None, unit: SpeedUnit = "rad/s") -> Table:
        """Of rotor commands (N, R) and tilt angles (N, A) [rad]."""
        columns: Columns = {} if tilt is None else {"position": tilt}
        if rotors is not None:
            columns["normalized" if unit == "normalised" else "velocity"] = rotors
        return self._table("actuator_msgs/msg/Actuators", columns)

    def battery(self, voltage: Array) -> Table:
        """Of a voltage (N,) [V]."""
        return self._table("sensor_msgs/msg/BatteryState", {"voltage": voltage})

    def acceleration(self, linear: Array) -> Table:
        """Of a reference's acceleration (N, 3), in the frame that fits."""
        columns = vector("accel.linear", linear) | vector("accel.angular", self._or_unknown(None))
        return self._table("geometry_msgs/msg/AccelStamped", columns)

    def _or_unknown(self, values: Array | None) -> Array:
        return np.full((len(self.stamps), 3), np.nan) if values is None else values

    def _table(self, kind: str, columns: Columns) -> Table:
        return Table(self.topic, kind, self.log_time_ns, self.stamps, columns)


def cropped(table: Table) -> Table:
    """Without the rows before the first and after the last that are whole; what is missing inside stays, as NaN.

    Columns that are NaN throughout, which nobody measured, do not count.
    """
    whole = np.ones(len(table), dtype=bool)
    for values in table.columns.values():
        finite = np.isfinite(values).reshape(len(table), -1)
        whole &= finite[:, finite.any(axis=0)].all(axis=1)
    rows = np.flatnonzero(whole)
    return table if not len(rows) else taken(table, slice(int(rows[0]), int(rows[-1]) + 1))


def taken(table: Table, rows: slice | NDArray[Any]) -> Table:
    """Some rows of a table."""
    header = None if table.header_ns is None else table.header_ns[rows]
    columns = {name: values[rows] for name, values in table.columns.items()}
    return Table(table.topic, table.type, table.log_time_ns[rows], header, columns, table.problem)
