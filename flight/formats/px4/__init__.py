"""What PX4's messages mean: topics in SI, FLU and ENU, and in the types that every log may have, made of its own.

The same for a ULog and for px4_msgs in a bag. PX4's own topics stay as they are, in its frames; what is made of them
is named `/px4/imu`, `/px4/odometry`, ... and plays the roles. Where there is a choice the first is named plainly and
the others after their source, to be chosen with --topic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.check import UNPOWERED
from wrenchgap.flight.flight import Array
from wrenchgap.flight.formats.ned_frd import enu, flu, quat_flu_to_enu, quat_of_euler
from wrenchgap.flight.formats.px4.messages import Messages, by_vehicle, numbers, sampled, sent, true, wanted
from wrenchgap.flight.formats.standard_topics import Stamps, StandardTopic, are_pulses, cropped, cubic_at, values_at
from wrenchgap.flight.formats.table import Table


def imus(said: Messages) -> Iterator[tuple[str, Table]]:
    """Every IMU of a vehicle, with what it is made of."""
    if (table := said.get("sensor_combined")) is not None and (made := _combined(said, table)) is not None:
        yield "sensor_combined", made
    for gyroscope, accelerometer in (
        ("vehicle_angular_velocity", "vehicle_acceleration"),
        ("sensor_gyro", "sensor_accel"),
    ):
        rate, force = said.get(gyroscope), said.get(accelerometer)
        if rate is not None and force is not None and (made := _paired(said, rate, force, gyroscope)) is not None:
            yield f"{gyroscope} + {accelerometer}", made
    for instance, table in said.several("vehicle_imu"):
        if (made := _integrated(said, table, instance)) is not None:
            yield table.topic, made


def odometries(said: Messages) -> Iterator[tuple[str, Table]]:
    """Every odometry of a vehicle: the estimator's, the simulator's truth, and the one sent by radio."""
    for suffix, name in (("", "odometry"), ("_groundtruth", "odometry_truth")):
        attitude, position = said.get(f"vehicle_attitude{suffix}"), said.get(f"vehicle_local_position{suffix}")
        if attitude is not None and position is not None and (made := _odometry(said, attitude, position, name)):
            yield f"{attitude.topic} + {position.topic}", made
    if (table := said.get("vehicle_odometry")) is not None and (made := _whole(said, table)) is not None:
        yield table.topic, made


def references(said: Messages) -> Iterator[tuple[str, Table]]:
    """The attitude and position that were asked for, and the acceleration where it is."""
    attitude = said.get("vehicle_attitude_setpoint")
    position = said.get("vehicle_local_position_setpoint") or said.get("trajectory_setpoint")
    if attitude is None or position is None:
        return
    quat, place = _asked_attitude(attitude), _asked_position(position)
    if quat is None or place is None:
        return
    stamps = sent(attitude)
    found = values_at(stamps, sent(position), place)
    if np.isfinite(found).all(axis=1).any():
        to_be = StandardTopic(said.topic("reference"), attitude.log_time_ns, stamps)
        made = to_be.odometry(enu(found[:, :3]), quat_flu_to_enu(quat), enu(found[:, 3:]), _rates(said, stamps))
        yield f"{attitude.topic} + {position.topic}", cropped(made)


def _imu(topic: str, table: Table, stamps: Stamps, omega: Array, force: Array) -> Table:
    return cropped(StandardTopic(topic, table.log_time_ns, stamps).imu(flu(omega), flu(force)))


def _combined(said: Messages, table: Table) -> Table | None:
    """Means over the last interval of integration, so they belong to its middle; the accelerometer may be elsewhere."""
    omega, force = numbers(table, "gyro_rad"), numbers(table, "accelerometer_m_s2")
    if omega is None or force is None:
        return None
    stamps = sent(table)
    relative = table.columns.get("accelerometer_timestamp_relative")
    if relative is not None and np.any(relative):
        known = np.abs(relative.astype(np.int64)) < 1_000_000  # us; the largest integer says that there is none
        elsewhere = np.where(known, relative.astype(np.int64), 0) * 1000
        force = values_at(stamps, stamps + elsewhere, np.where(known[:, None], force, np.nan))
    return _imu(said.topic("imu"), table, stamps - _half(table, "gyro_integral_dt"), omega, force)


def _half(table: Table, name: str) -> Stamps:
    """Half of an integration interval [ns], which is in microseconds, or in seconds in old firmware."""
    if name not in table.columns:
        return np.zeros(len(table), dtype=np.int64)
    interval = np.asarray(table.columns[name], dtype=float)
    seconds = interval if np.nanmedian(interval) < 1.0 else interval * 1e-6
    return np.round(0.5e9 * np.clip(np.nan_to_num(seconds), 0.0, 0.1)).astype(np.int64)


def _paired(said: Messages, rate: Table, force: Table, name: str) -> Table | None:
    """Gyroscope and accelerometer of two topics, at the stamps of the slower one."""
    fields = ("xyz",) if "xyz" in rate.columns else ("x", "y", "z")
    omega, specific = numbers(rate, *fields), numbers(force, *fields)
    if omega is None or specific is None:
        return None
    topic = said.topic(f"imu/{name}")
    if len(force) < len(rate):
        return _imu(topic, force, sampled(force), values_at(sampled(force), sampled(rate), omega), specific)
    return _imu(topic, rate, sampled(rate), omega, values_at(sampled(rate), sampled(force), specific))


def _integrated(said: Messages, table: Table, instance: int) -> Table | None:
    """Increments of angle and velocity over an interval that ends at the stamp."""
    turned, gained = numbers(table, "delta_angle"), numbers(table, "delta_velocity")
    first, second = numbers(table, "delta_angle_dt"), numbers(table, "delta_velocity_dt")  # us
    if turned is None or gained is None or first is None or second is None:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        omega, force = 1e6 * turned / first, 1e6 * gained / second
    stamps = sampled(table) - _half(table, "delta_angle_dt")
    return _imu(said.topic(f"imu/vehicle_imu/{instance}"), table, stamps, omega, force)


def _odometry(said: Messages, attitude: Table, position: Table, name: str) -> Table | None:
    """Attitude at its own stamps, with position (cubic, with its velocity) and velocity in between."""
    quat, place = numbers(attitude, "q"), numbers(position, "x", "y", "z")
    velocity = numbers(position, "vx", "vy", "vz")
    if quat is None or place is None or velocity is None:
        return None
    valid = true(position, "xy_valid", "z_valid")
    if not valid.any():
        said.notes.append(
            f"{position.topic}: the estimator never knew its position (xy_valid or z_valid is 0): no odometry."
        )
        return None
    place, velocity = _without_resets(said, position, place, velocity)
    valid = valid & true(position, "v_xy_valid", "v_z_valid")
    place = np.where(valid[:, None], place, np.nan)
    stamps, known = sampled(attitude), sampled(position)
    position_E = enu(cubic_at(stamps, known, place, velocity))
    velocity_E = enu(values_at(stamps, known, np.where(valid[:, None], velocity, np.nan)))
    made = StandardTopic(said.topic(name), attitude.log_time_ns, stamps)
    return cropped(made.odometry(position_E, quat_flu_to_enu(quat), velocity_E))  # body rates are the IMU's business


def _without_resets(said: Messages, table: Table, place: Array, velocity: Array) -> tuple[Array, Array]:
    """Jumps that the estimator says it made, taken back: the vehicle did not jump."""
    out, count = [place.copy(), velocity.copy()], 0
    groups = (
        (0, slice(0, 2), "delta_xy", "xy"),
        (0, slice(2, 3), "delta_z", "z"),
        (1, slice(0, 2), "delta_vxy", "vxy"),
        (1, slice(2, 3), "delta_vz", "vz"),
    )
    for which, axes, delta, counter in groups:
        jumps, numbered = numbers(table, delta), table.columns.get(f"{counter}_reset_counter")
        if jumps is None or numbered is None:
            continue
        happened = np.concatenate(([False], np.diff(numbered.astype(np.int64)) != 0))
        count += int(happened.sum())
        out[which][:, axes] -= np.cumsum(np.where(happened[:, None], np.nan_to_num(jumps), 0.0), axis=0)
    if count:
        said.notes.append(f"{table.topic}: {count} jump(s) of the estimator (reset counters) are taken back.")
    return out[0], out[1]


def _whole(said: Messages, table: Table) -> Table | None:
    """Message vehicle_odometry: pose, velocity in one of three frames, body rates."""
    old = "position" not in table.columns
    place = numbers(table, *(("x", "y", "z") if old else ("position",)))
    velocity = numbers(table, *(("vx", "vy", "vz") if old else ("velocity",)))
    rates = numbers(table, *(("rollspeed", "pitchspeed", "yawspeed") if old else ("angular_velocity",)))
    quat, stamps = numbers(table, "q"), sampled(table)
    if place is None or velocity is None or quat is None:
        return None
    quat_EB = quat_flu_to_enu(quat)
    in_body = np.asarray(table.columns.get("velocity_frame", np.zeros(1)), dtype=float)[0] == 3.0
    velocity_E = so3.rotate(quat_EB, flu(velocity)) if in_body else enu(velocity)
    made = StandardTopic(said.topic("odometry/vehicle_odometry"), table.log_time_ns, stamps)
    return cropped(made.odometry(enu(place), quat_EB, velocity_E, None if rates is None else flu(rates)))


def _asked_attitude(table: Table) -> Array | None:
    """Quaternions FRD to NED; of old firmware, which fills them in at times only, from the angles."""
    quat, angles = numbers(table, "q_d"), numbers(table, "roll_body", "pitch_body", "yaw_body")
    valid = true(table, "q_d_valid")
    if quat is None:
        return None if angles is None else quat_of_euler(*angles.T)
    if angles is not None and not valid.all():
        return np.where(valid[:, None], quat, quat_of_euler(*angles.T))
    return quat


def _asked_position(table: Table) -> Array | None:
    """Position and velocity (N, 6) in NED; NaN where none was asked for."""
    if "position" in table.columns:
        return numbers(table, "position", "velocity")
    return numbers(table, "x", "y", "z", "vx", "vy", "vz")


def _rates(said: Messages, stamps: Stamps) -> Array | None:
    table = said.get("vehicle_rates_setpoint")
    rates = None if table is None else numbers(table, "roll", "pitch", "yaw")
    if table is None or rates is None:
        return None
    return flu(values_at(stamps, sent(table), rates))


FIRST_MOTOR = 101
"""Of PX4's output functions, that of motor 1."""
ROTORS_BY_TYPE = {2: 4, 13: 6, 14: 8, 15: 3}
"""Rotors by MAV_TYPE, of firmware that has no functions of outputs."""
RPM = 2.0 * np.pi / 60.0


