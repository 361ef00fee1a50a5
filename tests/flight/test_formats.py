"""Every format gives the same columns; damage gives what is left, or one line."""

import hashlib
import sqlite3

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from wrenchgap import flight
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats import read_log
from wrenchgap.flight.formats.decode import Decoder, definitions_of
from wrenchgap.flight.formats.reader import Channel

FORMS = {
    "mcap": ("zstd", "lz4", "none", "unchunked", "unindexed"),
    "mcap1": ("zstd",),
    "bag": ("", "bz2", "lz4"),
    "folder": ("sqlite3", "sqlite3-file", "sqlite3-message", "mcap", "mcap-file", "mcap-message"),
}


def everything(topic, kind, fields):
    return True


@pytest.mark.parametrize("form", [f"{kind}-{variant}" for kind, variants in FORMS.items() for variant in variants])
def test_every_format_gives_the_recorded_flight(form, logs, tmp_path):
    time = np.arange(0, 1.5, 0.01)
    motion, speeds = logs.Motion(time), np.outer(1.0 + time, [100.0, 200.0, 300.0])
    recording = logs.Recording().plain("/imu", time).plain("/odometry", time)
    recording.series("/motors", "mav_msgs/msg/MotorSpeed", time, {"motor_speed": speeds}, stamp_s=True)
    found = flight.load(recording.save(tmp_path / "log", form))
    np.testing.assert_allclose(found.imu.time, time, atol=1e-9)
    np.testing.assert_array_equal(found.imu.omega_B, motion.omega_B)
    np.testing.assert_array_equal(found.imu.specific_force_B, motion.specific_force_B)
    np.testing.assert_allclose(found.odometry.velocity_E, motion.velocity_E, atol=1e-12)
    np.testing.assert_array_equal(found.actuators.rotor_speed, speeds)
    assert found.start_ns == logs.START_NS
    assert len(found.content_hash) == 64


@pytest.fixture
def bag(logs, tmp_path):
    """A folder of ROS 2."""
    return logs.plain_flight(1.0).save(tmp_path / "bag", "folder-sqlite3")


def test_bare_sqlite_file_and_a_folder_without_metadata(bag):
    whole, alone = flight.load(bag), flight.load(next(bag.glob("*.db3")))
    (bag / "metadata.yaml").unlink()
    without = flight.load(bag)
    for other in (alone, without):
        np.testing.assert_array_equal(other.imu.specific_force_B, whole.imu.specific_force_B)
    assert any("metadata.yaml" in note for note in without.notes)


def test_a_missing_file_of_a_split_bag_is_reported(bag):
    meta = bag / "metadata.yaml"
    text = meta.read_text()
    line = text[text.index("relative_file_paths:") :].splitlines()[1]
    meta.write_text(text.replace(line, f"{line}\n{line.replace('bag', 'bag_1')}", 1))
    assert any("bag_1" in note for note in flight.load(bag).notes)


def test_sqlite_bag_without_definitions_uses_the_known_types(bag):
    with sqlite3.connect(next(bag.glob("*.db3"))) as database:
        database.execute("DROP TABLE message_definitions")
    assert len(flight.load(bag).imu.time) == 100


def decoded(channel, payloads):
    decoder = Decoder(channel, definitions_of(channel))
    decoder.add(payloads)
    return decoder


