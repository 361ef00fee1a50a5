"""Words behind a topic: what was logged in other units and axes reads as if it had been logged in ours."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchgap import flight
from wrenchgap.flight.checks.motion import PERMUTATIONS
from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.flight.mapping_units import Meaning, axes_word, meaning, parse_source

TIME = np.arange(0, 6, 0.01)
NED_OF_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FRD_OF_FLU = np.diag([1.0, -1.0, -1.0])


def vectors(prefix, values):
    return {f"{prefix}.{axis}": values[:, i] for i, axis in enumerate("xyz")}


@pytest.fixture
def read(logs, tmp_path):
    """A plain flight whose IMU or odometry was written otherwise, read with a mapping."""

    def of(topics, imu=None, odometry=None, more=()):
        motion, recording = logs.Motion(TIME), logs.Recording().plain("/command/wrench", TIME)
        recording.series("/imu", "sensor_msgs/msg/Imu", TIME, imu or motion.imu(), stamp_s=True)
        recording.series("/odom", "nav_msgs/msg/Odometry", TIME, odometry or motion.odometry(), stamp_s=True)
        for topic, kind, columns in more:
            recording.series(topic, kind, TIME, columns, stamp_s=True)
        return motion, flight.load(recording.save(tmp_path / "log.mcap"), topics=topics)

    return of


def test_axes_and_units_of_an_imu(read, logs):
    motion = logs.Motion(TIME)
    down = vectors("angular_velocity", np.degrees(motion.omega_B @ FRD_OF_FLU))
    down |= vectors("linear_acceleration", motion.specific_force_B @ FRD_OF_FLU / 9.80665)
    _, found = read({"imu": "/imu:frd,g,deg"}, imu=down)
    assert np.allclose(found.imu.omega_B, motion.omega_B)
    assert np.allclose(found.imu.specific_force_B, motion.specific_force_B)


def test_a_factor_on_one_axis_of_the_sensor_comes_before_the_turn(read, logs):
    motion = logs.Motion(TIME)
    sensed = motion.omega_B @ FRD_OF_FLU * [1.0, 0.5, 1.0]
    down = vectors("angular_velocity", sensed) | vectors("linear_acceleration", motion.specific_force_B @ FRD_OF_FLU)
    _, found = read({"imu": "/imu:frd,gyro.y*2"}, imu=down)
    assert np.allclose(found.imu.omega_B, motion.omega_B)
    assert np.allclose(found.imu.specific_force_B, motion.specific_force_B)
    with pytest.raises(UsageError, match=r"'gyro.w\*2' means nothing.*VECTOR.x\*FACTOR"):
        meaning("gyro.w*2", 1.0, "/imu:gyro.w*2", ["imu"])


@pytest.mark.parametrize(
    "words", ["gyro*1e400", "gyro*1e300", "gyro*0", "gyro*1e9,gyro*1e9", "gyro.x*1e300,gyro.x*1e300", "stamp*1e30"]
)
def test_factors_that_no_sensor_has_are_refused(words):
    """They were warnings of numpy, or "no IMU"."""
    with pytest.raises(UsageError, match=r"its factors come to .*; expected 1e-12 to 1e"):
        meaning(words, 1.0, f"/imu:{words}", ["imu"])
    with pytest.raises(UsageError, match="its factors come to inf"):
        meaning("", float("inf"), "/imu*1e400", ["imu"])


def test_angles_that_are_none_are_refused():
    for words in ("yaw=1e308", "gyro.roll=-361", "pitch=1e999"):
        with pytest.raises(UsageError, match="is no angle; expected -360 to 360 degrees"):
            meaning(words, 1.0, f"/imu:{words}", ["imu"])
    assert meaning("yaw=-360,gyro*-1e-3", 1.0, "/imu", ["imu"]).words == ("yaw=-360", "gyro*-1e-3")


@pytest.mark.parametrize("word", ["yaw=45", "roll=180,yaw=-90", "pitch=12.5"])
def test_a_sensor_that_is_mounted_turned(word, read, logs):
    """v_B = R v_sensor; the words apply in the order given."""
    motion = logs.Motion(TIME)
    turn = Rotation.identity()
    for part in word.split(","):
        name, _, degrees = part.partition("=")
        turn = Rotation.from_euler({"roll": "x", "pitch": "y", "yaw": "z"}[name], float(degrees), degrees=True) * turn
    sensed = [turn.inv().apply(v) for v in (motion.omega_B, motion.specific_force_B)]
    imu = vectors("angular_velocity", sensed[0]) | vectors("linear_acceleration", sensed[1])
    _, found = read({"imu": f"/imu:{word}"}, imu=imu)
    assert np.allclose(found.imu.omega_B, motion.omega_B, atol=1e-9)
    assert np.allclose(found.imu.specific_force_B, motion.specific_force_B, atol=1e-9)


def test_an_odometry_in_ned_and_frd_and_millimetres(read, logs):
    motion = logs.Motion(TIME)
    turn = Rotation.from_quat(motion.quat_EB, scalar_first=True).as_matrix()
    x, y, z, w = Rotation.from_matrix(NED_OF_ENU @ turn @ FRD_OF_FLU).as_quat().T
    quat = {f"pose.pose.orientation.{a}": v for a, v in zip("xyzw", (x, y, z, w), strict=True)}
    body = np.einsum("nji,nj->ni", turn, motion.velocity_E) @ FRD_OF_FLU
    odometry = vectors("pose.pose.position", 1e3 * motion.position_E @ NED_OF_ENU.T) | quat
    odometry |= vectors("twist.twist.linear", 1e3 * body) | vectors("twist.twist.angular", motion.omega_B @ FRD_OF_FLU)
    _, found = read({"odometry": "/odom:ned,frd,mm"}, odometry=odometry)
    seen = found.odometry
    assert np.allclose(seen.position_E, motion.position_E)
    assert np.allclose(np.abs(np.sum(seen.quat_EB * motion.quat_EB, axis=1)), 1.0)
    assert np.allclose(seen.velocity_E, motion.velocity_E)
    assert np.allclose(seen.omega_B, motion.omega_B)


def test_gyroscope_and_accelerometer_of_two_topics(read, logs):
    motion = logs.Motion(TIME)
    kind = "geometry_msgs/msg/Vector3Stamped"
    more = [("/gyro", kind, vectors("vector", np.degrees(motion.omega_B)))]
    more += [("/acc", kind, vectors("vector", motion.specific_force_B))]
    _, found = read({"imu": "none", "gyroscope": "/gyro:deg", "accelerometer": "/acc"}, more=more)
    assert found.imu.topic == "/gyro + /acc"
    assert np.allclose(found.imu.omega_B, motion.omega_B)
    assert np.allclose(found.imu.specific_force_B, motion.specific_force_B)
    _, mixed = read({"accelerometer": "/acc*2"}, more=more)  # the gyroscope of the Imu
    assert np.allclose(mixed.imu.specific_force_B, 2 * motion.specific_force_B)
    assert np.allclose(mixed.imu.omega_B, motion.omega_B)


def test_a_factor_and_a_field(logs, tmp_path):
    kind = "mav_msgs/msg/MotorSpeed"
    recording = logs.Recording().plain("/command/wrench", TIME).plain("/imu", TIME)
    speeds = [np.array([9000.0, 6000.0])] * len(TIME)
    recording.series("/esc", kind, TIME, {"motor_speed": speeds}, stamp_s=True)
    path = recording.save(tmp_path / "log.mcap")
    for said in ("/esc.motor_speed*0.10471975512", "/esc:rpm"):
        found = flight.load(path, topics={"rotor_speed": said})
        assert np.allclose(found.actuators.rotor_speed, [942.4778, 628.3185])
        assert found.mapping["rotor_speed"].startswith("/esc")
    with pytest.raises(LogError, match=r"cannot play|no field"):
        flight.load(path, topics={"rotor_speed": "/esc.rpm"})


@pytest.mark.parametrize(
    ("topics", "words"),
    [
        ({"imu": "/imu:sideways"}, "'sideways' means nothing"),
        ({"imu": "/imu:axes=xxz"}, "means nothing"),
        ({"imu": "/imu:mm"}, "'mm' is about position"),
        ({"imu": "/imu*"}, "expected /topic"),
        ({"imu": "/imu:force*2"}, "is about force"),
        ({"imu": "/imu:gyro*two"}, "means nothing"),
        ({"imu": "/imu[0:99999999999]"}, "columns '0:99999999999'; expected numbers below 100,000"),
        ({"imu": f"/imu[{'1' * 5000}]"}, "expected numbers below 100,000"),
        ({"imu": f"/imu[{','.join(['0:99'] * 9)}]"}, "selects more than 256 columns"),
    ],
)
def test_what_means_nothing_is_refused_in_one_line(topics, words, read):
    with pytest.raises(UsageError, match="topic") as refused:
        read(topics)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_mapping_reads_back_as_it_was_said():
    for text in ("/imu:frd,g", "/esc.rpm*0.10472", "/a[3,1]*-1:rpm", "/imu:yaw=-12.5,gyro.axes=x-yz"):
        said = parse_source(text)
        known = Meaning(tuple(filter(None, said.words.split(","))), said.factor)
        head = text[: min((text.index(m) for m in "*:" if m in text), default=len(text))]
        assert f"{head}{known}" == text


def test_every_permutation_has_a_word_that_does_it():
    v = np.array([[1.0, 2.0, 3.0]])
    for matrix in PERMUTATIONS:
        word = axes_word(matrix)
        turned = meaning(word, 1.0, "t", ["accelerometer"]).applied("accelerometer", v)
        assert np.allclose(turned, v @ matrix.T), word


def test_commands_from_no_to_full_throttle_are_shares(logs, tmp_path):
    time = np.arange(0, 4.0, 0.01)
    columns = {"t": time} | {f"u_{i}": np.full(len(time), 10000.0 * i) for i in (1, 2, 3, 4)}
    columns |= {f"gyro_{axis}": 0.1 * np.sin(time) for axis in "xyz"}
    lines = [",".join(columns), *(",".join(f"{v:g}" for v in row) for row in zip(*columns.values(), strict=True))]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    plain = flight.load(path)
    assert plain.actuators is None
    assert plain.command_option == "rotor_speed=/table.u:pwm=0..65535"
    found = flight.load(path, {"rotor_speed": plain.command_option.partition("=")[2]})
    assert found.actuators.unit == "normalised"
    np.testing.assert_allclose(found.actuators.rotor_speed[0], np.array([1, 2, 3, 4]) * 10000 / 65535)
    raised = flight.load(path, {"rotor_speed": "/table.u:pwm=10000..50000"}).actuators
    np.testing.assert_allclose(raised.rotor_speed[0], [0.0, 0.25, 0.5, 0.75])
    for word, unit, factor in (("throttle", "normalised", 1.0), ("pwm", "pwm", 1.0), ("rpm", "rad/s", np.pi / 30)):
        said = flight.load(path, {"rotor_speed": f"/table.u*0.001:{word}"}).actuators
        assert said.unit == unit
        np.testing.assert_allclose(said.rotor_speed[0], np.array([10, 20, 30, 40]) * factor)
        assert flight.load(path, found.mapping).actuators.unit == "normalised"


def test_a_table_of_unknown_columns_is_told_which_may_be_commands(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(
        "t,b_0,b_1,b_2,b_3,thrust_cmd_0,thrust_cmd_1,thrust_cmd_2,thrust_cmd_3\n0,1,2,3,4,0,0.1,1,0\n0.1,1,2,3,4,0,0.1,1,0\n"
    )
    with pytest.raises(LogError, match=r"--topic rotor_speed=/table\.b, "):
        flight.load(path)
    path.write_text(path.read_text(encoding="utf-8").replace("thrust_cmd", "rotor_cmd"), encoding="utf-8")
    with pytest.raises(LogError, match=r"--topic rotor_speed=/table\.rotor_cmd:throttle, "):
        flight.load(path)


@pytest.mark.parametrize("word", ["pwm=0", "pwm=5..5", "pwm=9..1", "pwm=a..b", "pwm=0..1e400", "throttle=1"])
def test_ends_of_a_command_that_are_none_are_refused_in_one_line(word):
    with pytest.raises(UsageError, match=r"means nothing.*pwm=LOW\.\.HIGH"):
        meaning(word, 1.0, f"/table.u:{word}", ["rotor_speed"])


def test_a_command_word_is_not_for_an_imu():
    with pytest.raises(UsageError, match="is about speed"):
        meaning("throttle", 1.0, "/imu:throttle", ["imu"])
