"""From columns whose header is known to topics that play roles."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from wrenchgap.flight.flight import Array, SpeedUnit
from wrenchgap.flight.formats.aerospace import quat_of_euler
from wrenchgap.flight.formats.headers import Meaning, meaning
from wrenchgap.flight.formats.made import Made, taken
from wrenchgap.flight.formats.merging import Stamps
from wrenchgap.flight.formats.table import Columns, Table

MOST = 12
"""Names of columns in a sentence."""


def from_columns(columns: Mapping[str, Array], stamps: Stamps) -> tuple[dict[str, Table], list[str]]:
    """Topics made of columns (N,) at `stamps` (N,) [ns], and what to say of units and of columns left aside."""
    known = _Known(stamps)
    for header, values in columns.items():
        known.add(header, values, meaning(header))
    made = {table.topic: table for table in map(_present, known.topics()) if len(table) > 1}
    return made, known.words() if made or known.unknown else []


@dataclass
class _Known:
    """Columns by field and place, in SI; `units` are those that the headers state."""

    stamps: Stamps
    fields: dict[str, dict[int, Array]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    unknown: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def add(self, header: str, values: Array, found: Meaning | None) -> None:
        """Keep a column; the first of two with the same meaning counts."""
        if found is None or found.field == "time" or found.index in self.fields.get(found.field, {}):
            self.unknown.append(header)
            return
        self.fields.setdefault(found.field, {})[found.index] = values * found.factor
        self.units.setdefault(found.field, found.unit)

    def whole(self, name: str, width: int) -> Array | None:
        """A vector (N, width), or None where a column is missing."""
        parts = self.fields.get(name, {})
        if set(parts) >= set(range(width)):
            return np.stack([parts[i] for i in range(width)], axis=1)
        if parts:
            self.notes.append(f"{name}: {len(parts)} of {width} columns: not used.")
        return None

    def numbered(self, name: str) -> Array | None:
        """Columns (N, K) in the order of their numbers."""
        parts = self.fields.get(name, {})
        return np.stack([parts[i] for i in sorted(parts)], axis=1) if parts else None

    def topics(self) -> Iterator[Table]:
        gyro, acc = self.whole("gyro", 3), self.whole("acc", 3)
        if gyro is not None or acc is not None:
            yield self._to("/imu").imu(gyro, acc)
        yield from self._wrenches()
        yield from self._actuators()
        yield from self._poses()
        if (voltage := self.whole("voltage", 1)) is not None:
            yield self._to("/battery").battery(voltage[:, 0])

    def _to(self, topic: str) -> Made:
        return Made(topic, self.stamps, self.stamps)

    def _wrenches(self) -> Iterator[Table]:
        for prefix, topic in (("", "/command/wrench"), ("ref ", "/desired/wrench")):
            force, torque = self.whole(f"{prefix}force", 3), self.whole(f"{prefix}torque", 3)
            if force is not None and torque is not None:
                yield self._to(topic).wrench(force, torque)
            elif force is not None or torque is not None:
                self.notes.append(f"{topic}: a wrench needs force and torque; only one of them is there.")

    def _actuators(self) -> Iterator[Table]:
        rotors, tilt = self.numbered("rotor"), self.numbered("tilt")
        if rotors is None and tilt is None:
            return
        unit: SpeedUnit = "rad/s"
        stated = self.units.get("rotor", "")
        if stated in ("pwm", "normalised"):
            unit = "pwm" if stated == "pwm" else "normalised"
        elif rotors is not None and not stated and np.nanmax(np.abs(rotors), initial=0.0) <= 1.0:
            unit = "normalised"
            self.notes.append("rotor: the header states no unit and no value exceeds 1: read as normalised commands.")
        topic = "/command/actuators_pwm" if unit == "pwm" else "/command/actuators"
        yield self._to(topic).actuators(rotors, tilt, unit)

    def _poses(self) -> Iterator[Table]:
        for prefix, topic in (("", "/odometry"), ("ref ", "/reference")):
            place, quat = self.whole(f"{prefix}position", 3), self._attitude(prefix)
            velocity = self.whole(f"{prefix}velocity", 3)
            if place is not None and quat is not None:
                yield self._to(topic).odometry(place, quat, velocity)
                asked = self.whole("ref acc", 3) if prefix else None
                if asked is not None:
                    yield self._to("/reference/acceleration").acceleration(asked)
            elif place is not None or quat is not None:
                missing = "attitude" if quat is None else "position"
                self.notes.append(f"{topic}: no {missing} among the columns: not used.")

    def _attitude(self, prefix: str) -> Array | None:
        """Quaternions (N, 4), scalar first, of B to E, or None."""
        quat = self.whole(f"{prefix}orientation", 4)
        angles = [self.fields.get(f"{prefix}{name}", {}).get(0) for name in ("roll", "pitch", "yaw")]
        roll, pitch, yaw = angles
        if quat is not None or roll is None or pitch is None or yaw is None:
            return quat
        self.notes.append(
            "roll, pitch and yaw are taken as those of forward-left-up in east-north-up, turned in the order yaw, "
            "pitch, roll: a nose that rises has a negative pitch."
        )
        return quat_of_euler(roll, pitch, yaw)

    def words(self) -> list[str]:
        """One sentence on units, one on columns that are not known, and what else was noticed."""
        spelled = {name: re.sub(r" (?=[sh])", "/", unit) for name, unit in self.units.items()}
        said = [f"{name} {unit}" for name, unit in spelled.items() if unit]
        bare = [name for name, unit in self.units.items() if not unit and "orientation" not in name]
        parts = [f"as the header states: {', '.join(said)}"] if said else []
        parts += [f"taken as SI, as none is stated: {', '.join(bare)}"] if bare else []
        out = [f"Units {'; '.join(parts)}. Axes are taken as forward-left-up and east-north-up."] if parts else []
        if self.unknown:
            out.append(f"Columns whose names say no known quantity: {listed(self.unknown)}.")
        return out + self.notes


def listed(names: Sequence[str], longest: int = 100) -> str:
    """Names for a sentence: the first `MOST`, each to its `longest` letter, and how many more there are."""
    more = f" and {len(names) - MOST} more" if len(names) > MOST else ""
    return f"{', '.join(f'{name:.{longest}}' for name in names[:MOST])}{more}"


def _present(table: Table) -> Table:
    """The rows in which a topic has any number: topics of different rates may share a table, with empty cells."""
    columns: Columns = table.columns
    rows = np.any([np.isfinite(v).reshape(len(table), -1).any(axis=1) for v in columns.values()], axis=0)
    return table if rows.all() else taken(table, np.flatnonzero(rows))
