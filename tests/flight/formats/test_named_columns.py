"""Columns under a firmware's own names: a Crazyflie's log variables in any table."""

import numpy as np
import pandas as pd
import pytest

from wrenchgap import flight
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import GRAVITY

TIME = np.arange(0, 8.0, 0.01)


def crazyflie(logs, name="{}.{}", time=TIME):
    """A table as the firmware logs it: deg/s, g, PWM of 16 bits."""
    motion = logs.Motion(time)
    out = {"timestamp": np.round(1e3 * time)}
    for i, axis in enumerate("xyz"):
        out[name.format("gyro", axis)] = np.degrees(motion.omega_B[:, i])
        out[name.format("acc", axis)] = motion.specific_force_B[:, i] / GRAVITY
        out[name.format("stateEstimate", axis)] = motion.position_E[:, i]
        out[name.format("stateEstimate", f"v{axis}")] = motion.velocity_E[:, i]
        out[name.format("stateEstimate", f"a{axis}")] = motion.acceleration_E[:, i] / GRAVITY
    out |= {name.format("stateEstimate", f"q{axis}"): motion.quat_EB[:, i] for i, axis in enumerate("wxyz")}
    out |= {name.format("motor", f"m{i}"): np.full(len(time), 10000.0 * i) for i in (2, 1, 4, 3)}
    return out | {name.format("pm", "vbat"): np.full(len(time), 3.7)}


def load(tmp_path, columns):
    path = tmp_path / "log.csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    return flight.load(path)


def said(found):
    return " ".join(found.notes)


@pytest.mark.parametrize("name", ["{}.{}", "{}_{}", "log_{}_{}"])
def test_a_table_with_the_firmwares_names_is_a_flight(logs, tmp_path, name):
    found, motion = load(tmp_path, crazyflie(logs, name)), logs.Motion(TIME)
    np.testing.assert_allclose(found.imu.omega_B, motion.omega_B, atol=1e-9)
    np.testing.assert_allclose(found.imu.specific_force_B, motion.specific_force_B, atol=1e-9)
    np.testing.assert_allclose(found.odometry.quat_EB, motion.quat_EB, atol=1e-9)
    np.testing.assert_allclose(found.odometry.velocity_E, motion.velocity_E, atol=1e-9)
    assert found.actuators.unit == "normalised"
    np.testing.assert_allclose(found.actuators.rotor_speed[0], np.array([1, 2, 3, 4]) * 10000 / 65535)
    np.testing.assert_allclose(found.battery.voltage, 3.7)


def test_names_that_an_exporter_doubled_and_motion_capture_beside_the_estimate(logs, tmp_path):
    """The layout of NanoBench: gyroscope in rad/s, the estimate 1 m off, PWM under a name with its group twice."""
    motion, own = logs.Motion(TIME), crazyflie(logs)
    out = {"t": TIME}
    for i, axis in enumerate("xyz"):
        out |= {f"p{axis}": motion.position_E[:, i], f"v{axis}": motion.velocity_E[:, i]}
        out |= {f"imu_gyro_{axis}": motion.omega_B[:, i], f"imu_acc_{axis}": own[f"acc.{axis}"]}
        out |= {f"est_stateEstimate_{axis}": own[f"stateEstimate.{axis}"] + 1.0}
    out |= {f"q{axis}": motion.quat_EB[:, i] for i, axis in enumerate("wxyz")}
    out |= {f"att_stateEstimate_q{axis}": motion.quat_EB[:, i] for i, axis in enumerate("wxyz")}
    out |= {f"motor_motor_m{i}": own[f"motor.m{i}"] for i in (1, 2, 3, 4)} | {"pwr_pm_vbat": own["pm.vbat"]}
    found = load(tmp_path, out)
    np.testing.assert_allclose(found.imu.omega_B, motion.omega_B, atol=1e-9)
    np.testing.assert_allclose(found.odometry.position_E, motion.position_E, atol=1e-9)
    assert (found.imu is None, found.actuators.rotor_speed.shape[1], found.battery.voltage[0]) == (False, 4, 3.7)
    assert "gyro is read in rad/s" in said(found)
    assert "acc is read in g" in said(found)


