"""An ArduPilot log gives the flight that was flown, whatever ArduPilot's frames, units and letters."""

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight import so3
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats.dataflash import _most, parameters

SECONDS = 6.0
SERVOS = {"SERVO1_FUNCTION": 34, "SERVO2_FUNCTION": 33, "SERVO3_FUNCTION": 0, "MOT_THST_EXPO": 0.65}


def at_rate(rate):
    return np.arange(0.0, SECONDS, 1.0 / rate)


def micro(time):
    return np.round(1e6 * (30.0 + np.asarray(time)))


def sensors(log, climb, rate=200):
    time = at_rate(rate)
    seen = climb(time)
    for instance, factor in ((0, 1.0), (1, 0.5)):
        columns = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
        numbers = (factor * column for column in (*seen.gyro.T, *seen.accelerometer.T))
        log.add("IMU", "QBffffff", columns, micro(time), np.full(len(time), instance), *numbers, instance="I")


def estimate(log, climb, quaternions=True):
    time, slow = at_rate(50), at_rate(10)
    seen = climb(time)
    pitch, zero = np.degrees(seen.pitch), 0.0 * time
    columns = "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"
    log.add("ATT", "QcccccC", columns, micro(time), zero, zero, pitch, pitch, zero, zero)
    if quaternions:
        zero = np.zeros(len(time))
        log.add("XKQ", "QBffff", "TimeUS,C,Q1,Q2,Q3,Q4", micro(time), zero, *seen.q.T, instance="C")
    moved = climb(slow)
    columns = "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD"
    angles, core = np.zeros((3, len(slow))), np.zeros(len(slow))
    log.add("XKF1", "QBccCffffff", columns, micro(slow), core, *angles, *moved.v_ned.T, *moved.ned.T, instance="C")


def commands(log):
    time = at_rate(100)
    one = np.ones(len(time))
    log.add("RATE", "Qffff", "TimeUS,ROut,POut,YOut,AOut", micro(time), 0.1 * one, 0.2 * one, 0.3 * one, 0.45 * one)
    pulses = (1400 * one, 1500 * one, 900 * one)
    log.add("RCOU", "QHHH", "TimeUS,C1,C2,C3", micro(time), *pulses)
    log.add("BAT", "QBf", "TimeUS,Inst,Volt", micro(time), 0 * one, 15.8 * one, instance="Inst")
    for instance, rpm in ((0, 6000), (1, 6600)):
        log.add(
            "ESC",
            "QBi",
            "TimeUS,Instance,RPM",
            micro(time + 1e-3 * instance),
            instance * one,
            rpm * one,
            instance="Instance",
        )


@pytest.fixture(params=[True, False], ids=["units said", "no units"])
def log(autopilots, request):
    log = autopilots.Dataflash(SERVOS, units=request.param)
    sensors(log, autopilots.Climb)
    estimate(log, autopilots.Climb)
    commands(log)
    return log


@pytest.fixture
def found(log, tmp_path):
    return flight.load(log.save(tmp_path / "climb.bin"))


def seen_at(found, series, autopilots):
    return autopilots.Climb(series.time + found.start_ns * 1e-9 - 30.0)


