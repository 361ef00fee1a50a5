"""What we write, others read; and we read back what we wrote."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from wrenchgap import flight
from wrenchgap.flight import Named, so3, write
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.write import provenance

RNG = np.random.default_rng(3)


@pytest.fixture
def made(logs):
    fast, slow = np.arange(0, 2, 0.005), np.arange(0.003, 2, 0.01)
    motion = logs.Motion(slow)
    moving = (slow, motion.position_E, motion.quat_EB, motion.velocity_E, motion.omega_B)

    def noise(columns, n=400):
        return RNG.standard_normal((n, columns))

    return flight.Flight(
        name="made",
        path=Path("made.mcap"),
        content_hash="",
        start_ns=logs.START_NS + 123_456_789,
        commanded=flight.WrenchSeries("/x", fast, noise(6)),
        desired=flight.WrenchSeries("/y", fast, noise(6)),
        actuators=flight.ActuatorSeries("/a", fast, noise(6), noise(12)),
        imu=flight.ImuSeries("/i", fast, noise(3), noise(3)),
        odometry=flight.OdometrySeries("/o", *moving),
        reference=flight.ReferenceSeries("/r", *moving, motion.acceleration_E, noise(3, 200)),
        battery=flight.BatterySeries("/b", slow[::10], np.linspace(16, 15, 20).astype(np.float32).astype(float)),
    )


def assert_same(first, second):
    assert first.start_ns == second.start_ns
    assert first.series().keys() == second.series().keys()
    for role, series in first.series().items():
        for name, values in vars(series).items():
            if isinstance(values, np.ndarray):
                found = getattr(second.series()[role], name)
                np.testing.assert_allclose(found, values, rtol=0, atol=1e-12, err_msg=f"{role}.{name}")
            elif values is None:
                assert getattr(second.series()[role], name) is None, f"{role}.{name}"


def test_round_trip(made, tmp_path):
    found = flight.load(write(made, tmp_path / "log.mcap"))
    assert_same(made, found)
    assert found.notes == ()


@pytest.mark.parametrize(
    ("part", "changes"),
    [
        ("odometry", {"velocity_E": None}),
        ("odometry", {"omega_B": None}),
        ("odometry", {"velocity_E": None, "omega_B": None}),
        ("reference", {"omega_dot_D": None}),
        ("actuators", {"tilt": np.zeros((400, 0))}),
    ],
)
def test_what_is_not_known_stays_unknown(part, changes, made, tmp_path):
    partly = replace(made, battery=None, **{part: replace(getattr(made, part), **changes)})
    assert_same(partly, flight.load(write(partly, tmp_path / "log.mcap")))


def test_rosbags_reads_it(made, tmp_path):
    path = write(made, tmp_path / "log.mcap", extra=(Named("/replay/sigma", made.imu.time, made.imu.omega_B),))
    seen = {}
    with AnyReader([path]) as reader:
        assert reader.message_count == 4 * 400 + 3 * 200 + 20 + 400
        for connection, _stamp, raw in reader.messages():
            seen.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    commands, odometry = seen["/command/actuators"], seen["/odometry"]
    np.testing.assert_array_equal([m.position for m in commands], made.actuators.tilt)
    np.testing.assert_array_equal([m.velocity for m in commands], made.actuators.rotor_speed)
    linear = np.array([[getattr(m.twist.twist.linear, axis) for axis in "xyz"] for m in odometry])
    expected = so3.rotate_inverse(made.odometry.quat_EB, made.odometry.velocity_E)
    np.testing.assert_allclose(linear, expected, atol=1e-14)
    assert {(m.header.frame_id, m.child_frame_id) for m in odometry} == {("world", "base_link")}
    assert [m.vector.y for m in seen["/replay/sigma"]] == made.imu.omega_B[:, 1].tolist()


def test_mcap_ros2_reads_it(made, tmp_path):
    extra = (
        Named("/replay/beta", made.imu.time, made.imu.omega_B[:, 0]),
        Named("/replay/predicted", made.imu.time, made.commanded.wrench_B),
        Named("/replay/eight", made.imu.time, np.tile(np.arange(8.0), (400, 1))),
    )
    path = write(made, tmp_path / "log.mcap", extra=extra)
    seen: dict[str, list] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _schema, channel, record, message in reader.iter_decoded_messages():
            seen.setdefault(channel.topic, []).append((record.log_time, message))
    stamps = [stamp for stamp, _ in seen["/imu"]]
    assert stamps == [made.start_ns + round(t * 1e9) for t in made.imu.time]
    first = seen["/imu"][0][1]
    assert first.header.stamp.sec * 10**9 + first.header.stamp.nanosec == made.start_ns
    assert first.linear_acceleration.z == made.imu.specific_force_B[0, 2]
    assert first.orientation_covariance[0] == -1.0
    assert [m.data for _, m in seen["/replay/beta"]] == made.imu.omega_B[:, 0].tolist()
    assert seen["/replay/predicted"][7][1].wrench.torque.z == made.commanded.wrench_B[7, 5]
    assert list(seen["/replay/eight"][0][1].data) == list(range(8))
    assert np.isnan(seen["/battery"][0][1].current)


def test_additional_series_play_no_role(made, tmp_path):
    bare = replace(made, commanded=None, desired=None, reference=None)
    names = ("predicted", "measured", "correction", "sigma", "cost")
    extra = tuple(Named(f"/replay/{name}", made.imu.time, made.commanded.wrench_B) for name in names)
    assert_same(bare, flight.load(write(bare, tmp_path / "log.mcap", extra=extra)))


def test_same_flight_same_bytes(made, plain, tmp_path):
    paths = [write(made, tmp_path / f"{i}.mcap", metadata={"model": "m", "version": "1"}) for i in range(2)]
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert provenance(paths[0]) == {"model": "m", "version": "1"}
    assert provenance(plain) == {}


def test_an_existing_file_is_safe(made, tmp_path):
    path = tmp_path / "log.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(UsageError, match=r"exists already.*--force"):
        write(made, path)
    assert path.read_bytes() == b"precious"
    write(made, path, force=True)
    assert flight.load(path).imu is not None


def test_nothing_half_written_is_left(made, tmp_path):
    broken = replace(made, imu=replace(made.imu, omega_B=made.imu.omega_B[:10]))
    (tmp_path / "log.mcap").write_bytes(b"old")
    with pytest.raises(ValueError, match="broadcast"):
        write(broken, tmp_path / "log.mcap", force=True)
    assert [p.name for p in tmp_path.iterdir()] == ["log.mcap"]
    assert (tmp_path / "log.mcap").read_bytes() == b"old"


@pytest.mark.parametrize(("name", "words"), [("log.bag", "ends in .mcap"), ("no/log.mcap", "does not exist")])
def test_targets_that_cannot_be(name, words, made, tmp_path):
    with pytest.raises(UsageError, match=words):
        write(made, tmp_path / name)


def test_two_series_of_one_topic(made, tmp_path):
    with pytest.raises(UsageError, match="/imu is written twice"):
        write(made, tmp_path / "log.mcap", extra=(Named("/imu", made.imu.time, made.imu.omega_B),))
    with pytest.raises(UsageError, match="3 values at 400 times"):
        write(made, tmp_path / "log.mcap", extra=(Named("/z", made.imu.time, np.zeros(3)),))
