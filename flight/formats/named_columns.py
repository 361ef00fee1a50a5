"""Topics of a table: columns whose headers are known, in SI, and in words what was taken for what.

What a header does not state is decided by the numbers where they leave no doubt (`flight.formats.unit_evidence`), else
by what the firmware logs whose names these are, else taken as SI; each is said.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wrenchgap.flight.budget import LIMITS
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import GRAVITY, Array, Mask, SpeedUnit, Stamps
from wrenchgap.flight.formats import unit_evidence
from wrenchgap.flight.formats.headers import BLACKBOX, CRAZYFLIE, UNITS, Meaning, listed, meaning
from wrenchgap.flight.formats.ned_frd import quat_of_euler
from wrenchgap.flight.formats.reader import Columns, Table
from wrenchgap.flight.formats.standard_topics import StandardTopic, taken


def tables_of_columns(
    topic: str, columns: Columns, stamps: Stamps, where: object
) -> tuple[dict[str, Table], list[str]]:
    """A table of columns (N,) at `stamps` (N,) [ns] as a `topic`, with those that its headers make, and what to say.

    Raises LogError, of the file `where`, for columns that contradict one another.
    """
    try:
        made, words = from_columns(columns, stamps)
    except LogError as error:
        raise LogError(f"{where}: {error}") from error
    firmware = next((found.firmware for found in map(meaning, columns) if found is not None and found.firmware), "")
    return {topic: Table(topic, "table", stamps, stamps, _fields(columns), firmware=firmware)} | made, words


def _fields(columns: Columns) -> Columns:
    """Columns under names that a mapping can spell, series of columns as arrays, and all of them as `data`."""
    out: Columns = {}
    series: dict[str, list[Any]] = {}
    for header, values in columns.items():
        name = re.sub(r"\W+", "_", header).strip("_")
        out[name] = values
        if len(name) <= LIMITS.header_letters and (match := re.fullmatch(r"(\w+?)_?([wxyz]|\d+)", name)):
            series.setdefault(match[1], []).append(values)
    arrays = {name: np.stack(parts, 1) for name, parts in series.items() if len(parts) > 1 and name not in out}
    everything = {"data": np.stack(list(columns.values()), 1)} if columns else {}
    return out | arrays | everything


def from_columns(columns: Mapping[str, Array], stamps: Stamps) -> tuple[dict[str, Table], list[str]]:
    """Topics made of columns (N,) at `stamps` (N,) [ns], and what to say of units and of columns left aside.

    Of each topic the rows in which it has any number: topics of different rates may share a table, with empty cells.
    """
    known = _Known(stamps)
    for header, values in columns.items():
        known.add(header, values, meaning(header))
    known.settle()
    made: dict[str, Table] = {}
    for table in known.topics():
        rows = known.beyond | np.any(
            [np.isfinite(v).reshape(len(table), -1).any(axis=1) for v in table.columns.values()], axis=0
        )
        some = table if rows.all() else taken(table, np.flatnonzero(rows))
        if len(some) > 1:
            made[some.topic] = some
    return made, known.words() if made or known.unknown else []


THROUGHOUT = 0.95
"""Share of a motor's running samples beyond its range from which on its unit is another: a file that was extrapolated
behind its end has a flight before."""
NO_SPEED = 3500.0
"""Speed [rad/s] that no rotor of a Crazyflie reaches: they end at 2800."""


@dataclass
class _Known:
    """Columns by field and place, in SI; `units` are those that the headers state, or that `usual` firmwares log."""

    stamps: Stamps
    fields: dict[str, dict[int, Array]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    usual: dict[str, str] = field(default_factory=dict)
    unknown: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    beyond: Mask = field(init=False)
    """Rows (N,) that cannot be: kept without a number, so that readers count them."""

    def __post_init__(self) -> None:
        self.beyond = np.zeros(len(self.stamps), dtype=bool)

    def add(self, header: str, values: Array, found: Meaning | None) -> None:
        """Keep a column; the first of two with the same meaning counts."""
        if found is None or found.field == "time" or found.index in self.fields.get(found.field, {}):
            self.unknown.append(header)
            return
        stated = self.units.setdefault(found.field, found.unit)
        if found.firmware:
            self.usual[found.field] = found.firmware
        decided = found.field == "rotor" or (found.field in ("gyro", "acc") and "" in (stated, found.unit))
        if decided and stated != found.unit:  # shares, pulses and speeds are told apart by it
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

    def settle(self) -> None:
        """Decide units that no header states, and leave out rows that cannot be."""
        rotors = self.numbered("rotor")
        largest = 0.0 if rotors is None else float(np.nanmax(rotors, initial=0.0))
        if rotors is not None and not self.units["rotor"] and CRAZYFLIE in self.usual.values() and largest > NO_SPEED:
            self._replace("rotor", rotors, "of 65535")
            self.notes.append("m1 ... are read as the PWM of motor.m1 ...: beside a Crazyflie's names, and no speeds.")
        if self.units.get("rotor") == "of 65535":
            self._pwm_of_16_bits()
        rotors = self.numbered("rotor")
        if rotors is not None and BLACKBOX in self.usual.values() and not self.units["rotor"]:
            found = unit_evidence.blackbox_outputs(rotors)
            words = "no pulses of 900 to 2100 us and no DSHOT of 48 to 2047: not used"
            if found is None:
                self.fields.pop("rotor")
            else:
                self._replace("rotor", found[0], found[1])
                words = "pulses in us" if found[1] == "pwm" else "DSHOT, of 48 to 2047: read as shares of full throttle"
            self.notes.append(f"motor: by its smallest and largest values {words}.")
        if any(header.startswith("eRPM") for header in self.unknown):
            self.notes.append(
                "eRPM counts 100 electrical turns a minute. With N magnets in a motor's bell these are rotor speeds: "
                "--topic rotor_speed=/table.eRPM*F, where F is 20.944 / N (14 magnets: 1.496)."
            )
        gyro, acc = self.whole("gyro", 3), self.whole("acc", 3)
        if gyro is not None and not self.units["gyro"]:
            self._rate(gyro)
        if acc is not None and self.units["acc"] == "counts":
            self._counts(acc)
        elif acc is not None and not self.units["acc"]:
            self._acceleration(acc)

    def _pwm_of_16_bits(self, largest: float = 65535.0) -> None:
        """Commands of 0 to 65535 as shares, without the rows that hold larger ones, which were made up."""
        parts = self.fields["rotor"]
        tops = {i: float(np.nanmax(values, initial=0.0)) for i, values in parts.items()}
        small = [i for i, top in tops.items() if 0.0 < top <= 1.0]
        if small and max(tops.values()) > 1.0:
            raise LogError(
                f"motor.m{small[0]} never exceeds 1 and another motor reaches {max(tops.values()):.6g}; write one unit "
                "for all of them"
            )
        if small:
            self.units["rotor"] = "normalised"
            self.notes.append("motor.m: no value exceeds 1: read as shares of full throttle, not as PWM of 0 to 65535.")
            return
        values = np.stack([parts[i] for i in sorted(parts)], axis=1)
        self.beyond = beyond = np.any((values > largest) | (values < 0.0), axis=1)
        sent = int(np.isfinite(values).any(axis=1).sum())
        for i, column in zip(sorted(parts), values.T, strict=True):
            wrong, running = (column > largest) | (column < 0.0), (column != 0.0) & ~np.isnan(column)
            if wrong.sum() > THROUGHOUT * running.sum():  # all of a flight, and not the end of a file
                raise LogError(
                    f"motor.m{i} is outside of 0 to 65535, the PWM of a Crazyflie, in nearly all rows "
                    f"({np.nanmin(column):.6g} to {np.nanmax(column):.6g}); write its unit into the header, as in "
                    f"motor_m{i}_rpm"
                )
        if beyond.any():
            self.notes.append(
                f"{beyond.sum()} of {sent} rows ({100 * beyond.sum() / sent:.0f} %) hold PWM that no Crazyflie sends "
                f"(0 to 65535; here {np.nanmin(values):.6g} to {np.nanmax(values):.6g}): such a row was extrapolated "
                "or is damaged, and is left out of every topic."
            )
            for columns in self.fields.values():
                for i in columns:
                    columns[i] = np.where(beyond, np.nan, columns[i])
        self._replace("rotor", np.where(beyond[:, None], np.nan, values) / largest, "of 65535")

    def _replace(self, name: str, values: Array, unit: str | None = None) -> None:
        """Columns (N, K) of a field in place of its own, in the order of their numbers; a note says their unit."""
        self.fields[name] = {i: values[:, k] for k, i in enumerate(sorted(self.fields[name]))}
        self.units.pop(name)
        if unit is not None:
            self.units[name] = unit

    def _rate(self, gyro: Array) -> None:
        """The unit of a gyroscope by the attitude's rate."""
        attitudes = (self._attitude(prefix) for prefix in ("", "est "))
        found = (unit_evidence.rate_unit(self.stamps, gyro, quat) for quat in attitudes if quat is not None)
        told = next((one for one in found if one is not None), None)
        if told is not None:
            unit, why = told[0], f"its numbers are {told[1]:.3g} times the attitude's rate in rad/s"
            why += ", and one deg/s is 57 times" if told[0] == "rad s" else ", of which one is 57 deg/s"
        elif CRAZYFLIE in self.usual.values():
            unit, why = "deg s", "as the Crazyflie logs gyro.x; no attitude beside it turns enough to confirm it"
        else:
            return
        if unit == "deg s" or CRAZYFLIE in self.usual.values():
            self._replace("gyro", gyro * UNITS["rate"][unit])
            self.notes.append(f"gyro is read in {unit.replace(' ', '/')}: {why}.")

    def _acceleration(self, acc: Array) -> None:
        """The unit of an accelerometer by gravity."""
        size = unit_evidence.upright_median(acc)
        told = None if size is None else unit_evidence.acceleration_unit(size)
        if told is not None:
            unit, why = told, f"its median is {size:.3g}, nearly along z, which is 1 g"
        elif CRAZYFLIE in self.usual.values():
            unit, why = "g", "as the Crazyflie logs acc.x; its median is not 1 g along z, which would confirm it"
        else:
            return
        if unit != "m s2" or CRAZYFLIE in self.usual.values():
            self._replace("acc", acc * UNITS["acceleration"][unit])
            self.notes.append(f"acc is read in {unit.replace('m s2', 'm/s^2')}: {why}.")

    def _counts(self, acc: Array) -> None:
        """An accelerometer in counts, of which the log's own header alone says how many are 1 g."""
        size = unit_evidence.upright_median(acc)
        one = None if size is None else unit_evidence.counts_of_gravity(size)
        if one is None:
            self.fields.pop("acc")
            self.units.pop("acc")
            self.notes.append(
                "accSmooth is in counts, and how many are 1 g cannot be seen in them: not used. With acc_1G of the "
                f"log's header: --topic accelerometer=/table.accSmooth*F, where F is {GRAVITY:g} / acc_1G."
            )
            return
        self._replace("acc", acc * (GRAVITY / one))
        self.notes.append(
            f"accSmooth is in counts: {one} of them are read as 1 g, the power of two next to its median of "
            f"{size:.0f}; acc_1G of the log's header would say it."
        )

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
        for prefix, topic in (("", "/odometry"), ("est ", "/estimator"), ("ref ", "/reference")):
            place, quat = self.whole(f"{prefix}position", 3), self._attitude(prefix)
            velocity = self.whole(f"{prefix}velocity", 3)
            if place is not None and quat is not None:
                yield self._to(topic).odometry(place, quat, velocity)
                asked = self.whole("ref acc", 3) if prefix == "ref " else None
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
        elif stated in ("normalised", "of 65535"):
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
        spelled = {name: unit.replace("of 65535", "PWM of 0 to 65535") for name, unit in spelled.items()}
        said = [f"{name} {unit}" for name, unit in spelled.items() if unit and name not in self.usual]
        bare = [name for name, unit in self.units.items() if not unit and "orientation" not in name]
        parts = [f"as the header states: {', '.join(said)}"] if said else []
        for firmware in dict.fromkeys(self.usual.values()):
            own = [
                f"{name} {spelled[name]}"
                for name, whose in self.usual.items()
                if whose == firmware and spelled.get(name)
            ]
            parts += [f"as logged by {firmware}: {', '.join(own)}"] if own else []
        parts += [f"taken as SI, as none is stated: {', '.join(bare)}"] if bare else []
        out = [f"Units {'; '.join(parts)}. Axes are taken as forward-left-up and east-north-up."] if parts else []
        if self.unknown:
            out.append(f"Columns whose names say no known quantity: {listed(self.unknown)}.")
        return out + list(dict.fromkeys(self.notes))
