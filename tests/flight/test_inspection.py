"""Inspection and sanity checks: each finds the one thing that is wrong, and nothing in a good log."""

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight import so3
from wrenchgap.flight.checks import checks
from wrenchgap.flight.formats import Table
from wrenchgap.flight.inspection import _topic
from wrenchgap.flight.roles import Assignment

TIME = np.arange(0, 6, 0.01)


@pytest.fixture
def found(logs, loaded):
    """Levels and messages, by name, of a plain flight whose motion was changed."""

    def of(change=lambda motion, imu, odometry: (imu, odometry), time=TIME):
        motion = logs.Motion(time)
        imu, odometry = change(motion, motion.imu(), motion.odometry())
        recording = logs.Recording().plain("/command/wrench", time)
        recording.series("/imu", "sensor_msgs/msg/Imu", time, imu, stamp_s=True)
        recording.series("/odometry", "nav_msgs/msg/Odometry", time, odometry, stamp_s=True)
        seen = {}
        for check in checks(loaded(recording)):
            if check.level != "ok":
                seen[check.name] = (check.level, seen.get(check.name, ("", ""))[1] + check.words)
        return seen

    return of


def scaled(prefix, factor):
    def change(motion, imu, odometry):
        return {k: v * factor if k.startswith(prefix) else v for k, v in imu.items()}, odometry

    return change


def without_gravity(motion, imu, odometry):
    motion.specific_force_B = so3.rotate_inverse(motion.quat_EB, motion.acceleration_E)
    return motion.imu(), odometry


def forward_right_down(motion, imu, odometry):
    return {k: -v if k[-1] in "yz" else v for k, v in imu.items()}, odometry


def inverted_attitude(motion, imu, odometry):
    motion.quat_EB = so3.multiply(np.tile([0.0, 1.0, 0.0, 0.0], (len(motion.time), 1)), motion.quat_EB)
    return imu, odometry | motion.pose("pose.pose")


def stuck_gyro(motion, imu, odometry):
    return imu | {"angular_velocity.x": np.full(len(motion.time), 0.25)}, odometry


def half_velocity(motion, imu, odometry):
    return imu, {k: 0.5 * v if k.startswith("twist.twist.linear") else v for k, v in odometry.items()}


def test_a_good_log_has_nothing_to_say(found):
    def noisy(motion, imu, odometry):
        rng = np.random.default_rng(0)
        return {k: v + 0.01 * rng.standard_normal(len(v)) for k, v in imu.items()}, odometry

    assert set(found(noisy)) <= {"constant-channel"}  # the plain motion has no roll or yaw


@pytest.mark.parametrize(
    ("change", "name", "level", "words"),
    [
        (scaled("linear", 1 / 9.81), "accelerometer-unit", "bad", "units of g"),
        (scaled("linear", 3.0), "accelerometer-unit", "bad", "expected about"),
        (scaled("angular", 180 / np.pi), "gyroscope", "bad", "deg/s"),
        (scaled("angular", -1.0), "gyroscope", "bad", "opposite"),
        (without_gravity, "accelerometer-unit", "bad", "gravity was removed"),
        (forward_right_down, "body-frame", "bad", "forward-right-down"),
        (inverted_attitude, "inertial-frame", "bad", "away from up"),
        (stuck_gyro, "constant-channel", "warn", "gyroscope"),
        (half_velocity, "velocity", "bad", "0.5 times"),
    ],
)
def test_each_trap_is_found(change, name, level, words, found):
    seen, message = found(change)[name]
    assert seen == level
    assert words in message


def test_gaps_and_jitter_are_reported(found):
    late = 0.004 * np.random.default_rng(2).random(570)
    assert "1 gap(s), the longest 0.3" in found(time=np.delete(TIME, np.s_[200:230]) + late)["gaps"][1]
    assert not {"gaps", "jitter"} & set(found())


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
    report = flight.inspect(logs.cbor_log(tmp_path / "cbor.mcap"))
    assert report.flight is None
    assert report.level == "bad"
    assert "cbor" in report.topics[0].problem
    assert report.checks[0].words.startswith(str(tmp_path))


def test_two_topics_of_one_role_say_which_part_they_play(logs, tmp_path):
    motion, recording = logs.Motion(TIME), logs.Recording()
    recording.series("/truth/pose", "geometry_msgs/msg/PoseStamped", TIME, motion.pose(), stamp_s=True)
    recording.series("/truth/twist", "geometry_msgs/msg/TwistStamped", TIME, motion.twist(frame="E"), stamp_s=True)
    report = flight.inspect(recording.save(tmp_path / "log.mcap"))
    plays = {topic.topic: topic.plays for topic in report.topics}
    assert plays == {"/truth/pose": ("odometry (pose)",), "/truth/twist": ("odometry (twist)",)}
    assert report.level == "bad"  # nothing to compare with


def test_a_second_clock_and_a_slow_link_are_reported(logs, tmp_path):
    time = np.arange(0.01, 5, 0.01)
    late = logs.START_NS * 1e-9 + 2 * time - 0.3
    recording = logs.Recording().plain("/imu", time, 2 * time, time).plain("/command/wrench", time, 2 * time, late)
    report = flight.inspect(recording.save(tmp_path / "log.mcap"))
    messages = [check.words for check in report.checks if check.name == "clock"]
    assert any("/imu" in m and "0.5000 times" in m for m in messages)
    assert any("/command/wrench" in m and "0.300 s after" in m for m in messages)


def test_a_stamp_of_zero_is_no_gap_of_half_a_century():
    """PX4 logs some messages before it knows the time."""
    stamps = np.concatenate([np.zeros(9), 1_710_773_360 + np.arange(14.0)])
    table = Table("/estimate", "EstimatorTime", (1e9 * stamps).astype(np.int64))
    made = _topic(table, Assignment({}), None, {})
    assert (made.gaps, made.longest_gap) == (0, 0.0)
    assert made.rate == pytest.approx(1.0)
