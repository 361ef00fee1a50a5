"""Frames and stamps as they should be, whatever the log does."""

import numpy as np
import pytest

from wrenchgap.flight import so3
from wrenchgap.flight.errors import LogError

ODOMETRY = "nav_msgs/msg/Odometry"
IMU = "sensor_msgs/msg/Imu"


TIME = np.arange(0, 6, 0.01)
POSE, TWIST = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TwistStamped"


@pytest.fixture
def one(logs, loaded):
    """The flight of these series (topic, kind, stamps, columns)."""

    def of(*series):
        recording = logs.Recording()
        for each in series:
            recording.series(*each, stamp_s=True)
        return loaded(recording)

    return of


@pytest.mark.parametrize(("frame", "noise"), [("B", 0.0), ("E", 0.0), ("E", 0.002)])
def test_velocity_is_taken_to_E_from_the_frame_it_is_in(frame, noise, logs, one):
    motion = logs.Motion(TIME)
    motion.position_E = motion.position_E + noise * np.random.default_rng(1).standard_normal(motion.position_E.shape)
    found = one(("/odometry", ODOMETRY, TIME, motion.odometry(frame)))
    np.testing.assert_allclose(found.odometry.velocity_E, motion.velocity_E, atol=1e-12)
    np.testing.assert_allclose(found.odometry.omega_B, motion.omega_B, atol=1e-12)
    assert any("linear velocity is in frame E" in note for note in found.notes) == (frame == "E")


def test_rate_in_world_frame(logs, one):
    motion, z = logs.Motion(TIME), np.array([0.0, 0.0, 1.0])
    yaw = so3.exp(np.outer(0.5 * np.sin(TIME) + 1.5, z))
    motion.quat_EB = so3.multiply(motion.quat_EB, yaw)
    omega_B = so3.rotate_inverse(yaw, motion.omega_B) + np.outer(0.5 * np.cos(TIME), z)
    omega_E = so3.rotate(motion.quat_EB, omega_B)
    twist = logs.xyz("twist.linear", motion.velocity_E) | logs.xyz("twist.angular", omega_E)
    found = one(("/truth/pose", POSE, TIME, motion.pose()), ("/truth/twist", TWIST, TIME, twist))
    np.testing.assert_allclose(found.odometry.omega_B, omega_B, atol=1e-12)
    np.testing.assert_allclose(found.odometry.velocity_E, motion.velocity_E, atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("PoseStamped", ("pose.position", "pose.orientation")),
        ("PoseWithCovarianceStamped", ("pose.pose.position", "pose.pose.orientation")),
        ("TransformStamped", ("transform.translation", "transform.rotation")),
    ],
)
def test_bare_poses(kind, names, logs, one):
    motion = logs.Motion(TIME)
    columns = logs.xyz(names[0], motion.position_E) | logs.xyz(names[1], motion.quat_EB, "wxyz")
    found = one(("/mocap/pose", f"geometry_msgs/msg/{kind}", TIME, columns)).odometry
    np.testing.assert_array_equal(found.position_E, motion.position_E)
    np.testing.assert_allclose(found.quat_EB, motion.quat_EB, atol=1e-15)
    assert found.velocity_E is None
    assert found.omega_B is None


def test_trajectory_reference(logs, loaded):
    motion, recording, store = logs.Motion(TIME), logs.Recording(), logs.typestore(2)
    placed = logs.xyz("translation", motion.position_E) | logs.xyz("rotation", motion.quat_EB, "wxyz")
    moving = logs.xyz("linear", motion.velocity_E) | logs.xyz("angular", motion.omega_B)
    speeding = logs.xyz("linear", motion.acceleration_E)
    parts = {"transforms": ("Transform", placed), "velocities": ("Twist", moving), "accelerations": ("Twist", speeding)}
    kind = "trajectory_msgs/msg/MultiDOFJointTrajectory"
    for i, t in enumerate(TIME):
        rows = {part: (name, {k: v[i] for k, v in columns.items()}) for part, (name, columns) in parts.items()}
        fields = {part: [logs.message(store, f"geometry_msgs/msg/{name}", row)] for part, (name, row) in rows.items()}
        stamp = logs.START_NS + round(t * 1e9)
        points = [logs.message(store, f"{kind}Point", fields)]
        recording.add("/command/trajectory", kind, stamp, {"points": points}, stamp)
    reference = loaded(recording).reference
    np.testing.assert_array_equal(reference.position_E, motion.position_E)
    np.testing.assert_array_equal(reference.velocity_E, motion.velocity_E)
    np.testing.assert_array_equal(reference.acceleration_E, motion.acceleration_E)
    np.testing.assert_array_equal(reference.omega_D, motion.omega_B)


def test_tilt_and_speeds_of_two_topics_are_joined(logs, loaded):
    recording, kind = logs.Recording(), "std_msgs/msg/Float64MultiArray"
    recording.series("/plot/tilt_angle", kind, TIME, {"data": np.outer(TIME, np.ones(6))})
    recording.series("/plot/motor_speed", kind, TIME + 0.0004, {"data": np.outer(TIME, np.full(6, 100.0))})
    found = loaded(recording).actuators
    np.testing.assert_allclose(found.rotor_speed, 100.0 * found.tilt, atol=1e-12)
    assert len(found.time) == len(TIME)


