"""Frames and stamps as they should be, whatever the log does."""

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight import so3
from wrenchgap.flight.errors import LogError

ODOMETRY = "nav_msgs/msg/Odometry"
IMU = "sensor_msgs/msg/Imu"


@pytest.fixture
def time():
    return np.arange(0, 6, 0.01)


def one(logs, tmp_path, *series):
    recording = logs.Recording()
    for topic, kind, stamps, columns in series:
        recording.series(topic, kind, stamps, columns, stamp_s=True)
    return flight.load(recording.save(tmp_path / "log.mcap"))


@pytest.mark.parametrize("frame", ["B", "E"])
def test_velocity_is_taken_to_E_from_the_frame_it_is_in(frame, logs, tmp_path, time):
    motion = logs.Motion(time)
    found = one(logs, tmp_path, ("/odometry", ODOMETRY, time, motion.odometry(frame)))
    np.testing.assert_allclose(found.odometry.velocity_E, motion.velocity_E, atol=1e-12)
    np.testing.assert_allclose(found.odometry.omega_B, motion.omega_B, atol=1e-12)
    said = any("linear velocity is in frame E" in note for note in found.notes)
    assert said == (frame == "E")


def test_velocity_frame_is_found_under_noise(logs, tmp_path, time):
    motion, rng = logs.Motion(time), np.random.default_rng(1)
    motion.position_E = motion.position_E + 0.002 * rng.standard_normal(motion.position_E.shape)
    found = one(logs, tmp_path, ("/odometry", ODOMETRY, time, motion.odometry("E")))
    np.testing.assert_allclose(found.odometry.velocity_E, motion.velocity_E, atol=1e-12)


def test_rate_in_world_frame(logs, tmp_path, time):
    motion = logs.Motion(time)
    yaw = so3.exp(np.outer(0.5 * np.sin(time) + 1.5, [0.0, 0.0, 1.0]))
    motion.quat_EB = so3.multiply(motion.quat_EB, yaw)
    yaw_rate = 0.5 * np.cos(time)
    omega_B = so3.rotate_inverse(yaw, motion.omega_B) + np.outer(yaw_rate, [0.0, 0.0, 1.0])
    columns = motion.pose() | {}
    omega_E = so3.rotate(motion.quat_EB, omega_B)
    twist = logs.xyz("twist.linear", motion.velocity_E) | logs.xyz("twist.angular", omega_E)
    found = one(
        logs,
        tmp_path,
        ("/truth/pose", "geometry_msgs/msg/PoseStamped", time, columns),
        ("/truth/twist", "geometry_msgs/msg/TwistStamped", time, twist),
    )
    np.testing.assert_allclose(found.odometry.omega_B, omega_B, atol=1e-12)
    np.testing.assert_allclose(found.odometry.velocity_E, motion.velocity_E, atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "prefix"),
    [("geometry_msgs/msg/PoseStamped", "pose"), ("geometry_msgs/msg/PoseWithCovarianceStamped", "pose.pose")],
)
def test_bare_poses(kind, prefix, logs, tmp_path, time):
    motion = logs.Motion(time)
    found = one(logs, tmp_path, ("/mocap/pose", kind, time, motion.pose(prefix)))
    np.testing.assert_array_equal(found.odometry.position_E, motion.position_E)
    assert found.odometry.velocity_E is None
    assert found.odometry.omega_B is None


def test_transform_stamped(logs, tmp_path, time):
    motion = logs.Motion(time)
    columns = {
        name.replace("pose.position", "transform.translation").replace("pose.orientation", "transform.rotation"): values
        for name, values in motion.pose().items()
    }
    found = one(logs, tmp_path, ("/vicon/quad", "geometry_msgs/msg/TransformStamped", time, columns))
    np.testing.assert_allclose(found.odometry.quat_EB, motion.quat_EB, atol=1e-15)


