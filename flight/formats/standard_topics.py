"""Topics that readers make of what a format calls otherwise: tables in ROS types, SI, FLU and ENU, which play roles.

Where a format spreads one quantity over several topics, the values of one are taken at the stamps of another.

Nothing is bridged: beyond the ends of the source, and inside its gaps, the value is NaN. A source that is faster than
what asks is averaged over the interval between the stamps, so that nothing above half the new rate is folded down.
"""

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array, Mask, SpeedUnit, Stamps
from wrenchgap.flight.formats.reader import Columns, Table


def increasing_rows(stamps: Stamps, values: Array) -> tuple[Stamps, Array]:
    """The rows that are finite and later than all before."""
    keep = np.isfinite(values).all(axis=1)
    stamps, values = stamps[keep], values[keep]
    if not len(stamps):
        return stamps, values
    later = np.concatenate(([True], stamps[1:] > np.maximum.accumulate(stamps)[:-1]))
    return stamps[later], values[later]


def values_at(wanted: Stamps, stamps: Stamps, values: Array, faster: float = 1.5) -> Array:
    """`values` (K, C) at `stamps` (K,) [ns], at the `wanted` (N,) ones: (N, C), NaN where the source has none.

    A source that comes `faster` than what asks by this factor is averaged over the period of what asks: differences of
    the integral of what is linear between the samples.
    """
    stamps, values = increasing_rows(stamps, values)
    if len(stamps) < 2:
        return np.full((len(wanted), values.shape[1]), np.nan)
    time, asked = _seconds(stamps, int(stamps[0])), _seconds(wanted, int(stamps[0]))
    period = _period(np.sort(asked)) if len(asked) > 1 else 0.0
    if period > faster * _period(time):
        low, high = (np.clip(asked + side * period / 2, time[0], time[-1]) for side in (-1, 1))
        width = np.maximum(high - low, 1e-9)
        columns = ((_integral(high, time, v) - _integral(low, time, v)) / width for v in values.T)
    else:
        columns = (np.interp(asked, time, v) for v in values.T)
    out = np.stack(list(columns), axis=1)
    out[outside(asked, time)] = np.nan
    return out


def _seconds(stamps: Stamps, origin: int) -> Array:
    return np.asarray((stamps - origin) * 1e-9, dtype=float)


def _period(time: Array) -> float:
    return max(float(np.median(np.diff(time))), 1e-9)


def _integral(asked: Array, time: Array, values: Array) -> Array:
    """Integral from the first sample to `asked`."""
    steps = np.diff(time)
    whole = np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * steps)))
    left = np.clip(np.searchsorted(time, asked, side="right") - 1, 0, len(steps) - 1)
    into = asked - time[left]
    slope = (values[left + 1] - values[left]) / steps[left]
    return np.asarray(whole[left] + into * (values[left] + 0.5 * slope * into))


def outside(asked: Array, time: Array, gap: float = 4.0) -> Mask:
    """Where `asked` lies beyond the ends of `time`, or inside a gap of it.

    A gap is longer than `gap` usual periods, more than for a series of its own: autopilots thin topics unevenly.
    """
    right = np.clip(np.searchsorted(time, asked), 1, len(time) - 1)
    step = time[right] - time[right - 1]
    inside = (asked > time[right - 1]) & (asked < time[right])
    beyond = (asked < time[0] - 1e-6) | (asked > time[-1] + 1e-6)
    return np.asarray(beyond | (inside & (step > gap * _period(time))))


def cubic_at(wanted: Stamps, stamps: Stamps, values: Array, rates: Array) -> Array:
    """As `values_at`, of values whose `rates` (K, C) [1/s] are known too: cubics that have both at every sample.

    Where value and rate contradict each other by more than the motion within an interval, the line between them.
    """
    stamps, both = increasing_rows(stamps, np.hstack((values, rates)))
    count = values.shape[1]
    if len(stamps) < 2:
        return np.full((len(wanted), count), np.nan)
    x, v = both[:, :count], both[:, count:]
    time, asked = _seconds(stamps, int(stamps[0])), _seconds(wanted, int(stamps[0]))
    right = np.clip(np.searchsorted(time, asked), 1, len(time) - 1)
    left = right - 1
    h = (time[right] - time[left])[:, None]
    s = np.clip((asked - time[left])[:, None] / h, 0.0, 1.0)
    chord = x[right] - x[left]
    tangents = h * v[left], h * v[right]
    fair = np.abs(chord - 0.5 * (tangents[0] + tangents[1])) <= 0.05 + 0.5 * np.abs(chord)
    bend = (1 - s) * s * ((1 - s) * (tangents[0] - chord) - s * (tangents[1] - chord))
    out = np.asarray(x[left] + s * chord + np.where(fair, bend, 0.0))
    out[outside(asked, time)] = np.nan
    return out


def are_pulses(values: NDArray[Any], lowest: float = 700.0, highest: float = 2300.0) -> Mask:
    """Which numbers are pulse widths [us] of a motor that is armed or not."""
    return np.asarray((values >= lowest) & (values <= highest))


def vector(prefix: str, values: Array, axes: str = "xyz") -> Columns:
    """Columns `prefix.x`, `prefix.y`, ... of an array (N, 3), or of quaternions (N, 4) with `axes` "wxyz"."""
    return {f"{prefix}.{axis}": values[:, i] for i, axis in enumerate(axes)}


