"""What PX4's messages mean: topics in SI, FLU and ENU, and in the types that every log may have, made of its own.

The same for a ULog and for px4_msgs in a bag. PX4's own topics stay as they are, in its frames; what is made of them
is named `/px4/imu`, `/px4/odometry`, ... and plays the roles. Where there is a choice the first is named plainly and
the others after their source, to be chosen with --topic.

Times are microseconds since the autopilot's start; `timestamp_sample` is when the sensor was read, `timestamp` when the
message was sent.
"""

import re
from collections.abc import Mapping

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.check import UNPOWERED
from wrenchgap.flight.flight import RPM, Array, Mask, Stamps
from wrenchgap.flight.formats.ned_frd import enu, flu, quat_flu_to_enu, quat_of_euler
from wrenchgap.flight.formats.px4_allocation import driven, motor_commands_of_setpoints
from wrenchgap.flight.formats.reader import Table
from wrenchgap.flight.formats.standard_topics import (
    Made,
    Messages,
    are_pulses,
    clocked,
    cropped,
    cubic_at,
    made_of,
    numbers,
    values_at,
)

_LISTED = """
    sensor_combined vehicle_imu vehicle_acceleration vehicle_angular_velocity sensor_accel sensor_gyro
    vehicle_attitude vehicle_local_position vehicle_odometry battery_status esc_status
    vehicle_attitude_groundtruth vehicle_local_position_groundtruth vehicle_angular_velocity_groundtruth
    vehicle_attitude_setpoint vehicle_local_position_setpoint trajectory_setpoint vehicle_rates_setpoint
    vehicle_thrust_setpoint vehicle_torque_setpoint actuator_controls_0 actuator_motors actuator_outputs actuator_armed
"""
NAMES = frozenset(_LISTED.split())
"""Messages that something here is made of."""
FIRST_MOTOR = 101
"""Of PX4's output functions, that of motor 1."""
ROTORS_BY_TYPE = {2: 4, 13: 6, 14: 8, 15: 3}
"""Rotors by MAV_TYPE, of firmware that has no functions of outputs."""


def imus(said: Messages) -> Made:
    """Every IMU of a vehicle."""
    if found := said.read("sensor_combined", "gyro_rad", "accelerometer_m_s2"):
        yield "sensor_combined", _combined(said, *found)
    for gyroscope, accelerometer in (
        ("vehicle_angular_velocity", "vehicle_acceleration"),
        ("sensor_gyro", "sensor_accel"),
    ):
        rate, force = (
            said.read(name, "xyz") or said.read(name, ("x", "y", "z")) for name in (gyroscope, accelerometer)
        )
        if rate and force:
            yield f"{gyroscope} + {accelerometer}", _paired(said, f"imu/{gyroscope}", *rate, *force)
    for instance, name in said.instances("vehicle_imu"):
        if found := said.read(name, "delta_angle", "delta_velocity", "delta_angle_dt", "delta_velocity_dt"):
            yield found[0].topic, _integrated(said, f"imu/vehicle_imu/{instance}", *found)


def _imu(said: Messages, name: str, table: Table, stamps: Stamps, omega: Array, force: Array) -> Table:
    return cropped(said.made(name, table, stamps).imu(flu(omega), flu(force)))


def _combined(said: Messages, table: Table, omega: Array, force: Array) -> Table:
    """Means over the last interval of integration, so they belong to its middle; the accelerometer may be elsewhere."""
    stamps = sent(table)
    relative = table.columns.get("accelerometer_timestamp_relative")
    if relative is not None and np.any(relative):
        known = np.abs(relative.astype(np.int64)) < 1_000_000  # us; the largest integer says that there is none
        elsewhere = np.where(known, relative.astype(np.int64), 0) * 1000
        force = values_at(stamps, stamps + elsewhere, np.where(known[:, None], force, np.nan))
    return _imu(said, "imu", table, stamps - _half(table, "gyro_integral_dt"), omega, force)


def _half(table: Table, name: str) -> Stamps:
    """Half of an integration interval [ns], which is in microseconds, or in seconds in old firmware."""
    if name not in table.columns:
        return np.zeros(len(table), dtype=np.int64)
    interval = np.asarray(table.columns[name], dtype=float)
    seconds = interval if np.nanmedian(interval) < 1.0 else interval * 1e-6
    return np.round(0.5e9 * np.clip(np.nan_to_num(seconds), 0.0, 0.1)).astype(np.int64)


