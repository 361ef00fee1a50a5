"""What PX4 commanded and what the rotors did: a normalised wrench, motors, pulse widths, measured speeds, the battery.

None of the commands is in newtons or rad/s, and the names of the topics say so (`flight.command_units`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from wrenchgap.flight.check import UNPOWERED
from wrenchgap.flight.flight import Array
from wrenchgap.flight.formats.aerospace import flu
from wrenchgap.flight.formats.made import Made, cropped
from wrenchgap.flight.formats.merging import at
from wrenchgap.flight.formats.px4.messages import Messages, numbers, sampled, sent
from wrenchgap.flight.formats.table import Table

FIRST_MOTOR = 101
"""Of PX4's output functions, that of motor 1."""
ROTORS_BY_TYPE = {2: 4, 13: 6, 14: 8, 15: 3}
"""Rotors by MAV_TYPE, of firmware that has no functions of outputs."""
PULSES = (700.0, 2300.0)
"""Between these [us] lie the pulse widths of a motor that is armed or not."""
RPM = 2.0 * np.pi / 60.0


def wrenches(said: Messages) -> Iterator[tuple[str, Table]]:
    """Thrust and torque setpoints: shares of the vehicle's authority, about and along the axes of FLU."""
    thrust, torque = said.get("vehicle_thrust_setpoint"), said.get("vehicle_torque_setpoint")
    topic = said.topic("wrench_command_normalised")
    if thrust is not None and torque is not None:
        force, moment = numbers(thrust, "xyz"), numbers(torque, "xyz")
        if force is not None and moment is not None:
            moment = at(sent(thrust), sent(torque), moment)
            made = Made(topic, thrust.log_time_ns, sent(thrust)).wrench(flu(force), flu(moment))
            yield f"{thrust.topic} + {torque.topic}", cropped(made)
            return
    old = said.get("actuator_controls_0")
    control = None if old is None else numbers(old, "control")
    if old is not None and control is not None and control.shape[1] >= 4:
        zero = np.zeros(len(old))
        force = np.stack((zero, zero, control[:, 3]), axis=1)  # old firmware gives the thrust as positive, upwards
        yield old.topic, Made(topic, old.log_time_ns, sent(old)).wrench(force, flu(control[:, :3]))


def actuators(said: Messages) -> Iterator[tuple[str, Table]]:
    """Motor commands, outputs in pulse widths, and the speeds that the controllers of the motors measured."""
    motors = said.get("actuator_motors")
    control = None if motors is None else numbers(motors, "control")
    if motors is not None and control is not None and (used := np.isfinite(control).any(axis=0)).any():
        stopped = np.nan_to_num(control[:, used])  # NaN is PX4's word for a motor that is disarmed
        made = Made(said.topic("motor_command_normalised"), motors.log_time_ns, sent(motors))
        yield motors.topic, made.actuators(stopped, unit="normalised")
    for instance, outputs in said.several("actuator_outputs"):
        pulses = _pulses(outputs, said.parameters)
        if pulses is not None:
            topic = said.topic("outputs_pwm" + (f"/{instance}" if instance else ""))
            yield outputs.topic, Made(topic, outputs.log_time_ns, sent(outputs)).actuators(pulses)
    reported = said.get("esc_status")
    speeds = None if reported is None else _speeds(reported)
    if reported is not None and speeds is not None:
        yield reported.topic, Made(said.topic("esc_measured"), reported.log_time_ns, sent(reported)).actuators(speeds)


def batteries(said: Messages) -> Iterator[tuple[str, Table]]:
    """The voltage of each battery."""
    for instance, table in said.several("battery_status"):
        voltage = numbers(table, "voltage_v")
        if voltage is not None and np.any(voltage > 0.0):
            topic = said.topic("battery" + (f"/{instance}" if instance else ""))
            yield table.topic, Made(topic, table.log_time_ns, sampled(table)).battery(voltage[:, 0])


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
    functions = [parameters.get(f"{bank}_FUNC{i + 1}", 0) for bank in ("PWM_MAIN",) for i in range(output.shape[1])]
    motors = {int(f) - FIRST_MOTOR: i for i, f in enumerate(functions) if FIRST_MOTOR <= f < FIRST_MOTOR + 12}
    if motors:
        columns = [motors[number] for number in sorted(motors)]
    else:
        count = ROTORS_BY_TYPE.get(int(parameters.get("MAV_TYPE", 0)), 0)
        columns = list(range(min(count, output.shape[1]))) or np.flatnonzero(np.ptp(output, axis=0) > 0.0).tolist()
    pulses = output[:, columns]
    inside = pulses.size and np.all((pulses >= PULSES[0]) & (pulses <= PULSES[1]))
    return pulses if inside else None


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
