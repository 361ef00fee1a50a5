"""A PX4 log gives the flight that was flown, whatever PX4's frames, units and habits."""

import re
import shlex
import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from wrenchgap import flight
from wrenchgap.flight import cache, so3
from wrenchgap.flight.check import UNPOWERED
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.filters import angular_velocity
from wrenchgap.flight.formats import px4, read_log
from wrenchgap.flight.formats.reader import Table
from wrenchgap.flight.formats.ulog import parameters
from wrenchgap.learn.data.phases import never_flew
from wrenchgap.plant.drafts import px4 as px4_draft
from wrenchgap.plant.model_file import load as load_model
from wrenchgap.replay.cli.main import app

SECONDS = 6.0
STAMP = "uint64_t timestamp"


def micro(time):
    return np.round(1e6 * (5.0 + np.asarray(time))).astype(int)


def at_rate(rate):
    return np.arange(0.0, SECONDS, 1.0 / rate)


def combined(log, climb, rate=250):
    """Means over the interval before the stamp, which here are the values in its middle."""
    time = at_rate(rate)
    seen = climb(time - 0.5 / rate)
    fields = f"{STAMP};float[3] gyro_rad;uint32_t gyro_integral_dt;int32_t accelerometer_timestamp_relative"
    columns = {"timestamp": micro(time), "gyro_rad": seen.gyro, "accelerometer_m_s2": seen.accelerometer}
    columns |= {"gyro_integral_dt": np.full(len(time), round(1e6 / rate))}
    columns |= {"accelerometer_timestamp_relative": np.zeros(len(time), int)}
    log.topic("sensor_combined", f"{fields};float[3] accelerometer_m_s2", columns)


def estimate(log, climb, valid=True, jump=0.0):
    fast, slow = at_rate(100), at_rate(10)
    log.topic("vehicle_attitude", f"{STAMP};float[4] q", {"timestamp": micro(fast), "q": climb(fast).q})
    fields = f"{STAMP};float x;float y;float z;float vx;float vy;float vz;bool xy_valid;bool z_valid"
    fields += ";float[2] delta_xy;uint8_t xy_reset_counter"
    seen, late = climb(slow), slow >= 3.0
    columns = dict(zip(("x", "y", "z"), (seen.ned + np.outer(late, [jump, -jump, 0.0])).T, strict=True))
    columns |= dict(zip(("vx", "vy", "vz"), seen.v_ned.T, strict=True))
    columns |= {"timestamp": micro(slow), "xy_valid": np.full(len(slow), valid), "z_valid": np.full(len(slow), valid)}
    columns |= {"delta_xy": np.tile([jump, -jump], (len(slow), 1)), "xy_reset_counter": late.astype(int)}
    log.topic("vehicle_local_position", fields, columns)


def commands(log):
    time = at_rate(50)
    thrust, torque = np.zeros((len(time), 3)), np.tile([0.1, 0.2, 0.3], (len(time), 1))
    thrust[:, 2] = -0.4 - 0.1 * np.sin(time)
    log.topic("vehicle_thrust_setpoint", f"{STAMP};float[3] xyz", {"timestamp": micro(time), "xyz": thrust})
    log.topic("vehicle_torque_setpoint", f"{STAMP};float[3] xyz", {"timestamp": micro(time), "xyz": torque})
    motors = np.full((len(time), 6), np.nan)
    motors[10:, :4] = [0.41, 0.42, 0.43, 0.44]
    log.topic("actuator_motors", f"{STAMP};float[6] control", {"timestamp": micro(time), "control": motors})


def opened(path):
    """The flight and "", or None and the complaint."""
    try:
        return flight.load(path), ""
    except LogError as error:
        return None, str(error)


@pytest.fixture
def log(autopilots):
    log = autopilots.Ulog({"CA_ROTOR_COUNT": 4, "CA_ROTOR0_PX": 0.15, "PWM_MAIN_FUNC1": 102, "PWM_MAIN_FUNC2": 101})
    combined(log, autopilots.Climb)
    estimate(log, autopilots.Climb)
    commands(log)
    return log


@pytest.fixture
def found(log, tmp_path):
    return flight.load(log.save(tmp_path / "climb.ulg"))