def wrenches(said: Messages) -> Iterator[tuple[str, Table]]:
    """Thrust and torque setpoints: shares of the vehicle's authority, about and along the axes of FLU."""
    thrust, torque = said.get("vehicle_thrust_setpoint"), said.get("vehicle_torque_setpoint")
    topic = said.topic("wrench_command_normalised")
    if thrust is not None and torque is not None:
        force, moment = numbers(thrust, "xyz"), numbers(torque, "xyz")
        if force is not None and moment is not None:
            moment = values_at(sent(thrust), sent(torque), moment)
            made = StandardTopic(topic, thrust.log_time_ns, sent(thrust)).wrench(flu(force), flu(moment))
            yield f"{thrust.topic} + {torque.topic}", cropped(made)
            return
    old = said.get("actuator_controls_0")
    control = None if old is None else numbers(old, "control")
    if old is not None and control is not None and control.shape[1] >= 4:
        zero = np.zeros(len(old))
        force = np.stack((zero, zero, control[:, 3]), axis=1)  # old firmware gives the thrust as positive, upwards
        yield old.topic, StandardTopic(topic, old.log_time_ns, sent(old)).wrench(force, flu(control[:, :3]))


def actuators(said: Messages) -> Iterator[tuple[str, Table]]:
    """Motor commands, outputs in pulse widths, and the speeds that the controllers of the motors measured."""
    motors = said.get("actuator_motors")
    control = None if motors is None else numbers(motors, "control")
    if motors is not None and control is not None and (used := np.isfinite(control).any(axis=0)).any():
        stopped = np.nan_to_num(control[:, used])  # NaN is PX4's word for a motor that is disarmed
        made = StandardTopic(said.topic("motor_command_normalised"), motors.log_time_ns, sent(motors))
        yield motors.topic, made.actuators(stopped, unit="normalised")
    for instance, outputs in said.several("actuator_outputs"):
        pulses = _pulses(outputs, said.parameters)
        if pulses is not None:
            topic = said.topic("outputs_pwm" + (f"/{instance}" if instance else ""))
            yield outputs.topic, StandardTopic(topic, outputs.log_time_ns, sent(outputs)).actuators(pulses)
    reported = said.get("esc_status")
    speeds = None if reported is None else _speeds(reported)
    if reported is not None and speeds is not None:
        yield (
            reported.topic,
            StandardTopic(said.topic("esc_measured"), reported.log_time_ns, sent(reported)).actuators(speeds),
        )