def _paired(said: Messages, name: str, rate: Table, omega: Array, force: Table, specific: Array) -> Table:
    """Gyroscope and accelerometer of two topics, at the stamps of the slower one."""
    slow, fast = sampled(rate), sampled(force)
    if len(force) < len(rate):
        return _imu(said, name, force, fast, values_at(fast, slow, omega), specific)
    return _imu(said, name, rate, slow, omega, values_at(slow, fast, specific))


def _integrated(said: Messages, name: str, table: Table, turned: Array, gained: Array, dt: Array, dv: Array) -> Table:
    """Increments of angle and velocity over intervals `dt` and `dv` [us] that end at the stamp."""
    with np.errstate(divide="ignore", invalid="ignore"):
        omega, force = 1e6 * turned / dt, 1e6 * gained / dv
    return _imu(said, name, table, sampled(table) - _half(table, "delta_angle_dt"), omega, force)


def odometries(said: Messages) -> Made:
    """Every odometry of a vehicle: the estimator's, the simulator's truth, and the one sent by radio."""
    for suffix, name in (("", "odometry"), ("_groundtruth", "odometry_truth")):
        attitude = said.read(f"vehicle_attitude{suffix}", "q")
        position = said.read(f"vehicle_local_position{suffix}", ("x", "y", "z"), ("vx", "vy", "vz"))
        if attitude and position and (made := _odometry(said, name, *attitude, *position)):
            yield f"{attitude[0].topic} + {position[0].topic}", made
    new, old = ("position", "velocity"), (("x", "y", "z"), ("vx", "vy", "vz"))
    found = said.read("vehicle_odometry", "q", *new) or said.read("vehicle_odometry", "q", *old)
    if found:
        yield found[0].topic, _whole(said, *found)


def _odometry(said: Messages, name: str, attitude: Table, quat: Array, position: Table, *motion: Array) -> Table | None:
    """Attitude at its own stamps, with position (cubic, with its velocity) and velocity in between."""
    valid = true(position, "xy_valid", "z_valid")
    if not valid.any():
        said.notes.append(
            f"{position.topic}: the estimator never knew its position (xy_valid or z_valid is 0): no odometry."
        )
        return None
    valid = valid & true(position, "v_xy_valid", "v_z_valid")
    place, velocity = (np.where(valid[:, None], v, np.nan) for v in _without_resets(said, position, *motion))
    stamps, known = sampled(attitude), sampled(position)
    position_E = enu(cubic_at(stamps, known, place, velocity))
    velocity_E = enu(values_at(stamps, known, velocity))
    made = said.made(name, attitude, stamps)
    return cropped(made.odometry(position_E, quat_flu_to_enu(quat), velocity_E))  # body rates are the IMU's business


def _without_resets(said: Messages, table: Table, place: Array, velocity: Array) -> tuple[Array, Array]:
    """Jumps that the estimator says it made, taken back: the vehicle did not jump."""
    out, count = (place.copy(), velocity.copy()), 0
    horizontal, vertical = slice(0, 2), slice(2, 3)
    groups = ((0, horizontal, "xy"), (0, vertical, "z"), (1, horizontal, "vxy"), (1, vertical, "vz"))
    for which, axes, name in groups:
        jumps, numbered = numbers(table, f"delta_{name}"), table.columns.get(f"{name}_reset_counter")
        if jumps is None or numbered is None:
            continue
        happened = np.concatenate(([False], np.diff(numbered.astype(np.int64)) != 0))
        count += int(happened.sum())
        out[which][:, axes] -= np.cumsum(np.where(happened[:, None], np.nan_to_num(jumps), 0.0), axis=0)
    if count:
        said.notes.append(f"{table.topic}: {count} jump(s) of the estimator (reset counters) are taken back.")
    return out


