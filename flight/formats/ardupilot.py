"""What ArduPilot's messages mean: topics in SI, FLU and ENU, in ROS types, made of its own (docs/formats.md).

Its body frame is forward-right-down, its world north-east-down; angles are in degrees, in the order yaw, pitch, roll.
The commands are shares of full authority and pulse widths, and the names of the topics say so.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.flight.formats.ned_frd import enu, flu, quat_flu_to_enu, quat_of_euler
from wrenchgap.flight.formats.standard_topics import Stamps, StandardTopic, are_pulses, cropped, cubic_at, values_at
from wrenchgap.flight.formats.table import Table

RPM = 2.0 * np.pi / 60.0
MOTOR_FUNCTIONS = {**{33 + i: i for i in range(8)}, **{82 + i: 8 + i for i in range(4)}}
"""Motor by the value of a SERVOn_FUNCTION."""
QUATERNION = ("Q1", "Q2", "Q3", "Q4")
ESTIMATORS = {"XK": ("XKF1", ("XKQ", "XKQ1")), "NK": ("NKF1", ("NKQ", "NKQ1")), "EKF": ("EKF1", ())}
"""Positions and attitudes of EKF3, EKF2 and the first one; the latter, and quaternions with a 1, are of firmware 3."""
OTHERS: tuple[tuple[str, tuple[str, ...]], ...] = (("AHR2", QUATERNION), ("ATT", ("Roll", "Pitch", "Yaw")))
"""Attitudes besides: of the backup estimator, and angles of the one in use."""
POSITION = ("PN", "PE", "PD")
VELOCITY = ("VN", "VE", "VD")


def derived(
    tables: Mapping[str, Table], parameters: Mapping[str, float | int] | None = None
) -> tuple[dict[str, Table], list[str]]:
    """Topics made of ArduPilot's messages in a log, by name, and what to say of them; nothing where there are none."""
    said = _Messages({name: t for name, t in tables.items() if t.type.startswith("ardupilot/")}, parameters or {})
    if not said.tables:
        return {}, []
    with np.errstate(invalid="ignore", over="ignore"):  # what is absurd is left out later, and counted
        made = [(source, table) for source, table in said.topics() if len(table) > 1]
    if not made:
        return {}, []
    listed = "; ".join(f"{table.topic} from {source}" for source, table in made)
    notes = [f"ArduPilot's messages in FRD and NED became, in FLU and ENU: {listed}.", *said.notes]
    return {table.topic: table for _, table in made}, notes