def batteries(said: Messages) -> Iterator[tuple[str, Table]]:
    """The voltage of each battery."""
    for instance, table in said.several("battery_status"):
        voltage = numbers(table, "voltage_v")
        if voltage is not None and np.any(voltage > 0.0):
            topic = said.topic("battery" + (f"/{instance}" if instance else ""))
            yield table.topic, StandardTopic(topic, table.log_time_ns, sampled(table)).battery(voltage[:, 0])


def never_armed(said: Messages) -> str | None:
    """A sentence where no command ever asked for thrust: then the log holds no flight."""
    for name, values in (
        ("actuator_armed", "armed"),
        ("actuator_controls_0", "control"),
        ("vehicle_thrust_setpoint", "xyz"),
    ):
        table = said.get(name)
        found = None if table is None else numbers(table, values)
        if table is None or found is None:
            continue
        asked = found[:, 3] if name == "actuator_controls_0" and found.shape[1] > 3 else found
        if np.any(np.abs(np.nan_to_num(asked)) > 0.01):
            return None
        return f"{table.topic}: the motors were never armed, or never asked for thrust: {UNPOWERED}"
    return None


def _pulses(table: Table, parameters: Mapping[str, float | int]) -> Array | None:
    """Pulse widths (N, R) [us] in the order of the motors; None for outputs that are no pulses."""
    output = numbers(table, "output")
    if output is None:
        return None
    functions = [parameters.get(f"PWM_MAIN_FUNC{i + 1}", 0) for i in range(output.shape[1])]
    motors = {int(f) - FIRST_MOTOR: i for i, f in enumerate(functions) if FIRST_MOTOR <= f < FIRST_MOTOR + 12}
    if motors:
        columns = [motors[number] for number in sorted(motors)]
    else:
        count = ROTORS_BY_TYPE.get(int(parameters.get("MAV_TYPE", 0)), 0)
        columns = list(range(min(count, output.shape[1]))) or np.flatnonzero(np.ptp(output, axis=0) > 0.0).tolist()
    pulses = output[:, columns]
    return pulses if pulses.size and are_pulses(pulses).all() else None