def _whole(said: Messages, table: Table, quat: Array, place: Array, velocity: Array) -> Table:
    """Message vehicle_odometry: pose, velocity in one of three frames, body rates."""
    rates = numbers(table, "angular_velocity")
    rates = numbers(table, "rollspeed", "pitchspeed", "yawspeed") if rates is None else rates
    quat_EB = quat_flu_to_enu(quat)
    in_body = np.asarray(table.columns.get("velocity_frame", np.zeros(1)), dtype=float)[0] == 3.0
    velocity_E = so3.rotate(quat_EB, flu(velocity)) if in_body else enu(velocity)
    made = said.made("odometry/vehicle_odometry", table, sampled(table))
    return cropped(made.odometry(enu(place), quat_EB, velocity_E, None if rates is None else flu(rates)))


def references(said: Messages) -> Made:
    """The attitude and position that were asked for, and the rates where they are."""
    asked = said.read("vehicle_attitude_setpoint")
    spelt = ("position", "velocity"), ("x", "y", "z", "vx", "vy", "vz")
    places = (said.read(n, s) for n in ("vehicle_local_position_setpoint", "trajectory_setpoint") for s in spelt)
    position = next((found for found in places if found), None)
    quat = _asked_attitude(asked[0]) if asked else None
    if asked is None or position is None or quat is None:
        return
    stamps = sent(asked[0])
    found = values_at(stamps, sent(position[0]), position[1])
    if np.isfinite(found).all(axis=1).any():
        rates = said.read("vehicle_rates_setpoint", ("roll", "pitch", "yaw"))
        omega = flu(values_at(stamps, sent(rates[0]), rates[1])) if rates else None
        made = said.made("reference", asked[0], stamps)
        whole = made.odometry(enu(found[:, :3]), quat_flu_to_enu(quat), enu(found[:, 3:]), omega)
        yield f"{asked[0].topic} + {position[0].topic}", cropped(whole)


def _asked_attitude(table: Table) -> Array | None:
    """Quaternions FRD to NED; of old firmware, which fills them in at times only, from the angles."""
    quat, angles = numbers(table, "q_d"), numbers(table, "roll_body", "pitch_body", "yaw_body")
    if angles is None:
        return quat
    valid = true(table, "q_d_valid")
    if quat is not None and valid.all():
        return quat
    of_angles = quat_of_euler(*angles.T)
    return of_angles if quat is None else np.where(valid[:, None], quat, of_angles)


def wrenches(said: Messages) -> Made:
    """Thrust and torque setpoints: shares of the vehicle's authority, about and along the axes of FLU."""
    thrust, torque = said.read("vehicle_thrust_setpoint", "xyz"), said.read("vehicle_torque_setpoint", "xyz")
    old = said.read("actuator_controls_0", "control")
    name = "wrench_command_normalised"
    if thrust and torque:
        stamps = sent(thrust[0])
        moment = values_at(stamps, sent(torque[0]), torque[1])
        made = said.made(name, thrust[0], stamps).wrench(flu(thrust[1]), flu(moment))
        yield f"{thrust[0].topic} + {torque[0].topic}", cropped(made)
    elif old and old[1].shape[1] >= 4:
        table, control = old
        force = np.zeros((len(table), 3))
        force[:, 2] = control[:, 3]  # old firmware gives the thrust as positive, upwards
        yield table.topic, said.made(name, table, sent(table)).wrench(force, flu(control[:, :3]))


def actuators(said: Messages) -> Made:
    """Motor commands, outputs in pulse widths, and the speeds that the controllers of the motors measured."""
    motors = said.read("actuator_motors", "control")
    if motors and (used := driven(motors[1], said.parameters)).any():
        (table, control), name = motors, "motor_command_normalised"
        if found := motor_commands_of_setpoints(said, table, control[:, used]):
            asked, command = found
            yield asked.topic, said.made(name, asked, sent(asked)).actuators(command, unit="normalised")
            name = f"{name}/actuator_motors"
        stopped = np.nan_to_num(control[:, used])  # NaN is PX4's word for a motor that is disarmed
        yield table.topic, said.made(name, table, sent(table)).actuators(stopped, unit="normalised")
    for instance, name in said.instances("actuator_outputs"):
        outputs = said.read(name, "output")
        pulses = _pulses(outputs[1], said.parameters) if outputs else None
        if outputs and pulses is not None:
            made = said.made(_numbered("outputs_pwm", instance), outputs[0], sent(outputs[0]))
            yield outputs[0].topic, made.actuators(pulses)
    reported = said.read("esc_status")
    speeds = motor_speeds(reported[0]) if reported else None
    if reported and speeds is not None:
        yield reported[0].topic, said.made("esc_measured", reported[0], sent(reported[0])).actuators(speeds)


