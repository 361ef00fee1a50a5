"""Compiled loops over bytes whose content is known, and messages where they lie against messages one by one."""

from io import BytesIO

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag1.reader import Header, ReaderError, read_bytes, read_uint32

from wrenchgap.flight.budget import LIMITS
from wrenchgap.flight.formats import kernels, read_log
from wrenchgap.flight.formats.decode import Decoder, definitions_of
from wrenchgap.flight.formats.message_layouts import Template
from wrenchgap.flight.formats.reader import Channel, Places
from wrenchgap.flight.formats.rosbag1 import IndexedBag, Rosbag1Reader

MANY = settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))


def record(opcode, body):
    return bytes([opcode]) + len(body).to_bytes(8, "little") + body


def message(channel, time, payload):
    numbers = ((channel, 2), (0, 4), (time, 8), (time, 8))
    return record(5, b"".join(value.to_bytes(size, "little") for value, size in numbers) + payload)


SENT = st.tuples(
    st.integers(0, 5),
    st.integers(0, 2**64 - 1) | st.integers(0, 2**62),
    st.binary(max_size=40) | st.just(kernels.ZSTD.to_bytes(4, "little")),
)
"""Channel, log time and payload of a message."""
OTHERS = st.tuples(st.integers(6, 12) | st.just(3), st.binary(max_size=40))
"""Opcode and body of a record that is no message."""


def walked(data, room, start=0):
    """What a walk from `start` notes, and how it ends; schemas and channels (3, 4) are not passed over."""
    places, passed = np.full((4, room), -1), np.ones(256, dtype=bool)
    passed[[3, 4]] = False
    end = kernels.walked(np.frombuffer(data, dtype=np.uint8), start, len(data), passed, places)
    return *end, places


@MANY
@given(parts=st.lists(SENT | OTHERS, max_size=12), cut=st.integers(0, 90), room=st.integers(0, 9))
def test_a_walk_notes_the_messages_that_were_written_up_to_what_it_does_not_read(parts, cut, room):
    whole = [message(*part) if len(part) == 3 else record(*part) for part in parts]
    data = b"".join(whole)[: max(sum(map(len, whole)) - cut, 0)]
    noted, position, why = [], 0, kernels.END
    for part, written in zip(parts, whole, strict=True):
        if position + len(written) > len(data):
            why = kernels.BROKEN if len(data) - position >= 9 else kernels.END
        elif len(part) == 2:
            why = kernels.OTHER if part[0] == 3 else kernels.END
        elif part[1] >= 2**63 or part[2].startswith(b"\x28\xb5\x2f\xfd"):
            why = kernels.OTHER
        elif len(noted) == room:
            why = kernels.FULL
        else:
            noted.append((part[0], part[1], position + len(written) - len(part[2]), len(part[2])))
        if why != kernels.END or position + len(written) > len(data):
            break
        position += len(written)
    count, reached, reason, places = walked(data, room)
    assert (count, reached, reason) == (len(noted), position, why)
    assert [tuple(column) for column in places[:, :count].T.tolist()] == noted
    assert (places[:, count:] == -1).all()


@MANY
@given(parts=st.lists(SENT, max_size=12), changes=st.lists(st.tuples(st.integers(0, 500), st.integers(0, 255))))
def test_a_walk_over_damaged_bytes_stays_within_them_and_can_be_taken_up_where_it_stopped(parts, changes):
    whole = [message(*part) for part in parts]
    data = bytearray(b"".join(whole))
    for place, value in changes:
        if place < len(data):
            data[place] = value
    count, reached, reason, places = walked(bytes(data), 50)
    start, payload = 0, places[:, :count]
    assert (payload[3] >= 0).all()
    assert (payload[2] + payload[3] <= reached).all()
    assert (payload[2, 1:] >= payload[2, :-1] + payload[3, :-1] + 31).all()
    for k in range(count):
        one, start, why, found = walked(bytes(data), 1, start)
        assert (one, why) == (1, kernels.FULL if k < count - 1 or reason == kernels.FULL else reason)
        np.testing.assert_array_equal(found[:, 0], payload[:, k])
    assert start == reached or count == 0


def test_a_walk_stops_at_what_it_does_not_read_and_says_why():
    whole = message(1, 5, b"abcdef")
    places, passed = np.zeros((4, 2), dtype=np.int64), np.zeros(256, dtype=bool)
    for tail, why in (
        (b"", kernels.END),
        (record(3, b""), kernels.OTHER),
        (message(1, 2**63, b""), kernels.OTHER),
        (record(5, bytes(21)), kernels.OTHER),
        (message(1, 2, (kernels.ZSTD).to_bytes(4, "little")), kernels.OTHER),
        (whole * 2, kernels.FULL),
        (whole[:-1], kernels.BROKEN),
        (bytes(20), kernels.BROKEN),
    ):
        data = np.frombuffer(whole + tail, dtype=np.uint8)
        count, position, reason = kernels.walked(data, 0, len(data), passed, places)
        assert (count, reason) == (2 if why == kernels.FULL else 1, why)
        assert position == count * len(whole)
        np.testing.assert_array_equal(places[:, 0], [1, 5, 9 + 22, 6])