@dataclass(frozen=True)
class StandardTopic:
    """A topic to be: its name, and when its N messages were logged and stamped [ns]."""

    topic: str
    log_time_ns: Stamps
    stamps: Stamps

    def __post_init__(self) -> None:
        if self.stamps.ndim != 1:
            raise ValueError("a message has several stamps")

    def imu(self, omega_B: Array | None, specific_force_B: Array | None) -> Table:
        """Of gyroscope and accelerometer (N, 3); what is None was not measured."""
        columns = vector("angular_velocity", self._or_unknown(omega_B))
        return self.table(
            "sensor_msgs/msg/Imu", columns | vector("linear_acceleration", self._or_unknown(specific_force_B))
        )

    def odometry(
        self, position_E: Array, quat_EB: Array, velocity_E: Array | None = None, omega_B: Array | None = None
    ) -> Table:
        """Of a pose, a velocity in E (which the type wants in the body) and body rates."""
        columns = vector("pose.pose.position", position_E) | vector("pose.pose.orientation", quat_EB, "wxyz")
        velocity_B = None if velocity_E is None else so3.rotate_inverse(quat_EB, velocity_E)
        columns |= vector("twist.twist.linear", self._or_unknown(velocity_B))
        return self.table("nav_msgs/msg/Odometry", columns | vector("twist.twist.angular", self._or_unknown(omega_B)))

    def wrench(self, force_B: Array, torque_B: Array) -> Table:
        """Of force and torque (N, 3); the topic's name says where they are normalised."""
        columns = vector("wrench.force", force_B) | vector("wrench.torque", torque_B)
        return self.table("geometry_msgs/msg/WrenchStamped", columns)

    def actuators(self, rotors: Array | None, tilt: Array | None = None, unit: SpeedUnit = "rad/s") -> Table:
        """Of rotor commands (N, R) and tilt angles (N, A) [rad]."""
        columns: Columns = {} if tilt is None else {"position": tilt}
        if rotors is not None:
            columns["normalized" if unit == "normalised" else "velocity"] = rotors
        return self.table("actuator_msgs/msg/Actuators", columns)

    def battery(self, voltage: Array) -> Table:
        """Of a voltage (N,) [V]."""
        return self.table("sensor_msgs/msg/BatteryState", {"voltage": voltage})

    def acceleration(self, linear: Array | None, angular: Array | None = None) -> Table:
        """Of a reference's acceleration and that of its rates (N, 3), in the frame that fits."""
        columns = vector("accel.linear", self._or_unknown(linear))
        return self.table(
            "geometry_msgs/msg/AccelStamped", columns | vector("accel.angular", self._or_unknown(angular))
        )

    def _or_unknown(self, values: Array | None) -> Array:
        return np.full((len(self.stamps), 3), np.nan) if values is None else values

    def table(self, kind: str, columns: Columns) -> Table:
        """Of any type."""
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


def clocked(table: Table, clock: str) -> Table | None:
    """The table with arrays of one number as numbers; None where the field `clock` is no number in every message."""
    columns = {name: v[:, 0] if v.shape[1:] == (1,) else v for name, v in table.columns.items()}
    times = columns.get(clock)
    known = times is not None and times.ndim == 1 and times.dtype.kind in "iuf"
    return replace(table, columns=columns) if known else None


def numbers(table: Table, *names: str) -> Array | None:
    """Fields (N, K) side by side; arrays give all their columns. None where the messages lack one, or it is a text."""
    if any(name not in table.columns or table.columns[name].dtype.kind not in "iufb" for name in names):
        return None
    return np.hstack([np.asarray(table.columns[name], dtype=float).reshape(len(table), -1) for name in names])


@dataclass(frozen=True)
class Messages:
    """An autopilot's messages by name, further instances as `name/1`; `parameters` are its own, where the log has them.

    What is made of them goes to topics below `prefix`. `notes` grow: what was repaired, or is not there.
    """

    prefix: str
    tables: Mapping[str, Table]
    parameters: Mapping[str, float | int]
    notes: list[str] = field(default_factory=list)

    def read(self, name: str, *fields: str | tuple[str, ...]) -> tuple[Any, ...] | None:
        """A message's table, and the numbers (N, K) of each of `fields`; None where it, or one of them, is missing."""
        table = self.tables.get(name)
        if table is None or not len(table) or not table.columns:
            return None
        found = [numbers(table, *((each,) if isinstance(each, str) else each)) for each in fields]
        return None if any(values is None for values in found) else (table, *found)

    def instances(self, name: str) -> list[tuple[int, str]]:
        """The number and the key of all instances of a message."""
        keys = [key.partition("/") for key in self.tables]
        return sorted((int(number or 0), f"{own}{slash}{number}") for own, slash, number in keys if own == name)

    def made(self, name: str, table: Table, stamps: Stamps | None = None) -> StandardTopic:
        """A topic to be, with the log times of a message and its own `stamps`."""
        return StandardTopic(
            f"{self.prefix}/{name}", table.log_time_ns, table.log_time_ns if stamps is None else stamps
        )


Made = Iterator[tuple[str, Table]]
"""Topics, each with the names of the messages that it is made of."""


def made_of(
    said: Messages, makers: Iterable[Callable[[Messages], Made]], whose: str
) -> tuple[dict[str, Table], list[str]]:
    """Topics that the makers give, by name, and what to say of them, of `whose` messages; nothing where there are none.

    Messages whose fields have other shapes than they should come from a damaged file.
    """
    made: list[tuple[str, Table]] = []
    for make in makers:
        try:
            with np.errstate(invalid="ignore", over="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # what is absurd is left out later, and counted
                made += [(source, table) for source, table in make(said) if len(table) > 1]
        except (ValueError, IndexError, TypeError) as error:
            said.notes.append(f"{said.prefix}: {make.__name__} could not be made of damaged messages ({error}).")
    if not made:
        return {}, []
    listed = "; ".join(f"{table.topic} from {source}" for source, table in made)
    notes = [f"{whose} in FRD and NED became, in FLU and ENU: {listed}.", *said.notes]
    return {table.topic: table for _, table in made}, notes
