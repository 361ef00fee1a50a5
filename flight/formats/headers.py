"""What the header of a table means: quantities, axes and units by the names of columns (docs/formats.md).

A header is a name, an axis or number, and perhaps a unit, which stands in brackets or at the end: `gyro_x [deg/s]`,
`gyro_x_dps`, `gyroX`. Names are compared without regard to capitals and punctuation. Words before a known name must be
known as well (`imu_gyro_x`, `ref_pos_z`), so that a payload's position is not taken for the vehicle's.
Columns whose header is known become topics that play roles.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from wrenchgap.flight.budget import LIMITS
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import GRAVITY, Array, SpeedUnit
from wrenchgap.flight.formats.ned_frd import quat_of_euler
from wrenchgap.flight.formats.standard_topics import RPM, Stamps, StandardTopic, taken
from wrenchgap.flight.formats.table import Table

DEGREE = np.pi / 180.0


UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9},
    "rate": {"rad s": 1.0, "rads": 1.0, "radps": 1.0, "deg s": DEGREE, "degs": DEGREE, "dps": DEGREE},
    "acceleration": {
        **dict.fromkeys(("m s2", "m s 2", "mps2", "mss", "ms2"), 1.0),
        "g": GRAVITY,
        "mg": 1e-3 * GRAVITY,
    },
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "speed": {"m s": 1.0, "mps": 1.0, "cm s": 1e-2, "mm s": 1e-3, "km h": 1.0 / 3.6},
    "angle": {"rad": 1.0, "deg": DEGREE, "degrees": DEGREE},
    "number": {},
    "force": {"n": 1.0, "mn": 1e-3},
    "torque": {"nm": 1.0, "n m": 1.0, "nmm": 1e-3, "mnm": 1e-3},
    "rotor": {"rad s": 1.0, "rads": 1.0, "radps": 1.0, "rpm": RPM, "krpm": 1e3 * RPM, "hz": 2.0 * np.pi},
    "tilt": {"rad": 1.0, "deg": DEGREE},
    "voltage": {"v": 1.0, "volt": 1.0, "mv": 1e-3, "m v": 1e-3},
}
"""Factors to SI by quantity; "/", "^" and "*" of a unit are read as blanks."""
OTHER_ROTOR_UNITS = {
    **dict.fromkeys(("pwm", "us"), "pwm"),
    **dict.fromkeys(("normalised", "normalized", "norm"), "normalised"),
}

_XYZ, _WXYZ = "xyz", "wxyz"
_NAMES: tuple[tuple[str, str, str, str], ...] = (
    ("time", "time", "", "time t timestamp stamp seconds sec secs elapsed elapsed_time time_stamp timeus log_time"),
    ("rotor", "rotor", "number", "motor rotor rotor_speed motor_speed esc omega w m rpm pwm throttle motor_cmd"),
    ("rotor", "rotor", "number", "motor_command motor_rpm rotor_rpm esc_rpm motor_pwm esc_pwm motor_throttle"),
    ("tilt", "tilt", "number", "tilt tilt_angle servo servo_angle arm_angle alpha"),
    ("gyro", "rate", _XYZ, "gyro gyr gyroscope angular_velocity ang_vel angvel omega body_rate w g"),
    ("acc", "acceleration", _XYZ, "acc accel accelerometer linear_acceleration specific_force acceleration a"),
    ("position", "length", _XYZ, "position pos translation p"),
    ("position", "length", "bare", ""),
    ("velocity", "speed", _XYZ, "velocity vel linear_velocity v"),
    ("orientation", "number", _WXYZ, "orientation quaternion quat attitude rotation q"),
    ("roll", "angle", "", "roll phi"),
    ("pitch", "angle", "", "pitch theta"),
    ("yaw", "angle", "", "yaw psi heading"),
    ("force", "force", _XYZ, "force wrench_force f thrust"),
    ("torque", "torque", _XYZ, "torque moment tau wrench_torque t"),
    ("voltage", "voltage", "", "voltage battery vbat battery_voltage bat_voltage battery_volt"),
)
Names = tuple[list[str], ...]
_SPLIT: tuple[tuple[str, str, str, Names], ...] = tuple(
    (field, quantity, axes, tuple(name.split("_") for name in sorted(spelled.split(), key=len, reverse=True)))
    for field, quantity, axes, spelled in _NAMES
)
"""The same with names as words, the longest first."""
_BARE = tuple(entry for entry in _SPLIT if entry[2] == "bare")
_SPELLED = {
    last: tuple(entry for entry in _SPLIT if entry[2] == "bare" or any(name[-1] == last for name in entry[3]))
    for last in {name[-1] for entry in _SPLIT for name in entry[3]}
}
"""Those that a last word leaves: a table may have a hundred thousand columns."""
_REFERENCE = frozenset({"ref", "reference", "des", "desired", "setpoint", "sp", "target"})
_KNOWN = _REFERENCE | frozenset(
    {"imu", "odom", "odometry", "state", "vehicle", "body", "pose", "twist", "mocap", "vicon", "est", "estimate", "cmd"}
    | {"command", "commanded", "wrench", "drone", "uav", "quad", "world", "local", "linear", "angular", "ground"}
    | {"truth", "header", "sensor", "battery", "actuators", "actuator"}
)


@dataclass(frozen=True)
class Meaning:
    """Of one column: `field` ("gyro", "ref position", ...), place along it, factor to SI, unit if one is stated."""

    field: str
    index: int
    factor: float
    unit: str


@lru_cache(maxsize=4096)
def meaning(header: str) -> Meaning | None:
    """What a column holds, or None where its header is not known."""
    if len(header) > LIMITS.header_letters:
        return None
    name, bracketed = _split(header)
    for words, index in _indexed(name):
        for size in range(len(words) + 1):
            for found in _named(words[:size], words[size:], index, bracketed):
                return found
    return None


def _split(header: str) -> tuple[list[str], str | None]:
    """Lower-case words, and the unit in brackets."""
    name, unit = header.strip(), None
    if name.endswith(("]", ")")):
        inner = name[:-1]
        first = max(inner.rfind("]"), inner.rfind(")"), 0)
        for at in range(first, len(inner) - 1):  # the first bracket that the last one closes and that holds no number
            if inner[at] in "[(" and not inner[at + 1].isdecimal():
                name, unit = inner[:at].rstrip(), inner[at + 1 :]
                break
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return [word.lower() for word in re.split(r"[^A-Za-z0-9µ]+", spaced) if word], unit


def _indexed(words: list[str]) -> Iterator[tuple[list[str], str]]:
    """The words with an axis or number taken out of them, wherever one may be; without one last."""
    for place in range(len(words) - 1, -1, -1):
        word, rest = words[place], (words[:place], words[place + 1 :])
        if re.fullmatch(r"[wxyz]|\d+", word) and (place or word in "xyz"):
            yield [*rest[0], *rest[1]], word
        elif match := re.fullmatch(r"([a-zµ]+?)([wxyz]|\d+)", word):
            yield [*rest[0], match[1], *rest[1]], match[2]
    if words:
        yield words, ""


def _named(words: list[str], unit: list[str], index: str, bracketed: str | None) -> Iterator[Meaning]:
    """Meanings of a name whose last words are `unit`."""
    if unit and bracketed is not None:
        return
    stated = " ".join(unit) if bracketed is None else " ".join(re.split(r"[^\wµ]+", bracketed.lower())).strip()
    for name, quantity, axes, spelled in _SPELLED.get(words[-1] if words else "", _BARE):
        prefix = _before(words, spelled, bare=axes == "bare")
        place = _place(index, axes)
        if prefix is None or place is None or not prefix <= _KNOWN:
            continue
        if axes == "" and name == "time" and prefix:
            continue
        factor = _factor(quantity, stated, words)
        if factor is not None:
            reference = "ref " if prefix & _REFERENCE and name not in ("rotor", "tilt", "voltage", "time") else ""
            yield Meaning(reference + name, place, factor[0], factor[1])


def _before(words: list[str], spelled: Names, bare: bool) -> frozenset[str] | None:
    """The words before a known name; None where the words do not end in one. A bare axis has no name at all."""
    if bare:
        return frozenset(words) if not set(words) - _KNOWN else None
    for parts in spelled:
        if words[-len(parts) :] == parts:
            return frozenset(words[: -len(parts)])
    return None


def _place(index: str, axes: str) -> int | None:
    """Where along a field of these axes an index is; None where it cannot be."""
    if axes == "":
        return 0 if not index else None
    if axes == "number":
        return int(index) if index.isdigit() else None
    letters = _XYZ if axes == "bare" else axes
    if index.isdigit() and axes != "bare":
        return int(index) if int(index) < len(axes) else None
    return letters.index(index) if index and index in letters else None


def _factor(quantity: str, stated: str, words: list[str]) -> tuple[float, str] | None:
    """Factor and unit; "" where none is stated, None where the stated one does not belong to the quantity."""
    if quantity == "rotor" and not stated:
        spelt = (("rpm", "rpm"), ("pwm", "pwm"), ("throttle", "normalised"))
        stated = next((unit for word, unit in spelt if word in words), "")
    if quantity == "rotor" and stated in OTHER_ROTOR_UNITS:
        return 1.0, OTHER_ROTOR_UNITS[stated]
    if not stated:
        return 1.0, ""
    known = UNITS[quantity].get(stated)
    return None if known is None else (known, stated)


def from_columns(columns: Mapping[str, Array], stamps: Stamps) -> tuple[dict[str, Table], list[str]]:
    """Topics made of columns (N,) at `stamps` (N,) [ns], and what to say of units and of columns left aside.

    Of each topic the rows in which it has any number: topics of different rates may share a table, with empty cells.
    """
    known = _Known(stamps)
    for header, values in columns.items():
        known.add(header, values, meaning(header))
    made: dict[str, Table] = {}
    for table in known.topics():
        rows = np.any([np.isfinite(v).reshape(len(table), -1).any(axis=1) for v in table.columns.values()], axis=0)
        some = table if rows.all() else taken(table, np.flatnonzero(rows))
        if len(some) > 1:
            made[some.topic] = some
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
        stated = self.units.setdefault(found.field, found.unit)
        if found.field == "rotor" and stated != found.unit:  # shares, pulses and speeds are told apart by it
            raise LogError(
                f"column {header!r} is in {found.unit or 'no unit'}, others of {found.field} in {stated or 'no unit'}; "
                "write one unit for all of them"
            )
        self.fields.setdefault(found.field, {})[found.index] = values * found.factor

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
        for prefix, topic in (("", "/command/wrench"), ("ref ", "/desired/wrench")):
            force, torque = self.whole(f"{prefix}force", 3), self.whole(f"{prefix}torque", 3)
            if force is not None and torque is not None:
                yield self._to(topic).wrench(force, torque)
            elif force is not None or torque is not None:
                self.notes.append(f"{topic}: a wrench needs force and torque; only one of them is there.")
        rotors, tilt = self.numbered("rotor"), self.numbered("tilt")
        if rotors is not None or tilt is not None:
            yield self._actuators(rotors, tilt)
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
        if (voltage := self.whole("voltage", 1)) is not None:
            yield self._to("/battery").battery(voltage[:, 0])

    def _actuators(self, rotors: Array | None, tilt: Array | None) -> Table:
        unit: SpeedUnit = "rad/s"
        stated = self.units.get("rotor", "")
        if stated == "pwm":
            unit = "pwm"
        elif stated == "normalised":
            unit = "normalised"
        elif rotors is not None and not stated and np.nanmax(np.abs(rotors), initial=0.0) <= 1.0:
            unit = "normalised"
            self.notes.append("rotor: the header states no unit and no value exceeds 1: read as normalised commands.")
        topic = "/command/actuators_pwm" if unit == "pwm" else "/command/actuators"
        return self._to(topic).actuators(rotors, tilt, unit)

    def _to(self, topic: str) -> StandardTopic:
        return StandardTopic(topic, self.stamps, self.stamps)

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


def listed(names: Sequence[str], longest: int = 100, most: int = 12) -> str:
    """Names for a sentence: the first `most`, each to its `longest` letter, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(f'{name:.{longest}}' for name in names[:most])}{more}"
