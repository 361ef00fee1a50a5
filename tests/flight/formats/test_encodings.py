"""JSON and protobuf in MCAP, by Foxglove's schemas or own ones; px4_msgs; a type that has two definitions."""

import json
import sys

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.writer import Writer

from wrenchgap import flight
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats import read_log
from wrenchgap.flight.formats.decode import definitions_of
from wrenchgap.flight.formats.reader import Channel

START = 1_700_000_000_000_000_000
TIME = np.arange(0, 4.0, 0.01)


def written(path, channels):
    """An MCAP of channels (topic, schema name, schema encoding, schema, message encoding, payloads) at TIME."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        known = []
        for topic, name, form, schema, encoding, _ in channels:
            number = writer.register_schema(name, form, schema)
            known.append(writer.register_channel(topic, encoding, number))
        for i, time in enumerate(TIME):
            for channel, (*_, payloads) in zip(known, channels, strict=True):
                stamp = START + round(time * 1e9)
                writer.add_message(channel, stamp, payloads[i], stamp)
        writer.finish()
    return path


def xyz(values, names="xyz"):
    return dict(zip(names, map(float, values), strict=True))


def stamps():
    return [divmod(START + round(time * 1e9), 1_000_000_000) for time in TIME]


@pytest.fixture
def motion(logs):
    return logs.Motion(TIME)


def in_json(motion):
    poses, imus, motors = [], [], []
    for i, (sec, nsec) in enumerate(stamps()):
        quat = xyz(motion.quat_EB[i], "wxyz")
        pose = {"position": xyz(motion.position_E[i]), "orientation": quat}
        poses.append({"timestamp": {"sec": sec, "nsec": nsec}, "frame_id": "world", "pose": pose})
        omega, force = xyz(motion.omega_B[i]), xyz(motion.specific_force_B[i])
        imus.append({"timestamp": {"sec": sec, "nsec": nsec}, "angular_velocity": omega, "linear_acceleration": force})
        motors.append({"motor_speed": [500.0 + i, 501.0, 502.0], "note": "text", "deep": {"er": {"x": i}}})
    return [[json.dumps(message).encode() for message in messages] for messages in (poses, imus, motors)]


def test_json_with_and_without_schemas(motion, tmp_path):
    poses, imus, motors = in_json(motion)
    schema = {"properties": {"pose": {"properties": {"position": {}, "orientation": {}}}}}
    path = written(
        tmp_path / "log.mcap",
        [
            ("/state/pose", "foxglove.PoseInFrame", "jsonschema", json.dumps(schema).encode(), "json", poses),
            ("/imu", "Inertial", "jsonschema", b"{}", "json", imus),
            ("/motors", "Motors", "", b"", "json", motors),
        ],
    )
    found = flight.load(path)
    np.testing.assert_allclose(found.imu.omega_B, motion.omega_B)
    np.testing.assert_allclose(found.odometry.quat_EB, motion.quat_EB)
    assert found.odometry.topic == "/state/pose"
    np.testing.assert_allclose(found.actuators.rotor_speed[:, 0], 500.0 + np.arange(len(TIME)))
    np.testing.assert_allclose(found.odometry.time, TIME, atol=1e-6)


def test_damaged_json_is_counted(motion, tmp_path):
    _, imus, _ = in_json(motion)
    imus[7], imus[9] = b"{broken", b'{"angular_velocity": [[[' * 500
    imus[11] = b'{"angular_velocity": [' + b"9" * 400 + b", 1, 1]}"  # beyond what a float holds: no number
    path = written(tmp_path / "log.mcap", [("/imu", "Inertial", "jsonschema", b"{}", "json", imus)])
    assert "2 of 400 messages do not fit" in " ".join(flight.load(path).notes)


def protobuf_files():
    """foxglove.PoseInFrame as the schema has it, and a lab's own message."""
    files = descriptor_pb2.FileDescriptorSet()
    stamp = files.file.add(name="google/protobuf/timestamp.proto", package="google.protobuf", syntax="proto3")
    own = files.file.add(name="lab.proto", package="foxglove", syntax="proto3", dependency=[stamp.name])
    described(stamp, "Timestamp", ("seconds", 3), ("nanos", 5))
    described(own, "Vector3", *((axis, 1) for axis in "xyz"))
    described(own, "Quaternion", *((axis, 1) for axis in "xyzw"))
    described(own, "Pose", ("position", ".foxglove.Vector3"), ("orientation", ".foxglove.Quaternion"))
    pose = (("timestamp", ".google.protobuf.Timestamp"), ("frame_id", 9), ("pose", ".foxglove.Pose"))
    described(own, "PoseInFrame", *pose)
    vectors = ((name, ".foxglove.Vector3") for name in ("angular_velocity", "linear_acceleration"))
    described(own, "Inertial", pose[0], *vectors, ("motor_speed", 1, 3))
    return files