def test_pitching_up_heading_north_and_climbing(found, autopilots):
    seen = seen_at(found, found.odometry, autopilots)
    nose = so3.rotate(found.odometry.quat_EB, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(nose[:, 1:], np.stack((np.cos(seen.pitch), np.sin(seen.pitch)), 1), atol=1e-6)
    np.testing.assert_allclose(found.odometry.position_E[:, 1], seen.ned[:, 0], atol=3e-4)
    np.testing.assert_allclose(found.odometry.position_E[:, 2], -seen.ned[:, 2], atol=3e-4)
    np.testing.assert_allclose(found.odometry.velocity_E[:, 2], -seen.v_ned[:, 2], atol=0.02)
    assert not any("is in frame" in note for note in found.notes)


def test_the_first_imu_plays_the_role_in_forward_left_up(found, autopilots):
    seen = seen_at(found, found.imu, autopilots)
    assert found.imu.topic == "/ardupilot/imu"
    np.testing.assert_allclose(found.imu.omega_B[:, 1], -seen.gyro[:, 1], atol=1e-6)
    np.testing.assert_allclose(found.imu.specific_force_B[:, 2], -seen.accelerometer[:, 2], atol=1e-5)
    assert np.median(found.imu.specific_force_B[:, 2]) > 8.0


def test_angles_serve_where_there_are_no_quaternions(autopilots, tmp_path):
    log = autopilots.Dataflash()
    sensors(log, autopilots.Climb)
    estimate(log, autopilots.Climb, quaternions=False)
    found = flight.load(log.save(tmp_path / "log.bin"))
    seen = seen_at(found, found.odometry, autopilots)
    nose = so3.rotate(found.odometry.quat_EB, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(nose[:, 2], np.sin(seen.pitch), atol=2e-4)  # hundredths of a degree


def test_parameters_that_change_on_the_way_are_kept(log, tmp_path):
    log.add("PARM", "QNf", "TimeUS,Name,Value", [2_000_000], [b"MOT_THST_EXPO"], [0.2])
    found = flight.load(log.save(tmp_path / "changed.bin"))
    (change,) = found.autopilot.changes
    assert (change.name, change.time_ns) == ("MOT_THST_EXPO", 2_000_000_000)
    assert (change.before, change.after) == (pytest.approx(0.65), pytest.approx(0.2))
    assert [c.level for c in found.checks if c.name == "parameters"] == ["warn"]


def test_commands_speeds_battery_and_parameters(log, found, tmp_path):
    np.testing.assert_allclose(found.commanded.wrench_B[5], [0, 0, 0.45, 0.1, -0.2, -0.3], rtol=1e-6)
    assert found.commanded.unit == "normalised"
    assert found.actuators.unit == "pwm"
    np.testing.assert_array_equal(found.actuators.rotor_speed[0], [1500.0, 1400.0])  # SERVO2 is motor 1
    path = log.save(tmp_path / "again.bin")
    measured = flight.load(path, {"rotor_speed": "/ardupilot/esc_measured"}).actuators
    np.testing.assert_allclose(measured.rotor_speed[3], [200 * np.pi, 220 * np.pi])
    assert measured.unit == "rad/s"
    np.testing.assert_allclose(found.battery.voltage, 15.8, rtol=1e-6)
    assert parameters(path)["SERVO1_FUNCTION"] == 34
    assert parameters(path)["MOT_THST_EXPO"] == pytest.approx(0.65)
    with pytest.raises(LogError, match="not in SI"):
        flight.in_si(found)


def firmware_3(autopilots, channel="C"):
    """Names and layouts of ArduCopter 3.6: an instance is part of the name, and pulses are 0 while disarmed."""
    log, time, slow = autopilots.Dataflash({"AHRS_EKF_TYPE": 2}), at_rate(200), at_rate(10)
    seen, moved = autopilots.Climb(time), autopilots.Climb(slow)
    for name, factor in (("1", 1.0), ("2", 0.5)):
        late = micro(time) + 700.0  # written after it was sampled
        log.add(f"GYR{name}", "QQfff", "TimeUS,SampleUS,GyrX,GyrY,GyrZ", late, micro(time), *(factor * seen.gyro.T))
        numbers = factor * seen.accelerometer.T
        log.add(f"ACC{name}", "QQfff", "TimeUS,SampleUS,AccX,AccY,AccZ", late, micro(time), *numbers)
    columns, angles = "TimeUS,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD", np.zeros((3, len(slow)))
    for kind, factor in (("N", 1.0), ("X", 7.0)):
        log.add(f"{kind}KQ1", "Qffff", "TimeUS,Q1,Q2,Q3,Q4", micro(time), *seen.q.T)
        numbers = *angles, *(factor * moved.v_ned.T), 0.0 * slow, *(factor * moved.ned.T)
        log.add(f"{kind}KF1", "QccCfffffff", columns, micro(slow), *numbers)
    for motor, rpm in enumerate((6000.0, 6600.0), 1):
        volt = 0.0 * slow + 15.8
        log.add(f"ESC{motor}", "QeC", "TimeUS,RPM,Volt", micro(slow), 0.0 * slow + rpm, volt)
    log.add("CURR", "Qhhh", "TimeUS,Throttle,Volt,Curr", micro(slow), 0.0 * slow, 0.0 * slow + 1580, 0.0 * slow)
    armed = at_rate(50) > 1.0
    moving = armed * (1400 + 10 * np.round(np.sin(at_rate(50))))
    names = ",".join(["TimeUS", *(f"{channel}{n}" for n in (1, 2, 3))])
    log.add("RCOU", "QHHH", names, micro(at_rate(50)), moving, moving + 100 * armed, 0 * armed)
    return log


def test_names_and_layouts_of_firmware_3(autopilots, tmp_path):
    path = firmware_3(autopilots).save(tmp_path / "old.bin")
    found = flight.load(path, {"imu": "/ardupilot/imu/raw", "rotor_speed": "/ardupilot/esc_measured"})
    seen = seen_at(found, found.imu, autopilots)
    np.testing.assert_allclose(found.imu.omega_B[:, 1], -seen.gyro[:, 1], atol=1e-6)
    np.testing.assert_allclose(found.imu.specific_force_B[:, 2], -seen.accelerometer[:, 2], atol=1e-5)
    np.testing.assert_allclose(found.actuators.rotor_speed[3], [200 * np.pi, 220 * np.pi], rtol=1e-6)
    np.testing.assert_allclose(found.battery.voltage, 15.8, rtol=1e-6)
    seen = seen_at(found, found.odometry, autopilots)
    np.testing.assert_allclose(found.odometry.position_E[:, 1], seen.ned[:, 0], atol=3e-4)  # of the estimator in use
    nose = so3.rotate(found.odometry.quat_EB, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(nose[:, 2], np.sin(seen.pitch), atol=1e-6)


@pytest.mark.parametrize("channel", ["C", "Ch"])
def test_pulses_begin_when_the_vehicle_is_armed(autopilots, tmp_path, channel):
    """Channels are Ch1, Ch2, ... up to firmware 3.3."""
    log = firmware_3(autopilots, channel)
    pulses = flight.load(log.save(tmp_path / "old.bin")).actuators
    assert pulses.unit == "pwm"
    np.testing.assert_array_equal(pulses.rotor_speed[:, 1] - pulses.rotor_speed[:, 0], 100.0)
    assert pulses.rotor_speed.min() >= 1390.0
    assert len(pulses.time) == (at_rate(50) > 1.0).sum()


def test_quaternions_of_the_second_estimator_in_firmware_4(autopilots, tmp_path):
    log, time, slow = autopilots.Dataflash({"AHRS_EKF_TYPE": 2}), at_rate(50), at_rate(10)
    seen, moved = autopilots.Climb(time), autopilots.Climb(slow)
    sensors(log, autopilots.Climb)
    log.add("NKQ", "QBffff", "TimeUS,C,Q1,Q2,Q3,Q4", micro(time), 0 * time, *seen.q.T, instance="C")
    numbers = *moved.v_ned.T, *moved.ned.T
    log.add("NKF1", "QBffffff", "TimeUS,C,VN,VE,VD,PN,PE,PD", micro(slow), 0 * slow, *numbers, instance="C")
    found = flight.load(log.save(tmp_path / "log.bin"))
    nose = so3.rotate(found.odometry.quat_EB, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(nose[:, 2], np.sin(seen_at(found, found.odometry, autopilots).pitch), atol=1e-6)


@pytest.mark.parametrize("share", [0.002, 0.3, 0.9999])
def test_a_log_that_was_cut(log, tmp_path, share):
    path = log.save(tmp_path / "log.bin")
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    found, complaint = opened(path)
    assert "\n" not in complaint
    assert len(found.imu.time) > 30 if found else share < 0.01


def test_flipped_bytes_never_end_in_a_traceback(log, tmp_path):
    whole, rng = log.save(tmp_path / "log.bin").read_bytes(), np.random.default_rng(7)
    for number in range(40):
        spoilt = bytearray(whole)
        reach = 2000 if number % 2 else len(spoilt)  # the formats stand at the beginning
        for place in rng.integers(3, reach, 20):
            spoilt[place] = rng.integers(256)
        path = tmp_path / "spoilt.bin"
        path.write_bytes(spoilt)
        assert "\n" not in opened(path)[1]


def places(raw, name):
    """Where the messages of a type begin, by a walk over a log without damage."""
    at, lengths, kinds, found = 0, {128: 89}, {}, []
    while at < len(raw):
        kind = raw[at + 2]
        if kind == 128:
            lengths[raw[at + 3]] = raw[at + 4]
            kinds[raw[at + 3]] = raw[at + 5 : at + 9].rstrip(b"\0").decode()
        found += [at] if kinds.get(kind) == name else []
        at += lengths[kind]
    return found


@pytest.mark.parametrize("kind", [0x00, 0x7F, 0x80])
def test_a_damaged_type_costs_one_message_and_no_more(kind, log, tmp_path):
    """A type that no FMT names, and that of FMT itself."""
    raw = bytearray(log.save(tmp_path / "sound.bin").read_bytes())
    sound = flight.load(tmp_path / "sound.bin")
    raw[places(raw, "RCOU")[20] + 2] = kind
    (tmp_path / "damaged.bin").write_bytes(raw)
    damaged = flight.load(tmp_path / "damaged.bin")
    assert len(damaged.actuators.time) == len(sound.actuators.time) - 1
    assert damaged.imu.time[-1] == sound.imu.time[-1]
    assert any("belong to no whole message" in note for note in damaged.notes)


def test_a_layout_that_is_said_again_with_another_length_ends_in_no_traceback(log, tmp_path):
    raw = bytearray(log.save(tmp_path / "sound.bin").read_bytes())
    last = places(raw, "RCOU")[-1]
    kind = raw[last + 2]
    first = raw.find(bytes((0xA3, 0x95, 128, kind)))
    again = bytearray(raw[first : first + 89])
    again[4] = 255  # as the letters say: 8 + 3 * 64 + 3 * 16 + 4 bytes
    again[9:89] = b"QZZZNNNf".ljust(16, b"\0") + b"TimeUS,a,b,c,d,e,f,g".ljust(64, b"\0")
    message = raw[last : raw.find(bytes((0xA3, 0x95)), last + 3)]  # near the end of the file
    (tmp_path / "damaged.bin").write_bytes(raw + message + again)
    assert flight.load(tmp_path / "damaged.bin").imu is not None


def test_a_damaged_stamp_is_left_out_and_not_put_at_the_end(log, tmp_path):
    raw = bytearray(log.save(tmp_path / "sound.bin").read_bytes())
    sound = flight.load(tmp_path / "sound.bin")
    raw[places(raw, "RCOU")[20] + 3 + 4] ^= 0x40  # the fifth byte of TimeUS: some 76 hours
    (tmp_path / "damaged.bin").write_bytes(raw)
    damaged = flight.load(tmp_path / "damaged.bin")
    assert len(damaged.actuators.time) == len(sound.actuators.time) - 1
    assert damaged.actuators.time[-1] == sound.actuators.time[-1]
    assert any("1 stamp(s) are away from those before and after" in note for note in damaged.notes)


def test_a_message_with_a_field_that_has_no_name_is_left_out(log, autopilots, tmp_path):
    """The others are read."""
    log.add("EXTR", "Qfc", "TimeUS,,Rest", np.array([31e6, 32e6]), np.zeros(2), np.zeros(2))
    path = log.save(tmp_path / "log.bin")
    assert len(flight.load(path).imu.time) > 30
    assert "EXTR" not in {topic.topic for topic in flight.inspect(path).topics}


@pytest.mark.parametrize(("name", "layout", "columns"), [
    ("XTRA", "Qa", "Other,TimeUS"),
    ("GYR", "Qa", "TimeUS,I"),
    ("FMTU", "QaN", "TimeUS,FmtType,UnitIds"),
    ("PARM", "QaN", "TimeUS,Value,Name"),
    ("DSF", "Qa", "TimeUS,Dp"),
])  # fmt: skip
def test_a_column_of_arrays_is_no_time_no_instance_and_no_parameter(autopilots, tmp_path, name, layout, columns):
    """The letter "a": 32 numbers of 16 bits in each message."""
    log = autopilots.Dataflash(units=False)
    sensors(log, autopilots.Climb)
    values = {"Q": [31e6, 32e6], "a": [bytes(range(64))] * 2, "N": [b"#"] * 2}
    log.add(name, layout, columns, *(values[letter] for letter in layout))
    path = log.save(tmp_path / "log.bin")
    assert len(flight.load(path).imu.time) > 30
    assert parameters(path) == {}


@pytest.mark.parametrize("values", [[np.inf], [np.nan, 3.0], [b"x"], [], None])
def test_a_count_of_dropped_blocks_that_is_none_is_no_count(values):
    """Of a damaged log: infinity, text, nothing."""
    found = _most(None if values is None else np.array(values))
    assert found == (3 if values and values[-1] == 3.0 else 0)


def opened(path):
    """The flight and "", or None and the complaint."""
    try:
        return flight.load(path), ""
    except LogError as error:
        return None, str(error)


def test_messages_that_share_one_stamp_have_no_rate(autopilots, tmp_path):
    log = autopilots.Dataflash()
    sensors(log, autopilots.Climb)
    times = np.concatenate((np.full(400, 31e6), [32e6]))
    log.add("MODE", "QB", "TimeUS,Mode", times, np.zeros(401))
    seen = flight.inspect(log.save(tmp_path / "log.bin"))
    assert {topic.topic: topic.rate for topic in seen.topics}["MODE"] is None