def test_pitching_up_heading_north_and_climbing(found, autopilots):
    seen = autopilots.Climb(found.odometry.time + found.start_ns * 1e-9 - 5.0)
    nose = so3.rotate(found.odometry.quat_EB, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(nose[:, 0], 0.0, atol=1e-6)
    np.testing.assert_allclose(nose[:, 1], np.cos(seen.pitch), atol=1e-6)
    np.testing.assert_allclose(nose[:, 2], np.sin(seen.pitch), atol=1e-6)
    np.testing.assert_allclose(found.odometry.position_E[:, 1], seen.ned[:, 0], atol=2e-4)
    np.testing.assert_allclose(found.odometry.position_E[:, 2], -seen.ned[:, 2], atol=2e-4)
    assert found.odometry.position_E[-1, 2] > 2.0
    np.testing.assert_allclose(found.odometry.velocity_E[:, 1], seen.v_ned[:, 0], atol=0.01)
    np.testing.assert_allclose(found.odometry.velocity_E[:, 2], -seen.v_ned[:, 2], atol=0.01)
    assert not any("is in frame" in note for note in found.notes)


def test_the_imu_is_that_of_the_motion_and_of_the_middle_of_its_interval(found):
    time = found.odometry.time
    rate = angular_velocity(time, found.odometry.quat_EB)[20:-20]
    gyro = np.stack([np.interp(time, found.imu.time, column) for column in found.imu.omega_B.T], 1)[20:-20]
    np.testing.assert_allclose(gyro, rate, atol=3e-3)
    force = np.stack([np.interp(time, found.imu.time, column) for column in found.imu.specific_force_B.T], 1)
    up_E = so3.rotate(found.odometry.quat_EB, force)
    velocity = found.odometry.velocity_E
    acceleration = np.gradient(velocity, time, axis=0)
    np.testing.assert_allclose(up_E[20:-20, 0], acceleration[20:-20, 0], atol=1e-3)
    np.testing.assert_allclose(up_E.mean(axis=0)[2], 9.81 + (velocity[-1, 2] - velocity[0, 2]) / time[-1], atol=0.05)
    seen = found.start_ns * 1e-9 - 5.0
    expected = -0.4 * 2.3 * np.cos(2.3 * (found.imu.time + seen))
    np.testing.assert_allclose(found.imu.omega_B[:, 1], expected, atol=1e-6)


def test_commands_are_normalised_and_say_so(found):
    assert found.commanded.unit == "normalised"
    assert np.all(found.commanded.wrench_B[:, 2] > 0.29)  # up
    np.testing.assert_allclose(found.commanded.wrench_B[0, 3:], [0.1, -0.2, -0.3], rtol=1e-6)
    assert found.actuators.unit == "normalised"
    np.testing.assert_allclose(found.actuators.rotor_speed[0], 0.0)  # disarmed
    np.testing.assert_allclose(found.actuators.rotor_speed[-1], [0.41, 0.42, 0.43, 0.44], rtol=1e-6)
    with pytest.raises(LogError, match=r"not in SI.*wrenchgap model new --from"):
        flight.in_si(found)


def test_parameters_dropouts_and_what_became_of_the_topics_are_said(log, tmp_path):
    path = log.dropout(120).dropout(80).save(tmp_path / "log.ulg")
    assert parameters(path)["CA_ROTOR_COUNT"] == 4
    assert parameters(path)["CA_ROTOR0_PX"] == pytest.approx(0.15)
    notes = " ".join(flight.load(path).notes)
    assert "2 dropouts: the logger lost 0.20 s" in notes
    assert "/px4/odometry from vehicle_attitude + vehicle_local_position" in notes


def test_parameters_that_change_on_the_way_are_said_with_their_times(log, tmp_path, monkeypatch):
    """Of a position of a rotor; the same value again is no change, and another parameter is no matter."""
    log.parameter("CA_ROTOR0_PX", -0.15).parameter("CA_ROTOR0_PX", -0.15).parameter("COM_AUTOS_PAR", 1.0)
    found = flight.load(log.save(tmp_path / "changed.ulg"))
    (change,) = (c for c in found.autopilot.changes if c.name == "CA_ROTOR0_PX")
    assert (change.before, change.after) == (pytest.approx(0.15), pytest.approx(-0.15))
    assert change.time_ns * 1e-9 == pytest.approx(found.start_ns * 1e-9 + found.imu.time[-1], abs=0.5)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for _ in range(2):  # read, and kept
        assert cache.load(found.path).autopilot == found.autopilot
    (check,) = (c for c in found.checks if c.name == "parameters")
    assert check.level == "warn"
    assert re.search(r"CA_ROTOR0_PX from 0.15 to -0.15 at 6\.\d s; the last values", check.words)


def test_jumps_of_the_estimator_are_taken_back(autopilots, tmp_path):
    paths = []
    for jump in (0.0, 7.5):
        log = autopilots.Ulog()
        combined(log, autopilots.Climb)
        estimate(log, autopilots.Climb, jump=jump)
        paths.append(log.save(tmp_path / f"{jump}.ulg"))
    calm, jumped = map(flight.load, paths)
    np.testing.assert_allclose(jumped.odometry.position_E, calm.odometry.position_E, atol=1e-5)
    assert any("1 jump(s)" in note for note in jumped.notes)


def test_no_position_is_no_odometry(autopilots, tmp_path):
    log = autopilots.Ulog()
    combined(log, autopilots.Climb)
    estimate(log, autopilots.Climb, valid=False)
    found = flight.load(log.save(tmp_path / "log.ulg"))
    assert found.odometry is None
    assert any("never knew its position" in note for note in found.notes)


def test_outputs_are_ordered_by_the_motors_that_they_serve_and_speeds_are_in_rad_s(autopilots, tmp_path):
    log = autopilots.Ulog({"PWM_MAIN_FUNC1": 102, "PWM_MAIN_FUNC2": 101, "PWM_MAIN_FUNC3": 301})
    combined(log, autopilots.Climb)
    time = at_rate(50)
    pulses = np.tile([1200.0, 1100.0, 1500.0, 0.0], (len(time), 1))
    log.topic("actuator_outputs", f"{STAMP};float[4] output", {"timestamp": micro(time), "output": pulses})
    report = {"esc_report": f"{STAMP};int32_t esc_rpm;uint8_t actuator_function;uint8_t[3] _padding0"}
    rows = [(t, t, 6000, 102, 0, 0, 0, t, 6600, 101, 0, 0, 0, t, 0, 0, 0, 0, 0) for t in micro(time).tolist()]
    log.nested("esc_status", f"{STAMP};esc_report[3] esc", report, "Q" + 3 * "QiB3B", rows)
    path = log.save(tmp_path / "log.ulg")
    found = flight.load(path)
    assert found.actuators.unit == "pwm"
    np.testing.assert_array_equal(found.actuators.rotor_speed[0], [1100.0, 1200.0])
    measured = flight.load(path, {"rotor_speed": "/px4/esc_measured"}).actuators
    assert measured.unit == "rad/s"
    np.testing.assert_allclose(measured.rotor_speed[0], [220 * np.pi, 200 * np.pi])


def test_a_gyroscope_and_an_accelerometer_of_their_own_rates_meet_at_the_slower_one(autopilots, tmp_path):
    log = autopilots.Ulog()
    for name, rate in (("vehicle_angular_velocity", 400), ("vehicle_acceleration", 100)):
        time = at_rate(rate)
        seen = autopilots.Climb(time)
        values = seen.gyro if "angular" in name else seen.accelerometer
        stamps = {"timestamp": micro(time + 0.003), "timestamp_sample": micro(time)}  # sent later than sampled
        log.topic(name, f"{STAMP};uint64_t timestamp_sample;float[3] xyz", stamps | {"xyz": values})
    found = flight.load(log.save(tmp_path / "log.ulg"))
    seen = autopilots.Climb(found.imu.time + found.start_ns * 1e-9 - 5.0)
    assert 1.0 / found.imu.period == pytest.approx(100.0)
    inner = slice(2, -2)
    np.testing.assert_allclose(found.imu.omega_B[inner, 1], -seen.gyro[inner, 1], atol=2e-4)
    np.testing.assert_allclose(found.imu.specific_force_B[inner, 2], -seen.accelerometer[inner, 2], atol=1e-5)


def test_increments_of_angle_and_velocity(autopilots, tmp_path):
    log, time, interval = autopilots.Ulog(), at_rate(200), 0.005
    before, after = autopilots.Climb(time - interval), autopilots.Climb(time)
    turned = np.zeros((len(time), 3))
    turned[:, 1] = after.pitch - before.pitch
    gained = interval * autopilots.Climb(time - interval / 2).accelerometer
    columns = {
        "timestamp": micro(time),
        "timestamp_sample": micro(time),
        "delta_angle": turned,
        "delta_velocity": gained,
    }
    columns |= {name: np.full(len(time), 5000) for name in ("delta_angle_dt", "delta_velocity_dt")}
    fields = f"{STAMP};uint64_t timestamp_sample;float[3] delta_angle;float[3] delta_velocity"
    log.topic("vehicle_imu", f"{fields};uint32_t delta_angle_dt;uint32_t delta_velocity_dt", columns)
    found = flight.load(log.save(tmp_path / "log.ulg"))
    middle = autopilots.Climb(found.imu.time + found.start_ns * 1e-9 - 5.0)
    np.testing.assert_allclose(found.imu.omega_B[:, 1], -middle.gyro[:, 1], atol=1e-4)
    np.testing.assert_allclose(found.imu.specific_force_B[:, 2], -middle.accelerometer[:, 2], atol=1e-4)


def test_old_firmware_and_a_vehicle_that_was_never_armed(autopilots, tmp_path):
    log = autopilots.Ulog()
    combined(log, autopilots.Climb)
    time = at_rate(50)
    control = np.tile([0.1, 0.2, 0.3, 0.0], (len(time), 1))
    log.topic("actuator_controls_0", f"{STAMP};float[4] control", {"timestamp": micro(time), "control": control})
    found = flight.load(log.save(tmp_path / "log.ulg"))
    np.testing.assert_allclose(found.commanded.wrench_B[0], [0, 0, 0, 0.1, -0.2, -0.3], rtol=1e-6)
    (said,) = [note for note in found.notes if note.endswith(UNPOWERED)]
    assert never_flew("log.ulg", (), load_model("crazyflie"), found.notes) == f"log.ulg: {said[:-1]}; give another log"


@pytest.mark.parametrize("share", [0.001, 0.02, 0.3, 0.7, 0.999])
def test_a_log_that_was_cut_gives_what_is_left_or_one_line(log, tmp_path, share):
    path = log.save(tmp_path / "log.ulg")
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    found, complaint = opened(path)
    assert "\n" not in complaint
    assert len(found.imu.time) > 30 if found else share < 0.01


def test_a_damaged_message_that_reaches_beyond_the_end_is_the_last(tmp_path):
    """Pyulog goes back from the end by the length that it claims: always to the same place, for ever."""
    info = b"\x20char[9] sys_name_that_is_not_read" + bytes(9)
    whole = b"ULog\x01\x12\x35\x01" + bytes(8) + 2000 * (struct.pack("<HB", len(info), ord("I")) + info)
    path = tmp_path / "log.ulg"
    path.write_bytes(whole + struct.pack("<HB", 60_000, 0) + bytes(10))
    assert "damaged" in opened(path)[1]


@pytest.mark.parametrize("kind", "DLPAOICM")
def test_an_empty_record_in_the_middle_costs_itself_alone(log, tmp_path, kind):
    """Its length is known. Pyulog would take it for the end of the file, without a word."""
    path = log.save(tmp_path / "log.ulg")
    whole, place = path.read_bytes(), 16
    while place < len(whole) // 3:
        place += 3 + int.from_bytes(whole[place : place + 2], "little")
    path.write_bytes(whole[:place] + struct.pack("<HB", 0, ord(kind)) + whole[place:])
    found = flight.load(path)
    assert found.imu.time[-1] - found.imu.time[0] > SECONDS - 0.2
    assert any(check.name == "damaged" for check in found.checks)


def test_a_velocity_alone_is_no_flight(autopilots, tmp_path):
    """Of a position that is no number nothing is left, and the velocity beside it plays no role."""
    log, stamps = autopilots.Ulog(), micro(at_rate(20))
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(stamps), 1))
    log.topic("vehicle_attitude", f"{STAMP};float[4] q", {"timestamp": stamps, "q": q})
    rows = dict.fromkeys(("x", "y", "z"), np.full(len(stamps), np.inf))
    rows |= dict.fromkeys(("vx", "vy", "vz", "xy_valid", "z_valid"), np.ones(len(stamps)))
    fields = ";".join([STAMP, *(f"{'bool' if 'valid' in name else 'float'} {name}" for name in rows)])
    log.topic("vehicle_local_position", fields, {"timestamp": stamps} | rows)
    path = log.save(tmp_path / "log.ulg")
    assert "nothing usable" in opened(path)[1]
    assert flight.inspect(path).duration == pytest.approx(SECONDS - 0.05)