WORD = st.text(alphabet="abcdefgh", max_size=9)
MIXED = st.tuples(WORD, st.lists(WORD, max_size=3), st.lists(st.floats(width=32, allow_nan=False), max_size=4))


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(drawn=st.lists(MIXED, min_size=1, max_size=12))
def test_decoding_agrees_with_rosbags_whatever_the_lengths(logs, drawn):
    store, kind = logs.typestore(2), "lab_msgs/msg/Mixed"
    payloads = []
    for i, (name, words, c) in enumerate(drawn):
        fields = {"name": name, "flag": i, "a": i / 7, "b": np.array([i, -i, 3], dtype=np.int16), "words": words}
        fields |= {"c": np.array(c, dtype=np.float32), "d": 2**60 + i}
        payloads.append(bytes(store.serialize_cdr(logs.message(store, kind, fields), kind)))
    decoder = decoded(Channel("/x", kind, "cdr", store.generate_msgdef(kind, ros_version=2)[0]), payloads)
    columns = decoder.columns()
    assert decoder.malformed == 0
    np.testing.assert_array_equal(columns["flag"], np.arange(len(drawn)))
    np.testing.assert_array_equal(columns["d"], 2**60 + np.arange(len(drawn)))
    for i, payload in enumerate(payloads):
        oracle = store.deserialize_cdr(payload, kind)
        assert columns["a"][i] == oracle.a
        np.testing.assert_array_equal(columns["b"][i], oracle.b)
        np.testing.assert_array_equal(columns["c"][i, : len(oracle.c)], oracle.c)
        assert np.isnan(columns["c"][i, len(oracle.c) :].astype(float)).all()


def test_big_endian_cdr(logs):
    store, kind = logs.typestore(2), "geometry_msgs/msg/Wrench"
    made = logs.message(store, kind, {"force.x": 1.5, "torque.z": -2.25})
    payloads = [bytes(store.serialize_cdr(made, kind, little_endian=little)) for little in (False, True)]
    columns = decoded(Channel("/w", kind, "cdr"), payloads).columns()
    np.testing.assert_array_equal(columns["force.x"], [1.5, 1.5])
    np.testing.assert_array_equal(columns["torque.z"], [-2.25, -2.25])


def test_idl_definition():
    text = "module lab_msgs { module msg { struct Pair { double first; float second; }; }; };"
    payload = b"\0\1\0\0" + np.array(3.5).tobytes() + np.array(1.25, dtype="f4").tobytes()
    columns = decoded(Channel("/p", "lab_msgs/msg/Pair", "cdr", text, "idl"), [payload]).columns()
    assert (columns["first"][0], columns["second"][0]) == (3.5, 1.25)


def test_messages_shorter_than_their_definition_are_counted():
    payloads = [b"\0\1\0\0" + bytes(48), b"\0\1\0\0" + bytes(20), b"\0"]
    decoder = decoded(Channel("/w", "geometry_msgs/msg/Wrench", "cdr"), payloads)
    assert (decoder.malformed, decoder.count) == (2, 3)
    assert np.isfinite(decoder.columns()["force.x"]).tolist() == [True, False, False]


def test_cut_mcap_is_read_as_far_as_it_goes(plain, tmp_path):
    whole, kept = plain.read_bytes(), []
    for fraction in (0.2, 0.4, 0.6, 0.75):
        (tmp_path / "cut.mcap").write_bytes(whole[: int(fraction * len(whole))])
        log = read_log(tmp_path / "cut.mcap", everything)
        assert any("cut short" in said for said in log.damage)
        kept.append(log.tables["/imu"].columns["angular_velocity.y"])
        np.testing.assert_array_equal(kept[-1], flight.load(plain).imu.omega_B[: len(kept[-1]), 1])
    assert [len(rows) for rows in kept] == sorted(len(rows) for rows in kept)
    assert len(kept[0]) > 30
    assert len(kept[-1]) > 250


def outcome(read, path):
    """Type of what is read, or the line breaks in what is said."""
    try:
        return type(read(path))
    except LogError as error:
        return str(error).count("\n")


def test_any_cut_gives_a_flight_or_one_line(plain, tmp_path):
    whole, path = plain.read_bytes(), tmp_path / "cut.mcap"
    outcomes = set()
    for length in [1, 5, 8, 9, 20, *np.linspace(30, len(whole) - 1, 40).astype(int)]:
        path.write_bytes(whole[:length])
        outcomes.add(outcome(flight.load, path))
    assert outcomes == {flight.Flight, 0}


@pytest.mark.parametrize("form", ["mcap-none", "mcap-zstd", "bag-"])
def test_random_damage_gives_a_report_or_one_line(form, logs, tmp_path):
    path = logs.plain_flight(0.5).save(tmp_path / "log", form)
    whole, rng = path.read_bytes(), np.random.default_rng(7)
    outcomes = set()
    for _ in range(25):
        data = bytearray(whole)
        for place in rng.integers(0, len(data), rng.choice([1, 5, 50])):
            data[place] = rng.integers(256)
        path.write_bytes(data)
        outcomes.add(outcome(flight.inspect, path))
    assert flight.Inspection in outcomes
    assert outcomes <= {flight.Inspection, 0}