def _pulses(output: Array, parameters: Mapping[str, float | int]) -> Array | None:
    """Pulse widths (N, R) [us] in the order of the motors; None for outputs (N, K) that are no pulses."""
    functions = [parameters.get(f"PWM_MAIN_FUNC{i + 1}", 0) for i in range(output.shape[1])]
    motors = {int(f) - FIRST_MOTOR: i for i, f in enumerate(functions) if FIRST_MOTOR <= f < FIRST_MOTOR + 12}
    if motors:
        columns = [motors[number] for number in sorted(motors)]
    else:
        count = ROTORS_BY_TYPE.get(int(parameters.get("MAV_TYPE", 0)), 0)
        columns = list(range(min(count, output.shape[1]))) or np.flatnonzero(np.ptp(output, axis=0) > 0.0).tolist()
    pulses = output[:, columns]
    return pulses if pulses.size and are_pulses(pulses).all() else None


def motor_speeds(table: Table) -> Array | None:
    """Speeds (N, R) [rad/s] in the order of the motors; controllers without a motor are left out."""
    motors: dict[int, Array] = {}
    for i in range(12):
        rpm = table.columns.get(f"esc.{i}.esc_rpm")
        if rpm is None:
            continue
        function = table.columns.get(f"esc.{i}.actuator_function")
        number = int(np.median(function)) - FIRST_MOTOR if function is not None and np.any(function) else i
        if 0 <= number < 12 and np.any(rpm):
            motors[number] = np.asarray(rpm, dtype=float) * RPM
    return np.stack([motors[number] for number in sorted(motors)], axis=1) if motors else None


def batteries(said: Messages) -> Made:
    """The voltage of each battery."""
    for instance, name in said.instances("battery_status"):
        found = said.read(name, "voltage_v")
        if found and np.any(found[1] > 0.0):
            made = said.made(_numbered("battery", instance), found[0], sampled(found[0]))
            yield found[0].topic, made.battery(found[1][:, 0])


def never_armed(said: Messages) -> str | None:
    """A sentence where no command ever asked for thrust: then the log holds no flight."""
    for name, values in (
        ("actuator_armed", "armed"),
        ("actuator_controls_0", "control"),
        ("vehicle_thrust_setpoint", "xyz"),
    ):
        if found := said.read(name, values):
            table, asked = found
            asked = asked[:, 3] if name == "actuator_controls_0" and asked.shape[1] > 3 else asked
            if np.any(np.abs(np.nan_to_num(asked)) > 0.01):
                return None
            return f"{table.topic}: the motors were never armed, or never asked for thrust: {UNPOWERED}"
    return None


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


def true(table: Table, *names: str) -> Mask:
    """Where (N,) none of the flags that the messages have is down."""
    found = [table.columns[name].astype(float).reshape(len(table), -1) for name in names if name in table.columns]
    return np.asarray((np.hstack(found) > 0).all(axis=1)) if found else np.ones(len(table), dtype=bool)


def derived(
    tables: Mapping[str, Table], parameters: Mapping[str, float | int] | None = None
) -> tuple[dict[str, Table], list[str]]:
    """Topics made of the PX4 messages in a log, by name, and what to say of them; nothing where there are none."""
    vehicles, out, notes = dict[str, dict[str, Table]](), dict[str, Table](), list[str]()
    for topic, table in tables.items():
        if place := _place(topic, table.type):
            if (timed := clocked(table, "timestamp")) is not None:
                vehicles.setdefault(place[0], {}).setdefault(_numbered(*place[1:]), timed)
            elif table.columns:
                notes.append(f"{topic}: its messages have no number called timestamp, as PX4's have: left out.")
    for space, own in sorted(vehicles.items()):
        said = Messages(f"{space}/px4", own, parameters or {})
        made, words = made_of(said, (imus, odometries, references, wrenches, actuators, batteries), "PX4's topics")
        unarmed = never_armed(said) if made else None
        out, notes = out | made, notes + words + ([unarmed] if unarmed else [])
    return out, notes


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


def _numbered(name: str, instance: int) -> str:
    return f"{name}/{instance}" if instance else name