def test_flipped_bytes_never_end_in_a_traceback(log, tmp_path):
    whole = log.save(tmp_path / "log.ulg").read_bytes()
    rng = np.random.default_rng(5)
    for _ in range(60):
        spoilt = bytearray(whole)
        for place in rng.integers(7, len(spoilt), 30):
            spoilt[place] = rng.integers(256)
        path = tmp_path / "spoilt.ulg"
        path.write_bytes(spoilt)
        assert "\n" not in opened(path)[1]


def test_without_pyulog_one_line_names_the_extra(log, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyulog", None)
    with pytest.raises(LogError, match=r"pip install 'wrenchgap\[px4\]'"):
        flight.load(log.save(tmp_path / "log.ulg"))


def test_the_commands_of_the_page_do_what_it_says(log, tmp_path, monkeypatch):
    """Those of docs/start/px4.md that read, and need no model: `check` and `convert`."""
    monkeypatch.chdir(tmp_path)
    log.save(tmp_path / "suspect.ulg")
    page = (Path(__file__).resolve().parents[3] / "docs" / "start" / "px4.md").read_text(encoding="utf-8")
    lines = re.findall(r"^wrenchgap ((?:check|inspect|convert) (?!.* -m ).*)$", page, re.MULTILINE)
    assert len(lines) >= 2
    for line in lines:
        done = CliRunner().invoke(app, shlex.split(line, comments=True), prog_name="wrenchgap")
        assert done.exit_code == 0, done.output
    found = flight.load(tmp_path / "suspect.mcap")
    np.testing.assert_allclose(found.imu.omega_B, flight.load(tmp_path / "suspect.ulg").imu.omega_B)


def test_numbers_of_a_damaged_log_that_are_none_are_left_out(autopilots, tmp_path):
    """A damaged type makes a text of a parameter or of the version; a count of rotors may be any number."""
    made = autopilots.Ulog({"CA_ROTOR_COUNT": 2_000_000_000, "MC_ROLL_P": 6.5})
    texts = {"I": "ver_sw_release", "P": "CA_ROTOR0_PX"}
    for kind, name in texts.items():
        key = f"char[4] {name}".encode()
        made.head.append(made._message(kind, bytes([len(key)]) + key + b"abcd"))
    made.topic("battery_status", "uint64_t timestamp;float voltage_v", {"timestamp": [1, 2], "voltage_v": [1.0, 2.0]})
    path = made.save(tmp_path / "damaged.ulg")
    found = read_log(path, lambda topic, kind, fields: True).autopilot
    assert found.firmware == ""
    assert dict(found.parameters) == {"CA_ROTOR_COUNT": 2_000_000_000, "MC_ROLL_P": 6.5}
    assert px4_draft.rotors_of(found.parameters, "damaged") == ()


def test_arrays_in_the_place_of_numbers_are_those_numbers_or_nothing(autopilots, tmp_path):
    """An array (N, 1) beside numbers (N,) would make (N, N): 13 GB of a log of 3 MB."""
    stamp, made = 1_000_000 + 2500 * np.arange(2000), autopilots.Ulog()
    for name in ("vehicle_angular_velocity", "vehicle_acceleration"):
        columns = {"timestamp": stamp, "timestamp_sample": stamp - 100, "xyz": np.tile([0.1, 0.2, -9.8], (2000, 1))}
        made.topic(name, "uint64_t timestamp;uint64_t[1] timestamp_sample;float[3] xyz", columns)
    found = flight.load(made.save(tmp_path / "a.ulg"))
    np.testing.assert_allclose(found.imu.omega_B, np.tile([0.1, -0.2, 9.8], (2000, 1)), rtol=1e-6)
    flags = Table("vehicle_local_position", "", stamp, None, {"xy_valid": np.ones((2000, 3)), "z_valid": np.ones(2000)})
    assert px4.true(flags, "xy_valid", "z_valid").shape == (2000,)


@pytest.mark.parametrize("stamps", [None, np.full(300, "x"), np.ones((300, 2))])
def test_px4_messages_without_a_timestamp_are_left_out_and_named(stamps):
    at, columns = np.arange(300) * 10_000_000, {} if stamps is None else {"timestamp": stamps}
    columns["voltage_v"] = np.full(300, 15.0)
    made, notes = px4.derived(
        {"/battery_status": Table("/battery_status", "px4_msgs/msg/BatteryStatus", at, None, columns)}
    )
    assert made == {}
    assert notes == ["/battery_status: its messages have no number called timestamp, as PX4's have: left out."]


def test_a_clock_that_goes_back_is_said(autopilots, tmp_path):
    made, stamp = autopilots.Ulog(), 1_000_000 + 10_000 * np.arange(100)
    stamp[50:] -= 205_000
    made.topic(
        "battery_status", "uint64_t timestamp;float voltage_v", {"timestamp": stamp, "voltage_v": np.full(100, 15.0)}
    )
    seen = flight.inspect(made.save(tmp_path / "a.ulg"))
    assert "battery_status: time goes back 1 time(s); the rows were put in order." in seen.notes