def test_joint_states_by_name_of_command(one):
    columns = {"position": np.outer(TIME, np.ones(4)), "name": [["a", "b", "c", "d"]] * len(TIME)}
    columns["velocity"] = np.outer(TIME, np.zeros(0))
    found = one(("/servo/command", "sensor_msgs/msg/JointState", TIME, columns)).actuators
    assert found.tilt.shape == (len(TIME), 4)
    assert found.rotor_speed.shape == (len(TIME), 0)


def test_not_finite_samples_are_dropped_and_counted(logs, one):
    motion = logs.Motion(TIME)
    motion.omega_B[[5, 6], 0] = np.nan
    motion.specific_force_B[9, 2] = np.inf
    found = one(("/imu", IMU, TIME, motion.imu()))
    assert found.imu.dropped == {"not finite": 3}
    assert len(found.imu.time) == len(TIME) - 3
    assert np.isfinite(found.imu.omega_B).all()
    assert any("3 not finite" in note for note in found.notes)
    assert len(found.imu.gaps) == 1  # two missing samples in a row are three periods


def test_a_channel_of_nothing_but_nan_is_left_out(logs, one):
    motion = logs.Motion(TIME)
    imu = ("/imu", IMU, TIME, {name: np.full(len(TIME), np.nan) for name in motion.imu()})
    found = one(imu, ("/odometry", ODOMETRY, TIME, motion.odometry()))
    assert found.imu is None
    assert any("none of its values is a number" in note for note in found.notes)
    with pytest.raises(LogError, match="nothing usable in /imu"):
        one(imu)


def test_duplicates_and_steps_back(logs, loaded):
    stamps = np.arange(0, 4, 0.01)
    wrong = stamps.copy()
    wrong[100] = wrong[99]  # duplicate
    wrong[200] = wrong[150] + 0.001  # back in time
    wrong[300] = 1e4  # one stamp far in the future must not cost all that follow
    found = loaded(logs.Recording().plain("/imu", stamps, stamp_s=logs.START_NS * 1e-9 + wrong)).imu
    assert found.dropped == {"duplicate stamp": 1, "stamp not increasing": 2}
    assert np.all(np.diff(found.time) > 0)
    assert len(found.time) == len(stamps) - 3
    assert found.time[-1] == pytest.approx(3.99)


def test_gaps_are_found_where_they_are(logs, loaded):
    stamps = np.concatenate((np.arange(0, 2, 0.01), np.arange(2.5, 4, 0.01), np.arange(4.01, 5, 0.01)))
    (gap,) = loaded(logs.Recording().plain("/imu", stamps)).imu.gaps
    assert (gap.start, gap.stop) == pytest.approx((1.99, 2.5))
    bursts = np.sort(np.concatenate([np.arange(0, 4, 0.02) + 0.0001 * i for i in range(4)]))
    assert loaded(logs.Recording().plain("/imu", bursts)).imu.gaps == ()


def test_quaternions_are_normalised_or_dropped_and_their_signs_do_not_jump(logs, one):
    motion = logs.Motion(TIME)
    expected = motion.quat_EB.copy()
    motion.quat_EB[::7] *= -1.0
    motion.quat_EB[10:20] *= 1.1
    motion.quat_EB[30] = 0.0
    found = one(("/pose", POSE, TIME, motion.pose()))
    quat = found.odometry.quat_EB
    np.testing.assert_allclose(quat * np.sign(quat[0, 0]), np.delete(expected, 30, axis=0), atol=1e-15)
    assert found.odometry.dropped == {"zero quaternion": 1}
    assert any("10 quaternions" in note for note in found.notes)


def test_a_twist_of_other_rate_is_brought_to_the_pose(logs, one):
    motion, other = logs.Motion(TIME), np.arange(0, 6, 0.004)
    twist = logs.Motion(other).twist(frame="E")
    found = one(("/truth/pose", POSE, TIME, motion.pose()), ("/truth/twist", TWIST, other, twist))
    np.testing.assert_allclose(found.odometry.velocity_E, motion.velocity_E, atol=1e-4)


def test_a_flight_that_starts_at_zero_keeps_its_first_sample(logs, loaded):
    recording = logs.Recording().series("/imu", IMU, TIME, logs.Motion(TIME).imu(), stamp_s=TIME, start_ns=0)
    found = loaded(recording)
    assert found.start_ns == 0
    assert len(found.imu.time) == len(TIME)


def test_log_without_any_role(logs, loaded):
    recording = logs.Recording().series("/chatter", "std_msgs/msg/String", TIME, {"data": ["x"] * len(TIME)})
    with pytest.raises(LogError, match=r"/chatter \(std_msgs/msg/String\)[\s\S]*--topic imu="):
        loaded(recording)