@dataclass
class _Messages:
    tables: Mapping[str, Table]
    parameters: Mapping[str, float | int]
    notes: list[str] = field(default_factory=list)

    def topics(self) -> Iterator[tuple[str, Table]]:
        yield from self._imus()
        yield from self._odometry()
        yield from self._reference()
        yield from self._commands()
        yield from self._speeds()
        for name in ("BAT", "CURR"):
            if (found := self._numbers(name, "Volt")) is not None and np.any(found[1] > 0.0):
                whole = found[0].columns["Volt"].dtype.kind in "iu"  # firmware 3.3 and before: hundredths of a volt
                yield name, self._made("battery", found[0]).battery(found[1][:, 0] * (0.01 if whole else 1.0))
                return

    def _numbers(self, topic: str, *names: str) -> tuple[Table, Array] | None:
        """A message's table and some of its fields (N, K), or None where it lacks one."""
        table = self.tables.get(topic)
        if table is None or any(
            name not in table.columns or table.columns[name].dtype.kind not in "iuf" for name in names
        ):
            return None
        return table, np.stack([np.asarray(table.columns[name], dtype=float) for name in names], axis=1)

    def _made(self, name: str, table: Table, stamps: Stamps | None = None) -> StandardTopic:
        return StandardTopic(f"/ardupilot/{name}", table.log_time_ns, table.log_time_ns if stamps is None else stamps)

    def _imus(self) -> Iterator[tuple[str, Table]]:
        """Each IMU; of old logs IMU2 and IMU3; and the two sensors by themselves where they are logged raw."""
        for place, topic in enumerate(("IMU", "IMU/1", "IMU/2", "IMU2", "IMU3")):
            gyro, acc = self._numbers(topic, "GyrX", "GyrY", "GyrZ"), self._numbers(topic, "AccX", "AccY", "AccZ")
            if gyro is not None and acc is not None:
                name = "imu" if place == 0 else f"imu/{topic}"
                yield topic, cropped(self._made(name, gyro[0]).imu(flu(gyro[1]), flu(acc[1])))
        for one, other in (("GYR", "ACC"), ("GYR1", "ACC1")):  # the latter of firmware 3 and 4.0
            rate, force = self._numbers(one, "GyrX", "GyrY", "GyrZ"), self._numbers(other, "AccX", "AccY", "AccZ")
            if rate is not None and force is not None:
                stamps = [_sampled(table) for table, _ in (rate, force)]
                specific = values_at(stamps[0], stamps[1], force[1])
                raw = self._made("imu/raw", rate[0], stamps[0]).imu(flu(rate[1]), flu(specific))
                yield f"{one} + {other}", cropped(raw)
                return

    def _estimator(self) -> tuple[str, tuple[tuple[str, tuple[str, ...]], ...]]:
        """Where positions are of the estimator in use (AHRS_EKF_TYPE; both are logged where both run), and attitudes.

        Quaternions of the same one first: two estimators need not agree.
        """
        in_use = int(self.parameters.get("AHRS_EKF_TYPE", 3))
        order = sorted(ESTIMATORS, key=lambda kind: kind != {2: "NK", 3: "XK"}.get(in_use))
        known = (kind for kind in order if self._numbers(ESTIMATORS[kind][0], *POSITION, *VELOCITY) is not None)
        place, own = ESTIMATORS[next(known, order[0])]
        return place, (*((name, QUATERNION) for name in own), *OTHERS)

    def _odometry(self) -> Iterator[tuple[str, Table]]:
        sources = (("odometry", *self._estimator()), ("odometry_truth", "SIM2", (("SIM", QUATERNION),)))
        for name, place, attitudes in sources:
            attitude = next((entry for entry in attitudes if self._numbers(*entry[:1], *entry[1]) is not None), None)
            if attitude is None or self._numbers(place, *POSITION, *VELOCITY) is None:
                continue
            table, quat = self._quaternions(*attitude)
            moved = self._numbers(place, *POSITION, *VELOCITY)
            assert moved is not None
            known, motion = moved[0].log_time_ns, moved[1]
            stamps = table.log_time_ns
            position_E = enu(cubic_at(stamps, known, motion[:, :3], motion[:, 3:]))
            velocity_E = enu(values_at(stamps, known, motion[:, 3:]))
            made = self._made(name, table).odometry(position_E, quat_flu_to_enu(quat), velocity_E)
            yield f"{attitude[0]} + {place}", cropped(made)

    def _quaternions(self, topic: str, names: tuple[str, ...]) -> tuple[Table, Array]:
        found = self._numbers(topic, *names)
        assert found is not None
        return found[0], found[1] if len(names) == 4 else quat_of_euler(*np.radians(found[1]).T)

    def _reference(self) -> Iterator[tuple[str, Table]]:
        """Desired attitude, and the position and velocity that the position controller wanted."""
        asked = self._numbers("ATT", "DesRoll", "DesPitch", "DesYaw")
        wanted = [self._numbers(f"PSC{axis}", f"TP{axis}", f"TV{axis}") for axis in "NED"]
        if asked is None or any(part is None for part in wanted):
            return
        stamps = asked[0].log_time_ns
        parts = [values_at(stamps, part[0].log_time_ns, part[1]) for part in wanted if part is not None]
        place, velocity = (np.stack([part[:, k] for part in parts], axis=1) for k in (0, 1))
        quat = quat_flu_to_enu(quat_of_euler(*np.radians(asked[1]).T))
        if np.isfinite(place).all(axis=1).any():
            made = self._made("reference", asked[0]).odometry(enu(place), quat, enu(velocity))
            yield "ATT + PSCN + PSCE + PSCD", cropped(made)

    def _commands(self) -> Iterator[tuple[str, Table]]:
        """What the rate controller asked of the mixer, and the pulses that the motors were sent."""
        asked = self._numbers("RATE", "ROut", "POut", "YOut", "AOut")
        if asked is not None:
            table, values = asked
            force = np.zeros((len(table), 3))
            force[:, 2] = values[:, 3]
            made = self._made("wrench_command_normalised", table)
            yield "RATE", made.wrench(force, flu(values[:, :3]))
            if np.nanmax(values[:, 3], initial=0.0) <= 0.01:
                self.notes.append("RATE: never asked for thrust: this log holds no powered flight.")
        pulses = self.tables.get("RCOU")
        channels = [] if pulses is None else self._motor_channels(pulses)
        found = self._numbers("RCOU", *channels) if channels else None
        if found is None:
            return
        sent = np.where(are_pulses(found[1]), found[1], np.nan)
        if np.isfinite(sent).all(axis=1).mean() > 0.5:  # disarmed, or behind a safety switch, there is no pulse: 0
            yield "RCOU", cropped(self._made("outputs_pwm", found[0]).actuators(sent, unit="pwm"))

    def _motor_channels(self, table: Table) -> list[str]:
        """Channels in the order of the motors, by parameters, else those that carry pulses and change."""
        every = ((i, f"{head}{i}") for i in range(1, 33) for head in ("C", "Ch"))  # Ch up to firmware 3.4
        channels = {name: i for i, name in every if name in table.columns}
        functions = {name: int(self.parameters.get(f"SERVO{i}_FUNCTION", 0)) for name, i in channels.items()}
        motors = {MOTOR_FUNCTIONS[f]: name for name, f in functions.items() if f in MOTOR_FUNCTIONS}
        if motors:
            return [motors[number] for number in sorted(motors)]
        moving = [name for name in channels if _pulses(table.columns[name])]
        if moving:
            self.notes.append(f"RCOU: no SERVOn_FUNCTION in the log; taken as motors, in order: {', '.join(moving)}.")
        return moving

    def _speeds(self) -> Iterator[tuple[str, Table]]:
        """Measured speeds of all motors at the stamps of the first; of firmware 3 and 4.0 from ESC1, ESC2, ..."""
        named = (["ESC", *(f"ESC/{i}" for i in range(1, 12))], [f"ESC{i}" for i in range(1, 9)])
        every = [self._numbers(topic, "RPM") for topics in named for topic in topics]
        found = [part for part in every if part is not None and np.any(part[1])]
        if found:
            stamps = found[0][0].log_time_ns
            speeds = [found[0][1], *(values_at(stamps, table.log_time_ns, rpm) for table, rpm in found[1:])]
            yield "ESC", cropped(self._made("esc_measured", found[0][0]).actuators(np.hstack(speeds) * RPM))


def _pulses(values: NDArray[Any], mostly: float = 0.5) -> bool:
    """Whether a channel carries pulses that change, but for times without any; for this share of the log, at least."""
    sent = values[values > 0]
    return bool(len(sent) > mostly * len(values) and are_pulses(sent, highest=np.inf).all() and np.ptp(sent) > 0)


def _sampled(table: Table) -> Stamps:
    sample = table.columns.get("SampleUS")
    usable = sample is not None and sample.dtype.kind in "iu" and np.all(sample > 0)
    return table.log_time_ns if sample is None or not usable else sample.astype(np.int64) * 1000