@MANY
@given(channels=st.lists(st.integers(0, 4), max_size=30))
def test_groups_are_channels_as_they_first_come_each_in_its_order(channels):
    places = np.arange(4 * (len(channels) + 3), dtype=np.int64).reshape(4, -1)
    places[0, : len(channels)] = channels
    found, ends, rest = kernels.grouped(places, len(channels))
    used = places[:, : len(channels)]
    assert found.tolist() == list(dict.fromkeys(channels))
    assert (ends[0], ends[-1], rest.shape) == (0, len(channels), (3, len(channels)))
    for channel, start, stop in zip(found, ends[:-1], ends[1:], strict=True):
        np.testing.assert_array_equal(rest[:, start:stop], used[1:, used[0] == channel])


@MANY
@given(
    data=st.lists(st.integers(0, 1), min_size=60, max_size=200).map(bytes),
    starts=st.lists(st.tuples(st.integers(0, 40), st.booleans()), max_size=8),
)
def test_numbers_are_copied_of_messages_that_fit_a_layout(data, starts):
    """Of 20 bytes, the first and the two from the fourth on as in the layout; then rows of 8 bytes and 5."""
    first = np.array([s for s, _ in starts], dtype=np.int64)
    lengths = np.array([20 if whole else 19 for _, whole in starts], dtype=np.int64)
    fixed, ranges = np.array([[0, 1], [3, 2], [7, 0]]), np.array([[4, 0, 8], [12, 9, 5]])
    fits, rows = np.zeros(len(starts), dtype=bool), np.full((len(starts) + 2, 16), 7, dtype=np.uint8)
    whole = np.frombuffer(data, dtype=np.uint8)
    count = kernels.copied(whole, first, lengths, fixed, whole[:20], ranges, fits, rows, 1)
    messages = [data[s : s + n] for s, n in zip(first, lengths, strict=True)]
    fitting = [len(m) == 20 and m[0] == data[0] and m[3:5] == data[3:5] for m in messages]
    expected = [m[4:12] + b"\7" + m[12:17] + b"\7\7" for m, fit in zip(messages, fitting, strict=True) if fit]
    assert fits.tolist() == fitting
    assert count == len(expected)
    assert [row.tobytes() for row in rows] == [b"\7" * 16, *expected, *[b"\7" * 16] * (len(rows) - 1 - count)]


def field(name, value):
    return (len(name) + 1 + len(value)).to_bytes(4, "little") + name + b"=" + value


def bag_record(fields, data):
    head = b"".join(field(name, value) for name, value in fields)
    return len(head).to_bytes(4, "little") + head + len(data).to_bytes(4, "little") + data


BAG_MESSAGE = st.permutations([(b"op", b"\x02"), (b"conn", b"\x01\0\0\x02"), (b"time", bytes(range(8)))])
BAG_CONNECTION = st.permutations([(b"op", b"\x07"), (b"conn", b"\x01\0\0\0"), (b"topic", b"/a")])
BAG_ANYTHING = st.lists(
    st.tuples(st.sampled_from([b"op", b"conn", b"time", b"topic"]), st.binary(max_size=8)), max_size=4
)


def walked_bag(data):
    places = np.zeros((6, len(data) // 40 + 2), dtype=np.int64)
    count = kernels.walked_bag(np.frombuffer(data, dtype=np.uint8), places)
    return None if count < 0 else places[:, :count].T.tolist()


def read_by_rosbags(data):
    """The same places by rosbags' reader of records; None where it finds fault."""
    source, found, before = BytesIO(data), [], 0
    while (position := source.tell()) < len(data):
        try:
            header = Header.read(source)
            size = read_uint32(source)
            start = source.tell()
            read_bytes(source, size)
            if header.get_uint8("op") == 2:
                found.append([header.get_uint32("conn"), header.get_time("time"), start, size, position, before])
                before = source.tell()
        except (ReaderError, UnicodeDecodeError):
            return None
    return found


@MANY
@given(st.lists(st.builds(bag_record, BAG_MESSAGE | BAG_CONNECTION, st.binary(max_size=20)), max_size=6))
def test_a_walk_through_a_whole_ros1_chunk_finds_what_rosbags_does(parts):
    data = b"".join(parts)
    found = walked_bag(data)
    assert found is not None
    assert found == read_by_rosbags(data)


@MANY
@given(
    parts=st.lists(
        st.builds(bag_record, BAG_MESSAGE | BAG_CONNECTION | BAG_ANYTHING, st.binary(max_size=20)), max_size=6
    ),
    change=st.tuples(st.integers(0, 300), st.integers(0, 255)),
)
def test_a_walk_through_a_damaged_ros1_chunk_finds_what_rosbags_does_or_doubts(parts, change):
    data = bytearray(b"".join(parts))
    if change[0] < len(data):
        data[change[0]] = change[1]
    found, expected = walked_bag(bytes(data)), read_by_rosbags(bytes(data))
    assert found is None or expected is None or found == expected  # a doubt costs time, never a message


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
    assert len(decoder._packer.found[id(decoder.definitions)]) == LIMITS.layouts
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