def test_damaged_chunk_costs_only_what_is_in_it(plain, tmp_path):
    data = bytearray(plain.read_bytes())
    middle = len(data) // 3
    data[middle : middle + 40] = bytes(40)
    (tmp_path / "damaged.mcap").write_bytes(data)
    log = read_log(tmp_path / "damaged.mcap", everything)
    assert any("damaged" in said for said in log.damage)
    assert 200 < len(log.tables["/imu"]) < 400


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        *((f"empty.{kind}", b"", "empty") for kind in ("mcap", "bag", "db3")),
        ("notes.mcap", b"this is a text file", "not a log"),
        ("broken.bag", b"#ROSBAG V2.0\n" + bytes(100), "not a readable ROS 1 bag"),
        ("broken.db3", b"SQLite format 3\0" + bytes(200), "not a readable ROS 2 bag"),
        ("px4.ulg", b"ULog\x01\x12\x35" + bytes(50), "holds no message"),
    ],
)
def test_no_log_in_one_line(name, content, words, tmp_path):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(LogError, match=words) as caught:
        flight.load(path)
    assert "\n" not in str(caught.value)
    assert name in str(caught.value)


def test_a_folder_without_log_or_with_unrelated_logs_is_not_a_bag(logs, tmp_path):
    with pytest.raises(LogError, match="no such file"):
        flight.load(tmp_path / "nothing.mcap")
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    with pytest.raises(LogError, match=r"no \.db3 or \.mcap"):
        flight.load(tmp_path)
    (tmp_path / "metadata.yaml").unlink()
    for name in ("monday.mcap", "tuesday.mcap"):
        logs.plain_flight(0.1).save(tmp_path / name)
    with pytest.raises(LogError, match="name one of its files"):
        flight.load(tmp_path)


def test_wrong_extension_does_not_matter_and_the_hash_is_that_of_the_bytes(plain, tmp_path):
    path = tmp_path / "flight.bag"
    path.write_bytes(plain.read_bytes())
    found = flight.load(path)
    assert len(found.imu.time) == 400
    assert found.content_hash == hashlib.sha256(plain.read_bytes()).hexdigest()


def test_a_log_without_messages_or_of_cbor_alone(logs, loaded, tmp_path):
    with pytest.raises(LogError, match="no message"):
        loaded(logs.Recording())
    path = logs.cbor_log(tmp_path / "cbor.mcap")
    with pytest.raises(LogError, match=r"no topic plays a role[\s\S]*/thing"):
        flight.load(path)
    with pytest.raises(LogError, match="cbor"):
        flight.load(path, topics={"imu": "/thing"})


def test_a_cut_bag_says_how_to_repair_it(logs, tmp_path):
    path = logs.plain_flight(0.5).save(tmp_path / "log.bag", "bag-")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(LogError, match="reindex"):
        flight.load(path)


def test_several_writers_of_one_topic_are_one_series(logs, tmp_path):
    store, kind = logs.typestore(2), "geometry_msgs/msg/WrenchStamped"
    with (tmp_path / "two.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        schema = writer.register_schema(kind, "ros2msg", store.generate_msgdef(kind, ros_version=2)[0].encode())
        channels = [writer.register_channel("/command/wrench", "cdr", schema, {"writer": str(i)}) for i in range(2)]
        for i in range(100):
            at = logs.START_NS + i * 10_000_000
            fields = {"header.stamp.sec": at // 10**9, "header.stamp.nanosec": at % 10**9, "wrench.force.x": float(i)}
            payload = bytes(store.serialize_cdr(logs.message(store, kind, fields), kind))
            writer.add_message(channels[i % 2], at, payload, at)
        writer.finish()
    np.testing.assert_array_equal(flight.load(tmp_path / "two.mcap").commanded.wrench_B[:, 0], np.arange(100))