def described(file, name, *fields):
    message = file.message_type.add(name=name)
    for number, (field, kind, *label) in enumerate(fields, 1):
        made = message.field.add(name=field, number=number, label=label[0] if label else 1)
        made.type = 11 if isinstance(kind, str) else kind
        if isinstance(kind, str):
            made.type_name = kind


@pytest.fixture
def protobuf(motion, tmp_path):
    files, pool = protobuf_files(), descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    kinds = {
        name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"foxglove.{name}"))
        for name in ("PoseInFrame", "Inertial")
    }
    poses, imus = [], []
    for i, (sec, nsec) in enumerate(stamps()):
        pose, imu = kinds["PoseInFrame"](), kinds["Inertial"]()
        for message in (pose, imu):
            message.timestamp.seconds, message.timestamp.nanos = sec, nsec
        for target, values, names in (
            (pose.pose.position, motion.position_E[i], "xyz"),
            (pose.pose.orientation, motion.quat_EB[i], "wxyz"),
            (imu.angular_velocity, motion.omega_B[i], "xyz"),
            (imu.linear_acceleration, motion.specific_force_B[i], "xyz"),
        ):
            for axis, value in zip(names, values, strict=True):
                setattr(target, axis, value)
        imu.motor_speed.extend([300.0, 301.0 + i])
        poses.append(pose.SerializeToString())
        imus.append(imu.SerializeToString())
    schema = files.SerializeToString()
    return written(
        tmp_path / "log.mcap",
        [
            ("/state/pose", "foxglove.PoseInFrame", "protobuf", schema, "protobuf", poses),
            ("/inertial", "foxglove.Inertial", "protobuf", schema, "protobuf", imus),
        ],
    )


def test_protobuf(protobuf, motion):
    found = flight.load(protobuf)
    np.testing.assert_array_equal(found.imu.omega_B, motion.omega_B)
    np.testing.assert_allclose(found.odometry.quat_EB, motion.quat_EB)
    np.testing.assert_array_equal(found.actuators.rotor_speed[:, 1], 301.0 + np.arange(len(TIME)))
    np.testing.assert_allclose(found.imu.time, TIME, atol=1e-6)


def test_without_protobuf_the_topic_names_the_extra(protobuf, monkeypatch):
    monkeypatch.setitem(sys.modules, "google.protobuf", None)
    seen = flight.inspect(protobuf)
    assert all("pip install 'wrenchgap[protobuf]'" in topic.problem for topic in seen.topics)


def test_a_damaged_description_is_a_problem_of_the_topic(motion, tmp_path):
    path = written(tmp_path / "log.mcap", [("/x", "a.B", "protobuf", b"\xff\xfe", "protobuf", [b"\x08\x01"] * 400)])
    with pytest.raises(LogError, match="no topic plays a role"):
        flight.load(path)
    assert "cannot be read" in flight.inspect(path).topics[0].problem


PX4 = {
    "px4_msgs/msg/SensorCombined": "uint64 timestamp\nfloat32[3] gyro_rad\nuint32 gyro_integral_dt\n"
    "int32 accelerometer_timestamp_relative\nfloat32[3] accelerometer_m_s2",
    "px4_msgs/msg/VehicleOdometry": "uint64 timestamp\nuint64 timestamp_sample\nuint8 pose_frame\nfloat32[3] position\n"
    "float32[4] q\nuint8 velocity_frame\nfloat32[3] velocity\nfloat32[3] angular_velocity",
    "px4_msgs/msg/ActuatorMotors": "uint64 timestamp\nuint64 timestamp_sample\nfloat32[12] control",
}


@pytest.mark.parametrize(("form", "space"), [("mcap-zstd", ""), ("folder-sqlite3", "/drone1")])
def test_px4_msgs_in_a_bag_are_read_as_those_of_a_ulog(logs, autopilots, tmp_path, monkeypatch, form, space):
    for name, text in PX4.items():
        monkeypatch.setitem(logs.CUSTOM, name, text)
    seen, micro = autopilots.Climb(TIME), np.round(1e6 * (20.0 + TIME)).astype(int)
    zero, single = np.zeros(len(TIME), dtype=int), np.float32
    recording = logs.Recording()
    columns = {"timestamp": micro, "gyro_rad": seen.gyro.astype(single), "gyro_integral_dt": zero}
    columns["accelerometer_m_s2"] = seen.accelerometer.astype(single)
    recording.series(f"{space}/fmu/out/sensor_combined", "px4_msgs/msg/SensorCombined", TIME, columns)
    columns = {"timestamp": micro, "timestamp_sample": micro, "velocity_frame": zero + 1}
    columns |= {"position": seen.ned.astype(single), "q": seen.q.astype(single), "velocity": seen.v_ned.astype(single)}
    columns["angular_velocity"] = seen.gyro.astype(single)
    recording.series(f"{space}/fmu/out/vehicle_odometry", "px4_msgs/msg/VehicleOdometry", TIME, columns)
    control = np.full((len(TIME), 12), np.nan, dtype=single)
    control[:, :4] = 0.5
    columns = {"timestamp": micro, "timestamp_sample": micro, "control": control}
    recording.series(f"{space}/fmu/in/actuator_motors", "px4_msgs/msg/ActuatorMotors", TIME, columns)
    found = flight.load(recording.save(tmp_path / "log", form))
    assert found.imu.topic == f"{space}/px4/imu"
    np.testing.assert_allclose(found.imu.omega_B[:, 1], -seen.gyro[:, 1], atol=1e-6)
    np.testing.assert_allclose(found.odometry.position_E[:, 2], -seen.ned[:, 2], atol=1e-5)
    np.testing.assert_allclose(found.odometry.velocity_E[:, 1], seen.v_ned[:, 0], atol=1e-5)
    np.testing.assert_allclose(found.odometry.omega_B[:, 1], -seen.gyro[:, 1], atol=1e-6)
    assert found.actuators.unit == "normalised"