def test_trajectory_reference(logs, tmp_path, time):
    motion, recording, store = logs.Motion(time), logs.Recording(), logs.typestore(2)
    kind = "trajectory_msgs/msg/MultiDOFJointTrajectory"

    def vector(name, values):
        return logs.message(store, name, dict(zip("xyz", values, strict=True)))

    for i, t in enumerate(time):
        quat = dict(zip("wxyz", motion.quat_EB[i], strict=True))
        transform = store.types["geometry_msgs/msg/Transform"](
            vector("geometry_msgs/msg/Vector3", motion.position_E[i]),
            logs.message(store, "geometry_msgs/msg/Quaternion", quat),
        )
        twist, accel = (
            store.types["geometry_msgs/msg/Twist"](
                vector("geometry_msgs/msg/Vector3", linear), vector("geometry_msgs/msg/Vector3", angular)
            )
            for linear, angular in (
                (motion.velocity_E[i], motion.omega_B[i]),
                (motion.acceleration_E[i], np.zeros(3)),
            )
        )
        point = logs.message(
            store,
            "trajectory_msgs/msg/MultiDOFJointTrajectoryPoint",
            {"transforms": [transform], "velocities": [twist], "accelerations": [accel]},
        )
        stamp = logs.START_NS + round(t * 1e9)
        recording.add("/command/trajectory", kind, stamp, {"points": [point]}, stamp)
    reference = flight.load(recording.save(tmp_path / "log.mcap")).reference
    np.testing.assert_array_equal(reference.position_E, motion.position_E)
    np.testing.assert_array_equal(reference.velocity_E, motion.velocity_E)
    np.testing.assert_array_equal(reference.acceleration_E, motion.acceleration_E)
    np.testing.assert_array_equal(reference.omega_D, motion.omega_B)


def test_tilt_and_speeds_of_two_topics_are_joined(logs, tmp_path, time):
    tilt, speed = np.outer(time, np.ones(6)), np.outer(time, np.full(6, 100.0))
    recording = logs.Recording()
    recording.series("/plot/tilt_angle", "std_msgs/msg/Float64MultiArray", time, {"data": tilt})
    recording.series("/plot/motor_speed", "std_msgs/msg/Float64MultiArray", time + 0.0004, {"data": speed})
    found = flight.load(recording.save(tmp_path / "log.mcap"))
    np.testing.assert_allclose(found.actuators.rotor_speed, 100.0 * found.actuators.tilt, atol=1e-12)
    assert len(found.actuators.time) == len(time)


def test_joint_states_by_name_of_command(logs, tmp_path, time):
    columns = {"position": np.outer(time, np.ones(4)), "name": [["a", "b", "c", "d"]] * len(time)}
    columns["velocity"] = np.outer(time, np.zeros(0))
    found = one(logs, tmp_path, ("/servo/command", "sensor_msgs/msg/JointState", time, columns))
    assert found.actuators.tilt.shape == (len(time), 4)
    assert found.actuators.rotor_speed.shape == (len(time), 0)


def test_not_finite_samples_are_dropped_and_counted(logs, tmp_path, time):
    columns = logs.Motion(time).imu()
    columns["angular_velocity.x"] = columns["angular_velocity.x"].copy()
    columns["angular_velocity.x"][[5, 6]] = np.nan
    columns["linear_acceleration.z"] = columns["linear_acceleration.z"].copy()
    columns["linear_acceleration.z"][9] = np.inf
    found = one(logs, tmp_path, ("/imu", IMU, time, columns))
    assert found.imu.dropped == {"not finite": 3}
    assert len(found.imu.time) == len(time) - 3
    assert np.isfinite(found.imu.omega_B).all()
    assert any("3 not finite" in note for note in found.notes)
    assert len(found.imu.gaps) == 1  # two missing samples in a row are three periods


def test_a_channel_of_nothing_but_nan_is_left_out(logs, tmp_path, time):
    columns = {name: np.full(len(time), np.nan) for name in logs.Motion(time).imu()}
    pose = logs.Motion(time).odometry()
    found = one(logs, tmp_path, ("/imu", IMU, time, columns), ("/odometry", ODOMETRY, time, pose))
    assert found.imu is None
    assert any("none of its values is a number" in note for note in found.notes)
    with pytest.raises(LogError, match="nothing usable in /imu"):
        one(logs, tmp_path, ("/imu", IMU, time, columns))


