"""Inspection and sanity checks: each finds the one thing that is wrong, and nothing in a good log."""

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight import so3
from wrenchgap.flight.checks import checks

IMU = "sensor_msgs/msg/Imu"


def found(logs, tmp_path, change=None, time=None):
    """Levels and messages, by name, of a plain flight whose motion was changed."""
    time = np.arange(0, 6, 0.01) if time is None else time
    motion = logs.Motion(time)
    imu, odometry = motion.imu(), motion.odometry()
    if change is not None:
        imu, odometry = change(motion, dict(imu), dict(odometry))
    recording = logs.Recording()
    recording.series("/command/wrench", "geometry_msgs/msg/WrenchStamped", time, logs.wrench(time), stamp_s=True)
    recording.series("/imu", IMU, time, imu, stamp_s=True)
    recording.series("/odometry", "nav_msgs/msg/Odometry", time, odometry, stamp_s=True)
    seen: dict[str, tuple[str, str]] = {}
    for check in checks(flight.load(recording.save(tmp_path / "log.mcap"))):
        if check.level != "ok":
            seen[check.name] = (check.level, seen.get(check.name, ("", ""))[1] + check.message)
    return seen


def scaled(prefix, factor):
    def change(motion, imu, odometry):
        return {k: v * factor if k.startswith(prefix) else v for k, v in imu.items()}, odometry

    return change


def without_gravity(motion, imu, odometry):
    free = so3.rotate_inverse(motion.quat_EB, motion.acceleration_E)
    return imu | {f"linear_acceleration.{axis}": free[:, i] for i, axis in enumerate("xyz")}, odometry


def forward_right_down(motion, imu, odometry):
    return {k: -v if k[-1] in "yz" else v for k, v in imu.items()}, odometry


def inverted_attitude(motion, imu, odometry):
    half = so3.multiply(np.tile([0.0, 1.0, 0.0, 0.0], (len(motion.time), 1)), motion.quat_EB)
    return imu, odometry | {f"pose.pose.orientation.{axis}": half[:, i] for i, axis in enumerate("wxyz")}


def stuck_gyro(motion, imu, odometry):
    return imu | {"angular_velocity.x": np.full(len(motion.time), 0.25)}, odometry


def half_velocity(motion, imu, odometry):
    return imu, {k: 0.5 * v if k.startswith("twist.twist.linear") else v for k, v in odometry.items()}


def test_a_good_log_has_nothing_to_say(logs, tmp_path):
    def noisy(motion, imu, odometry):
        rng = np.random.default_rng(0)
        return {k: v + 0.01 * rng.standard_normal(len(v)) for k, v in imu.items()}, odometry

    assert set(found(logs, tmp_path, noisy)) <= {"constant channel"}  # the plain motion has no roll or yaw


@pytest.mark.parametrize(
    ("change", "name", "level", "words"),
    [
        (scaled("linear", 1 / 9.81), "accelerometer unit", "bad", "units of g"),
        (scaled("linear", 3.0), "accelerometer unit", "warn", "expected about 9.81"),
        (scaled("angular", 180 / np.pi), "gyroscope", "bad", "deg/s"),
        (scaled("angular", -1.0), "gyroscope", "bad", "opposite"),
        (without_gravity, "accelerometer unit", "bad", "gravity was removed"),
        (forward_right_down, "body frame", "bad", "forward-right-down"),
        (inverted_attitude, "inertial frame", "bad", "away from up"),
        (stuck_gyro, "constant channel", "warn", "gyroscope"),
        (half_velocity, "velocity", "warn", "0.50 times"),
    ],
)
def test_each_trap_is_found(change, name, level, words, logs, tmp_path):
    seen = found(logs, tmp_path, change)[name]
    assert seen[0] == level
    assert words in seen[1]


def test_gaps_and_jitter_are_reported(logs, tmp_path):
    rng = np.random.default_rng(2)
    time = np.arange(0, 6, 0.01)
    time = np.concatenate((time[:200], time[230:])) + 0.004 * rng.random(570)
    seen = found(logs, tmp_path, time=time)
    assert "1 gap(s), the longest 0.3" in seen["gaps"][1]
    steady = found(logs, tmp_path)
    assert "gaps" not in steady
    assert "jitter" not in steady


def test_inspection_of_a_plain_log(plain):
    report = flight.inspect(plain)
    assert report.format == "MCAP"
    assert report.size == plain.stat().st_size
    assert report.duration == pytest.approx(3.99)
    topics = {topic.topic: topic for topic in report.topics}
    assert topics["/imu"].plays == ("imu",)
    assert topics["/imu"].rate == pytest.approx(100.0, rel=1e-3)
    assert topics["/odometry"].rate == pytest.approx(50.0, rel=1e-3)
    assert topics["/odometry"].header_offset == pytest.approx(0.0, abs=1e-6)
    assert report.mapping["pose"] == "/odometry"
    assert flight.load(plain, topics=report.mapping).imu.time.shape == (400,)


def test_inspection_of_a_log_that_plays_no_role(logs, tmp_path):
    report = flight.inspect(logs.json_log(tmp_path / "json.mcap"))
    assert report.flight is None
    assert report.level == "bad"
    assert "json" in report.topics[0].problem
    assert report.checks[0].message.startswith(str(tmp_path))


def test_two_topics_of_one_role_say_which_part_they_play(logs, tmp_path):
    time = np.arange(0, 4, 0.01)
    motion = logs.Motion(time)
    recording = logs.Recording()
    recording.series("/truth/pose", "geometry_msgs/msg/PoseStamped", time, motion.pose(), stamp_s=True)
    recording.series("/truth/twist", "geometry_msgs/msg/TwistStamped", time, motion.twist(frame="E"), stamp_s=True)
    report = flight.inspect(recording.save(tmp_path / "log.mcap"))
    assert {topic.topic: topic.plays for topic in report.topics} == {
        "/truth/pose": ("odometry (pose)",),
        "/truth/twist": ("odometry (twist)",),
    }
    assert report.level == "bad"  # nothing to compare with


def test_a_second_clock_and_a_slow_link_are_reported(logs, tmp_path):
    time = np.arange(0.01, 5, 0.01)
    recording = logs.Recording()
    recording.series("/imu", IMU, 2 * time, logs.Motion(time).imu(), stamp_s=time)
    late = logs.START_NS * 1e-9 + 2 * time - 0.3
    recording.series("/command/wrench", "geometry_msgs/msg/WrenchStamped", 2 * time, logs.wrench(time), stamp_s=late)
    report = flight.inspect(recording.save(tmp_path / "log.mcap"))
    messages = [check.message for check in report.checks if check.name == "clock"]
    assert any("/imu" in m and "0.5000 times" in m for m in messages)
    assert any("/command/wrench" in m and "0.300 s after" in m for m in messages)
