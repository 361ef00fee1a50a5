"""Logs of the uSD deck, written here by the description of the format, sound and damaged."""

import struct
import zlib

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight.budget import BudgetError
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import GRAVITY

TIME = np.arange(0, 6.0, 0.01)


def header(version, events):
    """Magic, version, and (id, name, variables with their types) of each event."""
    out = struct.pack("<BHH", 0xBC, version, len(events))
    for number, name, variables in events:
        out += struct.pack("<H", number) + name.encode() + b"\0" + struct.pack("<H", len(variables))
        out += b"".join(text.encode() + b"\0" for text in variables)
    return out


def record(version, number, seconds, form, *values):
    stamp = round(seconds * (1e3 if version == 1 else 1e6))
    return struct.pack("<H" + ("I" if version == 1 else "Q") + form, number, stamp, *values)


def log(logs, version=2):
    """A flight at 100 Hz, and an event between, of which nothing is made."""
    motion = logs.Motion(TIME)
    names = [f"gyro.{axis}(f)" for axis in "xyz"] + [f"acc.{axis}(f)" for axis in "xyz"]
    names += [f"stateEstimate.{axis}(f)" for axis in ("x", "y", "z", "vx", "vy", "vz", "qw", "qx", "qy", "qz")]
    names += [f"motor.m{i}(I)" for i in (1, 2, 3, 4)] + ["pm.vbat(f)"]
    out = header(version, [(7, "fixedFrequency", names), (300, "estTDOA", ["id(B)", "distanceDiff(f)"])])
    rows = np.hstack((np.degrees(motion.omega_B), motion.specific_force_B / GRAVITY, motion.position_E,
                      motion.velocity_E, motion.quat_EB))  # fmt: skip
    for k, at in enumerate(TIME):
        out += record(version, 7, 3.0 + at, "16f4If", *rows[k], 10000, 20000, 30000, 65535, 3.7)
        if k % 10 == 0:
            out += record(version, 300, 3.0 + at, "Bf", 5, 0.25)
    return out + struct.pack("<I", zlib.crc32(out))


def save(tmp_path, data):
    path = tmp_path / "log00"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("version", [1, 2])
def test_a_log_is_a_flight(logs, tmp_path, version):
    found, motion = flight.load(save(tmp_path, log(logs, version))), logs.Motion(TIME)
    np.testing.assert_allclose(found.imu.time, TIME, atol=1e-9)
    np.testing.assert_allclose(found.imu.omega_B, motion.omega_B, atol=1e-6)
    np.testing.assert_allclose(found.imu.specific_force_B, motion.specific_force_B, atol=1e-5)
    np.testing.assert_allclose(found.odometry.position_E, motion.position_E, atol=1e-6)
    np.testing.assert_allclose(found.odometry.quat_EB, motion.quat_EB, atol=1e-6)
    np.testing.assert_allclose(found.actuators.rotor_speed[-1], np.array([10000, 20000, 30000, 65535]) / 65535)
    np.testing.assert_allclose(found.battery.voltage, 3.7, rtol=1e-6)
    assert not any("checksum" in said for said in found.damage)


def test_every_event_is_a_table(logs, tmp_path):
    counts = {topic.topic: topic.count for topic in flight.inspect(save(tmp_path, log(logs))).topics}
    assert (counts["/fixedFrequency"], counts["/estTDOA"]) == (600, 60)


@pytest.mark.parametrize("kept", [0.5, 0.9])
def test_a_log_that_is_cut_short_is_read_up_to_its_end(logs, tmp_path, kept):
    whole = log(logs)
    found = flight.load(save(tmp_path, whole[: round(kept * len(whole))]))
    assert len(found.imu.time) == pytest.approx(600 * kept, abs=10)
    assert any("checksum is wrong" in said for said in found.damage)


def test_behind_a_record_of_no_known_event_nothing_is_read(logs, tmp_path):
    whole = log(logs)
    data = bytearray(whole)
    middle = len(whole) // 2
    place = whole.index(struct.pack("<H", 300), middle)
    data[place : place + 2] = b"\xee\xee"
    found = flight.load(save(tmp_path, bytes(data)))
    assert 250 < len(found.imu.time) < 350
    assert any("belong to no whole record" in note for note in found.notes)


