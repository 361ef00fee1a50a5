"""What ArduPilot's messages mean: topics in SI, FLU and ENU, in ROS types, made of its own (docs/formats.md).

Its body frame is forward-right-down, its world north-east-down; angles are in degrees, in the order yaw, pitch, roll.
The commands are shares of full authority and pulse widths, and the names of the topics say so.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import RPM, Stamps
from wrenchgap.flight.formats.dataflash import kind_of
from wrenchgap.flight.formats.ned_frd import enu, flu, quat_flu_to_enu, quat_of_euler
from wrenchgap.flight.formats.reader import Table
from wrenchgap.flight.formats.standard_topics import Made, Messages, are_pulses, cropped, cubic_at, made_of, values_at

MOTOR_FUNCTIONS = {**{33 + i: i for i in range(8)}, **{82 + i: 8 + i for i in range(4)}}
"""Motor by the value of a SERVOn_FUNCTION."""
GYROSCOPE, ACCELEROMETER = ("GyrX", "GyrY", "GyrZ"), ("AccX", "AccY", "AccZ")
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
    own = {name: table for name, table in tables.items() if table.type.startswith("ardupilot/")}
    makers = (imus, odometries, references, commands, speeds, batteries)
    return made_of(Messages("/ardupilot", own, parameters or {}), makers, "ArduPilot's messages")


def imus(said: Messages) -> Made:
    """Each IMU; of old logs IMU2 and IMU3; and the two sensors by themselves where they are logged raw."""
    for place, topic in enumerate(("IMU", "IMU/1", "IMU/2", "IMU2", "IMU3")):
        if found := said.read(topic, GYROSCOPE, ACCELEROMETER):
            table, omega, force = found
            name = "imu" if place == 0 else f"imu/{topic}"
            yield topic, cropped(said.made(name, table).imu(flu(omega), flu(force)))
    for one, other in (("GYR", "ACC"), ("GYR1", "ACC1")):  # the latter of firmware 3 and 4.0
        rate, force = said.read(one, GYROSCOPE), said.read(other, ACCELEROMETER)
        if rate and force:
            stamps = _sampled(rate[0])
            specific = values_at(stamps, _sampled(force[0]), force[1])
            raw = said.made("imu/raw", rate[0], stamps).imu(flu(rate[1]), flu(specific))
            yield f"{one} + {other}", cropped(raw)
            return


def odometries(said: Messages) -> Made:
    """The estimator's, and the simulator's truth."""
    sources = (("odometry", *_estimator(said)), ("odometry_truth", "SIM2", (("SIM", QUATERNION),)))
    for name, place, attitudes in sources:
        attitude = next((found for topic, names in attitudes if (found := said.read(topic, names))), None)
        position = said.read(place, POSITION, VELOCITY)
        if attitude is None or position is None:
            continue
        table, values = attitude
        stamps, known = table.log_time_ns, position[0].log_time_ns
        quat = values if values.shape[1] == 4 else quat_of_euler(*np.radians(values).T)
        position_E = enu(cubic_at(stamps, known, *position[1:]))
        velocity_E = enu(values_at(stamps, known, position[2]))
        made = said.made(name, table).odometry(position_E, quat_flu_to_enu(quat), velocity_E)
        yield f"{table.topic} + {place}", cropped(made)


def _estimator(said: Messages) -> tuple[str, tuple[tuple[str, tuple[str, ...]], ...]]:
    """Where positions are of the estimator in use (AHRS_EKF_TYPE; both are logged where both run), and attitudes.

    Quaternions of the same one first: two estimators need not agree.
    """
    in_use = int(said.parameters.get("AHRS_EKF_TYPE", 3))
    order = sorted(ESTIMATORS, key=lambda kind: kind != {2: "NK", 3: "XK"}.get(in_use))
    known = (kind for kind in order if said.read(ESTIMATORS[kind][0], POSITION, VELOCITY))
    place, own = ESTIMATORS[next(known, order[0])]
    return place, (*((name, QUATERNION) for name in own), *OTHERS)


def references(said: Messages) -> Made:
    """Desired attitude, and the position and velocity that the position controller wanted."""
    asked = said.read("ATT", ("DesRoll", "DesPitch", "DesYaw"))
    wanted = [said.read(f"PSC{axis}", (f"TP{axis}", f"TV{axis}")) for axis in "NED"]
    if asked is None or any(part is None for part in wanted):
        return
    stamps = asked[0].log_time_ns
    parts = [values_at(stamps, part[0].log_time_ns, part[1]) for part in wanted if part is not None]
    place, velocity = (np.stack([part[:, k] for part in parts], axis=1) for k in (0, 1))
    quat = quat_flu_to_enu(quat_of_euler(*np.radians(asked[1]).T))
    if np.isfinite(place).all(axis=1).any():
        made = said.made("reference", asked[0]).odometry(enu(place), quat, enu(velocity))
        yield "ATT + PSCN + PSCE + PSCD", cropped(made)


def commands(said: Messages) -> Made:
    """What the rate controller asked of the mixer, and the pulses that the motors were sent."""
    if asked := said.read("RATE", ("ROut", "POut", "YOut", "AOut")):
        table, values = asked
        force = np.zeros((len(table), 3))
        force[:, 2] = values[:, 3]
        yield "RATE", said.made("wrench_command_normalised", table).wrench(force, flu(values[:, :3]))
        if np.nanmax(values[:, 3], initial=0.0) <= 0.01:
            said.notes.append("RATE: never asked for thrust: this log holds no powered flight.")
    pulses = said.read("RCOU")
    channels = _motor_channels(said, pulses[0]) if pulses else []
    found = said.read("RCOU", tuple(channels)) if channels else None
    if found:
        sent = np.where(are_pulses(found[1]), found[1], np.nan)
        if np.isfinite(sent).all(axis=1).mean() > 0.5:  # disarmed, or behind a safety switch, there is no pulse: 0
            yield "RCOU", cropped(said.made("outputs_pwm", found[0]).actuators(sent, unit="pwm"))


def _motor_channels(said: Messages, table: Table) -> list[str]:
    """Channels in the order of the motors, by parameters, else those that carry pulses and change."""
    every = ((i, f"{head}{i}") for i in range(1, 33) for head in ("C", "Ch"))  # Ch up to firmware 3.4
    channels = {name: i for i, name in every if name in table.columns}
    functions = {name: int(said.parameters.get(f"SERVO{i}_FUNCTION", 0)) for name, i in channels.items()}
    motors = {MOTOR_FUNCTIONS[f]: name for name, f in functions.items() if f in MOTOR_FUNCTIONS}
    if motors:
        return [motors[number] for number in sorted(motors)]
    moving = [name for name in channels if _pulses(table.columns[name])]
    if moving:
        said.notes.append(f"RCOU: no SERVOn_FUNCTION in the log; taken as motors, in order: {', '.join(moving)}.")
    return moving


def speeds(said: Messages) -> Made:
    """Measured speeds of all motors at the stamps of the first; of firmware 3 and 4.0 from ESC1, ESC2, ..."""
    names = ("ESC", *(f"ESC/{i}" for i in range(1, 12)), *(f"ESC{i}" for i in range(1, 9)))
    found = [part for name in names if (part := said.read(name, "RPM")) and np.any(part[1])]
    if found:
        first = found[0][0]
        every = [found[0][1], *(values_at(first.log_time_ns, table.log_time_ns, rpm) for table, rpm in found[1:])]
        yield "ESC", cropped(said.made("esc_measured", first).actuators(np.hstack(every) * RPM))


def batteries(said: Messages) -> Made:
    """The first that has a voltage."""
    for name in ("BAT", "CURR"):
        found = said.read(name, "Volt")
        if found and np.any(found[1] > 0.0):
            whole = kind_of(found[0].columns["Volt"]) in "iu"  # firmware 3.3 and before: hundredths of a volt
            yield name, said.made("battery", found[0]).battery(found[1][:, 0] * (0.01 if whole else 1.0))
            return


def _pulses(values: NDArray[Any], mostly: float = 0.5) -> bool:
    """Whether a channel carries pulses that change, but for times without any; for this share of the log, at least."""
    sent = values[values > 0]
    return bool(len(sent) > mostly * len(values) and are_pulses(sent, highest=np.inf).all() and np.ptp(sent) > 0)


def _sampled(table: Table) -> Stamps:
    sample = table.columns.get("SampleUS")
    usable = sample is not None and kind_of(sample) in "iu" and np.all(sample > 0)
    return table.log_time_ns if sample is None or not usable else sample.astype(np.int64) * 1000