def test_duplicates_and_steps_back(logs, tmp_path):
    stamps = np.arange(0, 4, 0.01)
    wrong = stamps.copy()
    wrong[100] = wrong[99]  # duplicate
    wrong[200] = wrong[150] + 0.001  # back in time
    wrong[300] = 1e4  # one stamp far in the future must not cost all that follow
    recording = logs.Recording()
    base = logs.START_NS * 1e-9
    recording.series("/imu", IMU, stamps, logs.Motion(stamps).imu(), stamp_s=True)
    for i, (topic, kind, log_ns, fields) in enumerate(recording.entries):
        stamp = logs.START_NS + round(wrong[i] * 1e9)
        fields["header.stamp.sec"], fields["header.stamp.nanosec"] = divmod(stamp, 1_000_000_000)
        recording.entries[i] = (topic, kind, log_ns, fields)
    found = flight.load(recording.save(tmp_path / "log.mcap"))
    assert base > 0
    assert found.imu.dropped == {"duplicate stamp": 1, "stamp not increasing": 2}
    assert np.all(np.diff(found.imu.time) > 0)
    assert len(found.imu.time) == len(stamps) - 3
    assert found.imu.time[-1] == pytest.approx(3.99)


def test_gaps_are_found_where_they_are(logs, tmp_path):
    stamps = np.concatenate((np.arange(0, 2, 0.01), np.arange(2.5, 4, 0.01), np.arange(4.01, 5, 0.01)))
    found = one(logs, tmp_path, ("/imu", IMU, stamps, logs.Motion(stamps).imu()))
    (gap,) = found.imu.gaps
    assert (gap.start, gap.stop) == pytest.approx((1.99, 2.5))


def test_bursts_are_no_gaps(logs, tmp_path):
    stamps = np.sort(np.concatenate([np.arange(0, 4, 0.02) + 0.0001 * i for i in range(4)]))
    found = one(logs, tmp_path, ("/imu", IMU, stamps, logs.Motion(stamps).imu()))
    assert found.imu.gaps == ()


def test_quaternions_are_normalised_or_dropped(logs, tmp_path, time):
    motion = logs.Motion(time)
    expected = motion.quat_EB.copy()
    motion.quat_EB = motion.quat_EB.copy()
    motion.quat_EB[10:20] *= 1.1
    motion.quat_EB[30] = 0.0
    found = one(logs, tmp_path, ("/pose", "geometry_msgs/msg/PoseStamped", time, motion.pose()))
    np.testing.assert_allclose(np.linalg.norm(found.odometry.quat_EB, axis=1), 1.0, atol=1e-15)
    np.testing.assert_allclose(found.odometry.quat_EB, np.delete(expected, 30, axis=0), atol=1e-15)
    assert found.odometry.dropped == {"zero quaternion": 1}
    assert any("10 quaternions" in note for note in found.notes)


def test_quaternion_signs_do_not_jump(logs, tmp_path, time):
    motion = logs.Motion(time)
    motion.quat_EB = motion.quat_EB * np.where(np.arange(len(time)) % 7 == 0, -1.0, 1.0)[:, None]
    found = one(logs, tmp_path, ("/pose", "geometry_msgs/msg/PoseStamped", time, motion.pose()))
    assert np.all(np.sum(found.odometry.quat_EB[1:] * found.odometry.quat_EB[:-1], axis=1) > 0)


def test_a_twist_of_other_rate_is_brought_to_the_pose(logs, tmp_path, time):
    motion, other = logs.Motion(time), np.arange(0, 6, 0.004)
    found = one(
        logs,
        tmp_path,
        ("/truth/pose", "geometry_msgs/msg/PoseStamped", time, motion.pose()),
        ("/truth/twist", "geometry_msgs/msg/TwistStamped", other, logs.Motion(other).twist(frame="E")),
    )
    np.testing.assert_allclose(found.odometry.velocity_E, motion.velocity_E, atol=1e-4)


def test_a_flight_that_starts_at_zero_keeps_its_first_sample(logs, tmp_path):
    time = np.arange(0, 3, 0.01)
    recording = logs.Recording().series("/imu", IMU, time, logs.Motion(time).imu(), stamp_s=time, start_ns=0)
    found = flight.load(recording.save(tmp_path / "log.mcap"))
    assert found.start_ns == 0
    assert len(found.imu.time) == len(time)


def test_log_without_any_role(logs, tmp_path, time):
    recording = logs.Recording().series("/chatter", "std_msgs/msg/String", time, {"data": ["x"] * len(time)})
    with pytest.raises(LogError) as caught:
        flight.load(recording.save(tmp_path / "log.mcap"))
    assert "/chatter (std_msgs/msg/String)" in str(caught.value)
    assert "--topic imu=" in str(caught.value)