def test_motion_capture_at_a_lower_rate_is_preferred_to_the_estimate(logs, tmp_path):
    motion, columns = logs.Motion(TIME), crazyflie(logs)
    seen = np.where(np.arange(len(TIME)) % 4, np.nan, 1.0)
    columns |= {f"p{axis}": seen * motion.position_E[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"q{axis}": seen * motion.quat_EB[:, i] for i, axis in enumerate("wxyz")}
    found = load(tmp_path, columns)
    assert (found.odometry.topic, len(found.odometry.time)) == ("/odometry", 200)


def test_the_pitch_of_the_estimate_rises_with_the_nose(logs, tmp_path):
    motion, columns = logs.Motion(TIME), crazyflie(logs)
    for axis in "wxyz":
        columns.pop(f"stateEstimate.q{axis}")
    turn = motion.b * np.sin(motion.v * TIME)  # about y, to the left: the nose goes down
    zero = np.zeros(len(TIME))
    columns |= {"stateEstimate.roll": zero, "stateEstimate.pitch": -np.degrees(turn), "stateEstimate.yaw": zero}
    np.testing.assert_allclose(load(tmp_path, columns).odometry.quat_EB, motion.quat_EB, atol=1e-9)


def test_without_an_attitude_the_firmwares_unit_is_taken_and_said(logs, tmp_path):
    columns = {name: values for name, values in crazyflie(logs).items() if not name.startswith("stateEstimate")}
    found = load(tmp_path, columns)
    np.testing.assert_allclose(found.imu.omega_B, logs.Motion(TIME).omega_B, atol=1e-9)
    assert "as the Crazyflie logs gyro.x" in said(found)


def test_the_estimates_acceleration_is_no_accelerometer(logs, tmp_path):
    columns = {name: values for name, values in crazyflie(logs).items() if not name.startswith("acc")}
    assert np.isnan(load(tmp_path, columns).imu.specific_force_B).all()


def test_rows_with_impossible_pwm_are_left_out_everywhere_and_counted(logs, tmp_path):
    columns = crazyflie(logs)
    columns["motor.m2"][600:] = 75535.0 + np.arange(200) * 1e4
    found = load(tmp_path, columns)
    assert [len(s.time) for s in (found.imu, found.odometry, found.actuators, found.battery)] == [600] * 4
    assert found.imu.dropped == {"not finite": 200}
    assert "(25 %)" in said(found)
    assert any(check.name == "left-out" for check in found.checks)


@pytest.mark.parametrize("values", [np.full(len(TIME), 1e6), np.where(TIME < 2.0, 0.0, 4e6), np.full(len(TIME), -5.0)])
def test_a_motor_that_is_beyond_pwm_throughout_stops_in_one_line(logs, tmp_path, values):
    columns = crazyflie(logs)
    columns["motor.m3"] = values
    with pytest.raises(LogError, match=r"log\.csv: motor\.m3 is outside of 0 to 65535.*motor_m3_rpm"):
        load(tmp_path, columns)


def test_m1_beside_a_crazyflies_names_is_its_pwm(logs, tmp_path):
    columns = {name.removeprefix("motor."): values for name, values in crazyflie(logs).items()}
    found = load(tmp_path, columns)
    np.testing.assert_allclose(found.actuators.rotor_speed[0], np.array([1, 2, 3, 4]) * 10000 / 65535)
    assert "read as the PWM" in said(found)
    slow = {name: values / 50.0 if name in ("m1", "m2", "m3", "m4") else values for name, values in columns.items()}
    assert load(tmp_path, slow).actuators.unit == "rad/s"  # up to 800: speeds, as nothing says otherwise


def test_motors_in_two_units_stop_in_one_line(logs, tmp_path):
    columns = crazyflie(logs)
    columns["motor.m3"] = np.full(len(TIME), 0.5)
    with pytest.raises(LogError, match=r"log\.csv: motor\.m3 never exceeds 1"):
        load(tmp_path, columns)


def test_a_stated_unit_is_not_decided_anew(logs, tmp_path):
    columns = crazyflie(logs)
    renamed = {name + " [rpm]" * name.startswith("motor"): v for name, v in columns.items()}
    found = load(tmp_path, renamed)
    assert found.actuators.unit == "rad/s"
    np.testing.assert_allclose(found.actuators.rotor_speed[0, 0], 10000 * np.pi / 30)


def test_a_motor_that_is_missing_leaves_three(logs, tmp_path):
    columns = crazyflie(logs)
    columns.pop("motor.m3")
    assert load(tmp_path, columns).actuators.rotor_speed.shape[1] == 3


@pytest.mark.parametrize("axis", [1, 2])
def test_an_axis_whose_unit_alone_is_stated_is_refused(logs, tmp_path, axis):
    columns = crazyflie(logs)
    columns[f"gyro.{'xyz'[axis]} [rad/s]"] = columns.pop(f"gyro.{'xyz'[axis]}")
    with pytest.raises(LogError, match="one unit"):
        load(tmp_path, columns)