HOSTILE = {
    "no event": header(2, []),
    "only its first bytes": b"\xbc\x02\x00",
    "a name without an end": struct.pack("<BHHH", 0xBC, 2, 1, 7) + b"a" * 5000,
    "more events than bytes": struct.pack("<BHH", 0xBC, 2, 65535) + b"\0" * 20,
    "a type that is none": header(2, [(7, "e", ["gyro.x(?)"])]) + b"\0" * 50,
    "a variable without a type": header(2, [(7, "e", ["gyro.x"])]) + b"\0" * 50,
    "a variable twice": header(2, [(7, "e", ["gyro.x(f)", "gyro.x(f)"])]) + b"\0" * 50,
    "an event twice": header(2, [(7, "e", ["gyro.x(f)"]), (8, "e", ["a(f)"])]) + b"\0" * 50,
    "a number for two events": header(2, [(7, "e", ["gyro.x(f)"]), (7, "f", ["a(f)"])]) + b"\0" * 50,
    "records of no event": header(2, [(7, "e", ["gyro.x(f)"])]) + b"\x09\x00" * 50,
}


@pytest.mark.parametrize("what", HOSTILE)
def test_what_is_no_log_is_one_line(tmp_path, what):
    with pytest.raises(LogError) as error:
        flight.load(save(tmp_path, HOSTILE[what]))
    assert "\n" not in str(error.value)


def test_times_that_no_clock_counts_to_are_left_out(tmp_path):
    names = [f"gyro.{axis}(f)" for axis in "xyz"]
    data = header(2, [(7, "e", names)])
    data += b"".join(record(2, 7, 0.01 * k, "3f", 0.1 * k, 0.0, 1.0) for k in range(20))
    data += struct.pack("<HQ3f", 7, 2**64 - 1, 1.0, 1.0, 1.0)
    found = flight.load(save(tmp_path, data))
    assert len(found.imu.time) == 20
    assert "1 of 21 records of e have times that no clock shows: left out." in found.notes


def test_a_log_without_a_time_that_can_be_is_one_line(tmp_path):
    data = header(2, [(7, "e", [f"gyro.{axis}(f)" for axis in "xyz"])])
    data += struct.pack("<HQ3f", 7, 2**64 - 1, 1.0, 1.0, 1.0) * 5
    with pytest.raises(LogError) as error:
        flight.load(save(tmp_path, data))
    assert "\n" not in str(error.value)


@pytest.mark.filterwarnings("error")
def test_damaged_numbers_are_read_without_a_word_of_numpy(logs, tmp_path):
    data = bytearray(log(logs))
    row = data.index(record(2, 7, 3.0, "")[:10]) + 10
    data[row : row + 4] = b"\x01\x00\x80\x7f"  # a NaN that signals
    data[-4:] = struct.pack("<I", zlib.crc32(data[:-4]))
    assert flight.load(save(tmp_path, bytes(data))).imu.dropped == {"not finite": 1}


def test_a_header_of_very_many_variables_asks_the_budget_first(tmp_path):
    data = b"".join(struct.pack("<H", i) + b"e%d\0" % i + struct.pack("<H", 1) + b"v(f)\0" for i in range(60_000))
    with pytest.raises(BudgetError):
        flight.load(save(tmp_path, struct.pack("<BHH", 0xBC, 2, 60_000) + data), budget="100MB")


def test_a_clock_that_goes_back_is_said(tmp_path):
    data = header(2, [(7, "e", [f"gyro.{axis}(f)" for axis in "xyz"])])
    data += b"".join(record(2, 7, 0.01 * k - 0.105 * (k > 10), "3f", 0.1 * k, 0.0, 1.0) for k in range(20))
    found = flight.load(save(tmp_path, data))
    assert np.all(np.diff(found.imu.time) > 0)
    assert "e: time goes back 1 time(s); the rows were put in order." in found.notes