def test_one_type_with_two_definitions_is_read_by_each(logs, tmp_path, monkeypatch):
    kind, before, after = (
        "lab_msgs/msg/Drive",
        "float64[] motor_speed\nfloat64 load",
        "uint32 mode\nfloat64[] motor_speed",
    )
    folder = tmp_path / "split"
    folder.mkdir()
    for number, text in enumerate((before, after)):
        monkeypatch.setitem(logs.CUSTOM, kind, text)
        time = TIME + 4.0 * number
        speeds = np.outer(1.0 + time, [100.0, 200.0])
        logs.Recording().series("/drive", kind, time, {"motor_speed": speeds}).save(folder / f"run_{number}.mcap")
    found = flight.load(folder)
    time = np.concatenate((TIME, TIME + 4.0))
    np.testing.assert_allclose(found.actuators.rotor_speed, np.outer(1.0 + time, [100.0, 200.0]))
    assert any("two definitions" in note for note in found.notes)


def test_a_custom_message_of_any_package_needs_no_ros(logs, tmp_path):
    """Nested types of its own, as the definition in the file has them."""
    text = "string name\nown_msgs/Motors[2] pairs\nown_msgs/Motors all\n" + "=" * 80 + "\nMSG: own_msgs/Motors\n"
    channel = Channel("/x", "own_msgs/msg/State", "cdr", f"{text}float32[4] rpm\nbool armed")
    assert "own_msgs/msg/Motors" in definitions_of(channel)
    monkey = {
        "own_msgs/msg/Motors": "float32[4] rpm\nbool armed",
        "own_msgs/msg/State": "string name\nown_msgs/Motors all",
    }
    logs.CUSTOM.update(monkey)
    try:
        rpm = np.outer(np.ones(400), [1.0, 2, 3, 4]).astype(np.float32)
        recording = logs.Recording().series("/state", "own_msgs/msg/State", TIME, {"all.rpm": rpm})
        path = recording.save(tmp_path / "log.mcap")
    finally:
        for name in monkey:
            del logs.CUSTOM[name]
    np.testing.assert_array_equal(read_log(path, lambda *_: True).tables["/state"].columns["all.rpm"], rpm)
    found = flight.load(path, {"rotor_speed": "/state.all.rpm"})
    np.testing.assert_array_equal(found.actuators.rotor_speed, rpm)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("second", ["NaN", "1e400", "-Infinity", "1e30", "1" * 25])
def test_stamps_that_no_clock_shows_are_counted_and_not_converted(motion, tmp_path, second):
    imus = in_json(motion)[1]
    sound = imus[10]
    for i in (10, 11, 12):
        imus[i] = imus[i].replace(b'"sec": 1700000000', f'"sec": {second}'.encode())
    assert imus[10] != sound
    path = written(tmp_path / "log.mcap", [("/imu", "foxglove.Imu", "jsonschema", b"{}", "json", imus)])
    found = flight.load(path)
    assert found.imu.dropped == {"no stamp": 3}
    np.testing.assert_allclose(np.delete(TIME, [10, 11, 12]), found.imu.time, atol=1e-6)


@pytest.mark.parametrize(
    "stamp", [{"sec": 5, "nanosec": 7}, {"sec": [5], "nanosec": [7, 8]}, {"sec": "x", "nanosec": 7}]
)
def test_arrays_where_a_message_of_json_has_numbers_are_one_line(tmp_path, stamp):
    vector = {"x": [0.1], "y": [0.1, 0.2], "z": 9.8}
    message = {"header": {"stamp": stamp}, "angular_velocity": vector, "linear_acceleration": vector}
    payloads = [json.dumps(message).encode()] * 400
    path = written(tmp_path / "log.mcap", [("/imu", "sensor_msgs/msg/Imu", "jsonschema", b"{}", "json", payloads)])
    with pytest.raises(LogError, match=r"'angular_velocity\.x' is not one number in each message"):
        flight.load(path)
