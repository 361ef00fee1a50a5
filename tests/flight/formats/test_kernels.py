"""Compiled loops against their plain forms, and messages where they lie against messages one by one."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wrenchgap.flight.formats import kernels, read_log
from wrenchgap.flight.formats.decode import Decoder, definitions_of
from wrenchgap.flight.formats.packed import MOST_TEMPLATES, Template
from wrenchgap.flight.formats.reader import Channel, Places
from wrenchgap.flight.formats.rosbag1 import IndexedBag, Rosbag1Reader

MANY = settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))


def record(opcode, body):
    return bytes([opcode]) + len(body).to_bytes(8, "little") + body


def message(channel, time, payload):
    numbers = ((channel, 2), (0, 4), (time, 8), (time, 8))
    return record(5, b"".join(value.to_bytes(size, "little") for value, size in numbers) + payload)


MESSAGES = st.builds(
    message, st.integers(0, 5), st.integers(0, 2**64 - 1) | st.integers(0, 2**62), st.binary(max_size=40)
)
RECORDS = st.lists(MESSAGES | st.builds(record, st.integers(0, 12), st.binary(max_size=40)), max_size=12)


def both(plain, compiled, *arguments, room):
    """Results of both forms on the same bytes, with the places that each noted."""
    places = [np.zeros((room[0], room[1]), dtype=np.int64) for _ in range(2)]
    found = [plain(*arguments[0], places[0], *arguments[1])]
    data, *rest = arguments[0]
    found.append(compiled(np.frombuffer(data, dtype=np.uint8), *rest, places[1], *arguments[1]))
    return found, places


@MANY
@given(
    parts=RECORDS,
    cut=st.integers(0, 60),
    change=st.tuples(st.integers(0, 500), st.integers(0, 255)),
    room=st.integers(1, 9),
)
def test_a_walk_and_its_plain_form_agree_on_any_bytes(parts, cut, change, room):
    data = bytearray(b"".join(parts))
    data = data[: max(len(data) - cut, 0)] if cut < 20 else data
    if change[0] < len(data):
        data[change[0]] = change[1]
    passed = np.ones(256, dtype=bool)
    passed[[3, 4]] = False
    given_to = (bytes(data), 0, len(data), passed)
    found, places = both(kernels.plainly_walked, kernels.walked, given_to, (0,), room=(4, room))
    assert found[0] == found[1]
    np.testing.assert_array_equal(*places)


def test_a_walk_stops_at_what_it_does_not_read_and_says_why():
    whole = message(1, 5, b"abcdef")
    places, passed = np.zeros((4, 2), dtype=np.int64), np.zeros(256, dtype=bool)
    for tail, why in (
        (b"", kernels.END),
        (record(3, b""), kernels.OTHER),
        (message(1, 2**63, b""), kernels.OTHER),
        (message(1, 2, (kernels.ZSTD).to_bytes(4, "little")), kernels.OTHER),
        (whole * 2, kernels.FULL),
        (whole[:-1], kernels.BROKEN),
        (bytes(20), kernels.BROKEN),
    ):
        data = np.frombuffer(whole + tail, dtype=np.uint8)
        count, position, reason = kernels.walked(data, 0, len(data), passed, places, 0)
        assert (count, reason) == (2 if why == kernels.FULL else 1, why)
        assert position == count * len(whole)
        np.testing.assert_array_equal(places[:, 0], [1, 5, 9 + 22, 6])


@MANY
@given(channels=st.lists(st.integers(0, 4), max_size=30))
def test_grouping_and_its_plain_form_agree(channels):
    places = np.arange(4 * (len(channels) + 3), dtype=np.int64).reshape(4, -1)
    places[0, : len(channels)] = channels
    for plain, compiled in zip(
        kernels.plainly_grouped(places, len(channels)), kernels.grouped(places, len(channels)), strict=True
    ):
        np.testing.assert_array_equal(plain, compiled)


@MANY
@given(
    data=st.binary(min_size=60, max_size=200), starts=st.lists(st.tuples(st.integers(0, 40), st.booleans()), max_size=8)
)
def test_copying_and_its_plain_form_agree(data, starts):
    first = np.array([s for s, _ in starts], dtype=np.int64)
    lengths = np.array([20 if whole else 19 for _, whole in starts], dtype=np.int64)
    expected = np.frombuffer(data[:20], dtype=np.uint8)
    fixed, ranges = np.array([[0, 1], [3, 0]]), np.array([[4, 0, 8], [12, 8, 5]])
    fits = [np.zeros(len(starts), dtype=bool) for _ in range(2)]
    rows = [np.zeros((len(starts) + 2, 16), dtype=np.uint8) for _ in range(2)]
    where = first, lengths, fixed, expected, ranges
    plain = kernels.plainly_copied(data, *where, fits[0], rows[0], 1)
    assert kernels.copied(np.frombuffer(data, dtype=np.uint8), *where, fits[1], rows[1], 1) == plain
    np.testing.assert_array_equal(*fits)
    np.testing.assert_array_equal(*rows)


def field(name, value):
    return (len(name) + 1 + len(value)).to_bytes(4, "little") + name + b"=" + value


def bag_record(fields, data):
    head = b"".join(field(name, value) for name, value in fields)
    return len(head).to_bytes(4, "little") + head + len(data).to_bytes(4, "little") + data


BAG_FIELDS = st.permutations([(b"op", b"\x02"), (b"conn", b"\x01\0\0\0"), (b"time", bytes(range(8)))]) | st.lists(
    st.tuples(st.sampled_from([b"op", b"conn", b"time", b"topic"]), st.binary(max_size=8)), max_size=4
)


@MANY
@given(
    parts=st.lists(st.builds(bag_record, BAG_FIELDS, st.binary(max_size=20)), max_size=6),
    change=st.tuples(st.integers(0, 300), st.integers(0, 255)),
)
def test_a_walk_through_a_ros1_chunk_finds_what_its_plain_form_does_or_doubts(parts, change):
    data = bytearray(b"".join(parts))
    if change[0] < len(data):
        data[change[0]] = change[1]
    found, places = both(
        kernels.plainly_walked_bag, kernels.walked_bag, (bytes(data),), (), room=(6, len(data) // 40 + 2)
    )
    assert found[1] in (found[0], -1)  # a doubt costs time, never a message
    if found[1] >= 0:
        np.testing.assert_array_equal(*places)


WORD = st.sampled_from(["", "a", "bb", "map"])


def mixed(logs, drawn, little=True):
    store, kind = logs.typestore(2), "lab_msgs/msg/Mixed"
    payloads = []
    for i, (name, words, c) in enumerate(drawn):
        fields = {"name": name, "flag": i % 250, "a": i / 7, "b": np.array([i, -i, 3], dtype=np.int16), "words": words}
        fields |= {"c": np.array(c, dtype=np.float32), "d": 2**60 + i}
        payloads.append(bytes(store.serialize_cdr(logs.message(store, kind, fields), kind, little_endian=little)))
    return Channel("/x", kind, "cdr", store.generate_msgdef(kind, ros_version=2)[0]), payloads


def places_of(payloads, gap=b"?"):
    lengths = np.array([len(p) for p in payloads], dtype=np.int64)
    starts = np.cumsum(lengths + len(gap)) - lengths
    return Places(gap + gap.join(payloads), starts, lengths)


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    drawn=st.lists(
        st.tuples(WORD, st.lists(WORD, max_size=2), st.lists(st.floats(width=32), max_size=3)), min_size=1, max_size=40
    ),
    broken=st.sets(st.integers(0, 39), max_size=4),
    pieces=st.integers(1, 3),
    little=st.booleans(),
)
def test_messages_where_they_lie_give_the_columns_of_messages_one_by_one(logs, drawn, broken, pieces, little):
    channel, payloads = mixed(logs, drawn, little)
    payloads = [p[: len(p) // 2] if i in broken else p for i, p in enumerate(payloads)]
    plain, direct = (Decoder(channel, definitions_of(channel)) for _ in range(2))
    for part in np.array_split(np.arange(len(payloads)), pieces):
        few = [payloads[i] for i in part]
        if few:
            plain.add(few)
            direct.add(places_of(few))
    assert (direct.count, direct.malformed) == (plain.count, plain.malformed)
    expected, found = plain.columns(), direct.columns()
    assert set(found) == set(expected)
    for name, values in expected.items():
        assert (found[name].dtype, found[name].shape) == (values.dtype, values.shape)
        assert found[name].tobytes() == values.tobytes()


def test_text_that_changes_with_every_message_does_not_make_layouts_without_end(logs):
    channel, payloads = mixed(logs, [(f"{i:04d}", [], []) for i in range(200)])
    decoder = Decoder(channel, definitions_of(channel))
    decoder.add(places_of(payloads))
    assert len(decoder._packer.found[id(decoder.definitions)]) == MOST_TEMPLATES
    columns = decoder.columns()
    np.testing.assert_array_equal(columns["d"], 2**60 + np.arange(200))
    np.testing.assert_array_equal(columns["name"], [f"{i:04d}".encode() for i in range(200)])


def test_a_template_is_made_of_plain_messages_alone(logs):
    channel, (payload, *_) = mixed(logs, [("a", [], [1.0])])
    known = definitions_of(channel)
    assert Template.of(payload, channel.type, "cdr", known) is not None
    for bad in (b"", b"\0", b"\1" + payload[1:], b"\0\7" + payload[2:], payload[:-9]):
        assert Template.of(bad, channel.type, "cdr", known) is None


def everything(topic, kind, fields):
    return True


def same(left, right):
    assert list(left) == list(right)
    for topic, table in left.items():
        other = right[topic]
        assert table.log_time_ns.tobytes() == other.log_time_ns.tobytes()
        assert {n: v.tobytes() for n, v in table.columns.items()} == {n: v.tobytes() for n, v in other.columns.items()}


@pytest.mark.parametrize("form", ["bag-", "bag-bz2", "bag-lz4"])
def test_a_whole_ros1_bag_is_read_by_chunks_and_carefully_alike(form, logs, tmp_path, monkeypatch):
    path = logs.plain_flight(2.0).save(tmp_path / "log.bag", form)
    with monkeypatch.context() as patch:
        patch.setattr(Rosbag1Reader, "_carefully", lambda *_: pytest.fail("a whole bag was doubted"))
        fast = read_log(path, everything).tables
    monkeypatch.setattr(Rosbag1Reader, "batches", Rosbag1Reader._carefully)
    same(fast, read_log(path, everything).tables)


def test_a_bag_that_is_doubted_in_its_middle_is_read_anew(logs, tmp_path, monkeypatch):
    path = logs.plain_flight(2.0).save(tmp_path / "log.bag", "bag-")
    whole = read_log(path, everything)
    taken = IndexedBag.batches

    def breaking(self, wanted):
        for number, batch in enumerate(taken(self, wanted)):
            if number == 2:
                raise ValueError("odd")
            yield batch

    monkeypatch.setattr(IndexedBag, "batches", breaking)
    again = read_log(path, everything)
    same(whole.tables, again.tables)
    assert again.notes == whole.notes