def _speeds(table: Table) -> Array | None:
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


__all__ = ["derived", "wanted"]

_MAKERS = (imus, odometries, references, wrenches, actuators, batteries)


def derived(
    tables: Mapping[str, Table], parameters: Mapping[str, float | int] | None = None
) -> tuple[dict[str, Table], list[str]]:
    """Topics made of the PX4 messages in a log, by name, and what to say of them; nothing where there are none."""
    out: dict[str, Table] = {}
    notes: list[str] = []
    for said in by_vehicle(tables, parameters or {}):
        made = [entry for make in _MAKERS for entry in _safely(make, said)]
        if not made:
            continue
        out |= {table.topic: table for _, table in made}
        listed = "; ".join(f"{table.topic} from {source}" for source, table in made)
        notes.append(f"PX4's topics in FRD and NED became, in FLU and ENU: {listed}.")
        unarmed = never_armed(said)
        notes += said.notes + ([unarmed] if unarmed else [])
    return out, notes


def _safely(make: Callable[[Messages], Iterator[tuple[str, Table]]], said: Messages) -> list[tuple[str, Table]]:
    """What a maker gives; messages whose fields have other shapes than PX4's come from a damaged file."""
    try:
        with np.errstate(invalid="ignore", over="ignore"):  # what is absurd is left out later, and counted
            return [(source, table) for source, table in make(said) if len(table) > 1]
    except (ValueError, IndexError, TypeError) as error:
        said.notes.append(f"{said.prefix}/px4: {make.__name__} could not be made of damaged messages ({error}).")
        return []
