"""A file out of arrays has the bytes of the mcap package's own writer, which is given the messages one by one."""

from dataclasses import replace
from functools import partial
from io import BytesIO
from types import SimpleNamespace

import mcap.writer
import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, Writer

from wrenchgap.flight import mcap_messages
from wrenchgap.flight.mcap_messages import Messages, write_messages

SECOND = 1_000_000_000


@pytest.fixture(autouse=True)
def our_level(monkeypatch):
    """The package's writer has no argument for the level of compression."""
    compress = partial(zstandard.compress, level=1)
    monkeypatch.setattr(mcap.writer, "zstandard", SimpleNamespace(compress=compress))


def payloads(m):
    """All of a topic's (N, length)."""
    rows, varying = np.repeat(m.template[None], len(m.stamps), axis=0), m.varying(0, len(m.stamps))
    for source, target, size in m.spans.tolist():
        rows[:, target : target + size] = varying[:, source : source + size]
    return rows


def message_by_message(every, metadata):
    """The specification: `mcap.writer.Writer`, in the order of time, then of topics."""
    stream = BytesIO()
    writer, schemas, channels = Writer(stream, compression=CompressionType.ZSTD), {}, []
    writer.start(profile="ros2", library="wrenchgap")
    for m in every:
        if m.type not in schemas:
            schemas[m.type] = writer.register_schema(m.type, "ros2msg", m.definition.encode())
        channels.append(writer.register_channel(m.topic, "cdr", schemas[m.type]))
    rows = [payloads(m) for m in every]
    for stamp, topic, index in sorted((int(s), k, n) for k, m in enumerate(every) for n, s in enumerate(m.stamps)):
        writer.add_message(channels[topic], stamp, rows[topic][index].tobytes(), stamp, index)
    if metadata is not None:
        writer.add_metadata(*metadata)
    writer.finish()
    return stream.getvalue()


def topic(name, count, length, period, seed, kind="std_msgs/msg/Float64"):
    rng = np.random.default_rng(seed)
    stamps = 1_700_000_000 * SECOND + (np.arange(count) * period * SECOND).astype(np.int64)
    template, varying = (rng.integers(0, 8, shape, np.uint8) for shape in (length, (count, length // 2)))
    first = length // 2 - length // 4
    spans = np.array([[0, 1, length // 4], [length // 4, 2 + length // 4, first - 2]])
    return Messages(name, kind, f"# {kind}\nfloat64 data\n", stamps, template, lambda a, b: varying[a:b].copy(), spans)


SOME = (topic("/a", 4000, 340, 0.005, 0), topic("/late", 30, 12, 0.2, 1), topic("/b", 2000, 76, 0.01, 2, "pkg/msg/B"))


@pytest.mark.parametrize("metadata", [None, ("wrenchgap", {"command": "replay", "settings": '{"dt": 0.005}'})])
@pytest.mark.parametrize(
    "every",
    [SOME, SOME[:1], (), (topic("/none", 0, 8, 1.0, 3),), (SOME[0], topic("/none", 0, 8, 1.0, 3))],
    ids=["three topics", "one", "no topics", "no messages", "a topic without messages"],
)
def test_bytes_are_those_of_the_writer_of_the_mcap_package(every, metadata):
    stream = BytesIO()
    write_messages(stream, every, "wrenchgap", metadata)
    assert stream.getvalue() == message_by_message(every, metadata)


@pytest.mark.parametrize("count", [1, 2, 3, 1000, 2995, 2996, 2997, 2998])
def test_also_where_a_message_fills_the_chunk_exactly(count):
    """Messages of 350 bytes: around the place where a chunk of 1 MiB is full, and with metadata behind it."""
    every, metadata = (topic("/a", count, 350 - mcap_messages.HEAD, 0.001, 4),), ("wrenchgap", {"a": "b"})
    stream = BytesIO()
    write_messages(stream, every, "wrenchgap", metadata)
    assert stream.getvalue() == message_by_message(every, metadata)


def test_stamps_that_go_backwards_are_put_in_order():
    given = topic("/a", 50, 20, 0.1, 5)
    back = replace(given, stamps=given.stamps[::-1].copy())
    stream = BytesIO()
    write_messages(stream, (back,), "wrenchgap", None)
    assert stream.getvalue() == message_by_message((back,), None)


@pytest.mark.parametrize("piece", [1, 700, 4096])
def test_also_where_topics_share_their_clock_and_come_in_pieces(piece, monkeypatch):
    """Stamps that several topics share, that repeat, and that go backwards over more than a chunk."""
    monkeypatch.setattr(mcap_messages, "PIECE", piece)
    first, second, mixed = (
        topic("/a", 5000, 340, 0.005, 6),
        topic("/b", 5000, 76, 0.005, 7),
        topic("/c", 5000, 48, 1, 8),
    )
    stamps = np.random.default_rng(9).choice(first.stamps[:1000], 5000)
    every = (first, replace(second, stamps=first.stamps), replace(mixed, stamps=stamps), topic("/d", 20, 40, 0.1, 10))
    stream = BytesIO()
    write_messages(stream, every, "wrenchgap", ("wrenchgap", {"a": "b"}))
    assert stream.getvalue() == message_by_message(every, ("wrenchgap", {"a": "b"}))
