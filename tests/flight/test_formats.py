"""Every format gives the same columns; damage gives what is left, or one line."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wrenchgap import flight
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats import read_log
from wrenchgap.flight.formats.decode import Decoder, definitions_of
from wrenchgap.flight.formats.reader import Channel

FORMS = [
    ("mcap-zstd", "log.mcap"),
    ("mcap-lz4", "log.mcap"),
    ("mcap-none", "log.mcap"),
    ("mcap-unchunked", "log.mcap"),
    ("mcap-unindexed", "log.mcap"),
    ("mcap1-zstd", "log.mcap"),
    ("bag-", "log.bag"),
    ("bag-bz2", "log.bag"),
    ("bag-lz4", "log.bag"),
    ("folder-sqlite3", "bag"),
    ("folder-sqlite3-file", "bag"),
    ("folder-sqlite3-message", "bag"),
    ("folder-mcap", "bag"),
    ("folder-mcap-file", "bag"),
    ("folder-mcap-message", "bag"),
]


def everything(topic, kind, fields):
    return True


@pytest.mark.parametrize(("form", "name"), FORMS)
def test_every_format_gives_the_recorded_flight(form, name, logs, tmp_path):
    time = np.arange(0, 1.5, 0.01)
    motion = logs.Motion(time)
    recording = logs.Recording()
    recording.series("/imu", "sensor_msgs/msg/Imu", time, motion.imu(), stamp_s=True)
    recording.series("/odometry", "nav_msgs/msg/Odometry", time, motion.odometry(), stamp_s=True)
    speeds = np.outer(1.0 + time, [100.0, 200.0, 300.0])
    recording.series("/motors", "mav_msgs/msg/MotorSpeed", time, {"motor_speed": speeds}, stamp_s=True)
    path = recording.save(tmp_path / name, form)
    found = flight.load(path)
    np.testing.assert_allclose(found.imu.time, time, atol=1e-9)
    np.testing.assert_array_equal(found.imu.omega_B, motion.omega_B)
    np.testing.assert_array_equal(found.imu.specific_force_B, motion.specific_force_B)
    np.testing.assert_allclose(found.odometry.velocity_E, motion.velocity_E, atol=1e-12)
    np.testing.assert_array_equal(found.actuators.rotor_speed, speeds)
    assert found.start_ns == logs.START_NS
    assert len(found.content_hash) == 64


def test_bare_sqlite_file_and_a_folder_without_metadata(logs, tmp_path):
    bag = logs.plain_flight(1.0).save(tmp_path / "bag", "folder-sqlite3")
    whole = flight.load(bag)
    alone = flight.load(next(bag.glob("*.db3")))
    (bag / "metadata.yaml").unlink()
    without = flight.load(bag)
    for other in (alone, without):
        np.testing.assert_array_equal(other.imu.specific_force_B, whole.imu.specific_force_B)
    assert any("metadata.yaml" in note for note in without.notes)


def test_a_missing_file_of_a_split_bag_is_reported(logs, tmp_path):
    bag = logs.plain_flight(1.0).save(tmp_path / "bag", "folder-sqlite3")
    meta = bag / "metadata.yaml"
    text = meta.read_text()
    start = text.index("relative_file_paths:")
    line = text[start:].splitlines()[1]
    meta.write_text(text.replace(line, f"{line}\n{line.replace('bag', 'bag_1')}", 1))
    assert any("bag_1" in note for note in flight.load(bag).notes)


def test_sqlite_bag_without_definitions_uses_the_known_types(logs, tmp_path):
    import sqlite3

    bag = logs.plain_flight(1.0).save(tmp_path / "bag", "folder-sqlite3")
    with sqlite3.connect(next(bag.glob("*.db3"))) as database:
        database.execute("DROP TABLE message_definitions")
    assert len(flight.load(bag).imu.time) == 100


def test_decoding_agrees_with_rosbags_whatever_the_lengths(logs):
    store = logs.typestore(2)
    kind = "lab_msgs/msg/Mixed"
    text = st.text(alphabet="abcdefgh", max_size=9)
    numbers = st.floats(width=32, allow_nan=False)

    @settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
    @given(
        st.lists(st.tuples(text, st.lists(text, max_size=3), st.lists(numbers, max_size=4)), min_size=1, max_size=12)
    )
    def check(drawn):
        payloads, flags = [], []
        for i, (name, words, c) in enumerate(drawn):
            fields = {"name": name, "flag": i, "a": i / 7, "b": np.array([i, -i, 3], dtype=np.int16), "words": words}
            fields |= {"c": np.array(c, dtype=np.float32), "d": 2**60 + i}
            payloads.append(bytes(store.serialize_cdr(logs.message(store, kind, fields), kind)))
            flags.append(i)
        definition = store.generate_msgdef(kind, ros_version=2)[0]
        channel = Channel("/x", kind, "cdr", definition)
        decoder = Decoder(channel, definitions_of(channel))
        decoder.add(payloads)
        columns = decoder.columns()
        assert decoder.malformed == 0
        np.testing.assert_array_equal(columns["flag"], flags)
        np.testing.assert_array_equal(columns["d"], 2**60 + np.arange(len(drawn)))
        for i, payload in enumerate(payloads):
            oracle = store.deserialize_cdr(payload, kind)
            assert columns["a"][i] == oracle.a
            np.testing.assert_array_equal(columns["b"][i], oracle.b)
            np.testing.assert_array_equal(columns["c"][i, : len(oracle.c)], oracle.c)
            assert np.isnan(columns["c"][i, len(oracle.c) :].astype(float)).all()

    check()


def test_big_endian_cdr(logs):
    store = logs.typestore(2)
    kind = "geometry_msgs/msg/Wrench"
    made = logs.message(store, kind, {"force.x": 1.5, "torque.z": -2.25})
    payloads = [bytes(store.serialize_cdr(made, kind, little_endian=little)) for little in (False, True)]
    channel = Channel("/w", kind, "cdr")
    decoder = Decoder(channel, definitions_of(channel))
    decoder.add(payloads)
    np.testing.assert_array_equal(decoder.columns()["force.x"], [1.5, 1.5])
    np.testing.assert_array_equal(decoder.columns()["torque.z"], [-2.25, -2.25])


def test_idl_definition():
    text = "module lab_msgs { module msg { struct Pair { double first; float second; }; }; };"
    channel = Channel("/p", "lab_msgs/msg/Pair", "cdr", text, "idl")
    decoder = Decoder(channel, definitions_of(channel))
    decoder.add([b"\0\1\0\0" + np.array(3.5).tobytes() + np.array(1.25, dtype="f4").tobytes()])
    assert decoder.columns()["first"][0] == 3.5
    assert decoder.columns()["second"][0] == 1.25


def test_messages_shorter_than_their_definition_are_counted():
    channel = Channel("/w", "geometry_msgs/msg/Wrench", "cdr")
    decoder = Decoder(channel, definitions_of(channel))
    decoder.add([b"\0\1\0\0" + bytes(48), b"\0\1\0\0" + bytes(20), b"\0"])
    assert decoder.malformed == 2
    assert decoder.count == 3
    assert np.isfinite(decoder.columns()["force.x"]).tolist() == [True, False, False]


def test_cut_mcap_is_read_as_far_as_it_goes(logs, plain, tmp_path):
    whole = plain.read_bytes()
    kept = []
    for fraction in (0.2, 0.4, 0.6, 0.75):
        path = tmp_path / f"cut{fraction}.mcap"
        path.write_bytes(whole[: int(fraction * len(whole))])
        log = read_log(path, everything)
        assert any("cut short" in note for note in log.notes)
        kept.append(len(log.tables["/imu"]))
    assert kept == sorted(kept)
    assert kept[0] > 30
    assert kept[-1] > 250
    np.testing.assert_array_equal(
        read_log(tmp_path / "cut0.4.mcap", everything).tables["/imu"].columns["angular_velocity.y"],
        flight.load(plain).imu.omega_B[: kept[1], 1],
    )


def test_any_cut_gives_a_flight_or_one_line(logs, plain, tmp_path):
    whole = plain.read_bytes()
    path = tmp_path / "cut.mcap"
    outcomes = set()
    for length in [1, 5, 8, 9, 20, *np.linspace(30, len(whole) - 1, 40).astype(int)]:
        path.write_bytes(whole[:length])
        try:
            outcomes.add(type(flight.load(path)))
        except LogError as error:
            outcomes.add(str(error).count("\n"))
    assert outcomes == {flight.Flight, 0}


def test_damaged_chunk_costs_only_what_is_in_it(logs, plain, tmp_path):
    data = bytearray(plain.read_bytes())
    middle = len(data) // 3
    data[middle : middle + 40] = bytes(40)
    path = tmp_path / "damaged.mcap"
    path.write_bytes(data)
    log = read_log(path, everything)
    assert any("damaged" in note for note in log.notes)
    assert 200 < len(log.tables["/imu"]) < 400


@pytest.mark.parametrize("name", ["empty.mcap", "empty.bag", "empty.db3"])
def test_empty_file(name, tmp_path):
    path = tmp_path / name
    path.touch()
    with pytest.raises(LogError, match="empty"):
        flight.load(path)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("notes.mcap", b"this is a text file", "not a log"),
        ("broken.bag", b"#ROSBAG V2.0\n" + bytes(100), "not a readable ROS 1 bag"),
        ("broken.db3", b"SQLite format 3\0" + bytes(200), "not a readable ROS 2 bag"),
        ("px4.ulg", b"ULog\x01\x12\x35" + bytes(50), "supported: MCAP"),
    ],
)
def test_no_log_in_one_line(name, content, words, tmp_path):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(LogError, match=words) as caught:
        flight.load(path)
    assert "\n" not in str(caught.value)
    assert name in str(caught.value)


def test_missing_file_and_folder_without_log(tmp_path):
    with pytest.raises(LogError, match="no such file"):
        flight.load(tmp_path / "nothing.mcap")
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    with pytest.raises(LogError, match=r"no \.db3 or \.mcap"):
        flight.load(tmp_path)


def test_folder_of_unrelated_logs_is_not_a_bag(logs, tmp_path):
    for name in ("monday.mcap", "tuesday.mcap"):
        logs.plain_flight(0.1).save(tmp_path / name)
    with pytest.raises(LogError, match="name one of its files"):
        flight.load(tmp_path)


def test_wrong_extension_does_not_matter(plain, tmp_path):
    path = tmp_path / "flight.bag"
    path.write_bytes(plain.read_bytes())
    assert len(flight.load(path).imu.time) == 400


def test_log_without_messages(logs, tmp_path):
    path = logs.Recording().save(tmp_path / "none.mcap")
    with pytest.raises(LogError, match="no message"):
        flight.load(path)


def test_json_only(logs, tmp_path):
    path = logs.json_log(tmp_path / "json.mcap")
    with pytest.raises(LogError, match="no topic plays a role") as caught:
        flight.load(path)
    assert "/thing" in str(caught.value)
    with pytest.raises(LogError, match="json"):
        flight.load(path, topics={"imu": "/thing"})


def test_a_cut_bag_says_how_to_repair_it(logs, tmp_path):
    path = logs.plain_flight(0.5).save(tmp_path / "log.bag", "bag-")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(LogError, match="reindex"):
        flight.load(path)


def test_hash_is_that_of_the_bytes(plain):
    import hashlib

    assert flight.load(plain).content_hash == hashlib.sha256(plain.read_bytes()).hexdigest()


@pytest.mark.parametrize(("form", "name"), [("mcap-none", "f.mcap"), ("mcap-zstd", "f.mcap"), ("bag-", "f.bag")])
def test_random_damage_gives_a_report_or_one_line(form, name, logs, tmp_path):
    path = logs.plain_flight(0.5).save(tmp_path / name, form)
    whole, rng = path.read_bytes(), np.random.default_rng(7)
    outcomes = set()
    for _ in range(25):
        data = bytearray(whole)
        for place in rng.integers(0, len(data), rng.choice([1, 5, 50])):
            data[place] = rng.integers(256)
        path.write_bytes(data)
        try:
            outcomes.add(type(flight.inspect(path)))
        except LogError as error:
            outcomes.add(str(error).count("\n"))
    assert outcomes <= {flight.Inspection, 0}
    assert flight.Inspection in outcomes


def test_several_writers_of_one_topic_are_one_series(logs, tmp_path):
    from mcap.writer import Writer

    store = logs.typestore(2)
    kind = "geometry_msgs/msg/WrenchStamped"
    path = tmp_path / "two.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        schema = writer.register_schema(kind, "ros2msg", store.generate_msgdef(kind, ros_version=2)[0].encode())
        channels = [writer.register_channel("/command/wrench", "cdr", schema, {"writer": str(i)}) for i in range(2)]
        for i in range(100):
            stamp = logs.START_NS + i * 10_000_000
            fields = {"wrench.force.x": float(i)}
            fields["header.stamp.sec"], fields["header.stamp.nanosec"] = divmod(stamp, 10**9)
            writer.add_message(
                channels[i % 2], stamp, bytes(store.serialize_cdr(logs.message(store, kind, fields), kind)), stamp
            )
        writer.finish()
    np.testing.assert_array_equal(flight.load(path).commanded.wrench_B[:, 0], np.arange(100))
