"""An MCAP file out of arrays: the bytes that `mcap.writer.Writer` gives for the same messages, a whole chunk at once.

A chunk is filled by compiled code, indexed by array operations, and compressed; all other records are those of the
`mcap` package. No more of the messages is held than `PIECE` of each topic. The specification is its `Writer`, message
by message (tests/flight/test_mcap_messages.py compares the bytes). Format: https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from wrenchgap.flight.formats.kernels import HEAD, Bytes, Ints, by_topic, merged, placed

MAGIC = bytes((137, 77, 67, 65, 80, 48, 13, 10))
ZSTD = b"zstd"
CHUNK = struct.Struct("<BQQQQII4sQ")
"""Head of a chunk record: opcode, length; first and last time, size, checksum; compression; compressed size."""
INDEX = struct.Struct("<BQHI")
"""Head of a message index record: opcode, length, channel, bytes of the pairs that follow."""
CHUNK_SIZE = 1024 * 1024
"""A chunk ends with the message that brings it beyond this [bytes]."""
PIECE = 4096
"""Messages of a topic whose bytes are made at a time."""


@dataclass(frozen=True)
class Messages:
    """One topic: N messages at `stamps` (N,) [ns] of one `type`, `definition` its text.

    Every payload is `template` (length,), CDR, with bytes of its own in some places: `varying(start, stop)`
    (stop - start, V), of which `spans` (S, 3) say what goes where: first byte in `varying`, first byte in the payload,
    number of bytes.
    """

    topic: str
    type: str
    definition: str
    stamps: Ints
    template: Bytes
    varying: Callable[[int, int], Bytes]
    spans: Ints

    @property
    def payloads(self) -> Bytes:
        """All of them (N, length): what `placed` puts together, in plain numpy."""
        rows = np.repeat(self.template[None], len(self.stamps), axis=0)
        varying = self.varying(0, len(rows))
        for source, target, size in self.spans.tolist():
            rows[:, target : target + size] = varying[:, source : source + size]
        return rows


def write_messages(
    stream: IO[bytes], every: Sequence[Messages], library: str, metadata: tuple[str, Mapping[str, str]] | None
) -> None:
    """All messages by time, then by topic; a message's sequence is its place in its topic."""
    names = list(dict.fromkeys(m.type for m in every))
    definitions = {m.type: m.definition for m in every}
    schemas = [Schema(id=k, data=definitions[n].encode(), encoding="ros2msg", name=n) for k, n in enumerate(names, 1)]
    channels = [
        Channel(id=k, topic=m.topic, message_encoding="cdr", metadata={}, schema_id=names.index(m.type) + 1)
        for k, m in enumerate(every, 1)
    ]
    _File(stream, schemas, channels).write(every, library, metadata)


class _File:
    """What the summary of a file needs to know of its chunks, gathered as they are written."""

    def __init__(self, stream: IO[bytes], schemas: list[Schema], channels: list[Channel]) -> None:
        self._stream, self._schemas, self._channels = stream, schemas, channels
        self._indices: list[bytes] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._compressor = zstandard.ZstdCompressor(level=1)  # 3 takes twice the time, and its files are not smaller

    def write(self, every: Sequence[Messages], library: str, metadata: tuple[str, Mapping[str, str]] | None) -> None:
        self._stream.write(MAGIC)
        self._put(Header(profile="ros2", library=library))
        records = RecordBuilder()
        for n, channel in enumerate(self._channels):
            if all(channel.schema_id != before.schema_id for before in self._channels[:n]):
                self._schemas[channel.schema_id - 1].write(records)
            channel.write(records)
        before, topics = _bytes(records), [_Topic(k, m) for k, m in enumerate(every, 1)]
        order = _Order(topics)
        self._room = np.empty(len(before) + CHUNK_SIZE + int(order.sizes.max(initial=0)), dtype=np.uint8)
        while order.left:
            whole, number, index, stamps, places = order.next(len(before))
            if not whole and metadata is not None:
                self._remark(*metadata)
                metadata = None
            span = int(stamps[0]), int(stamps[-1])
            self._chunk(before, topics, by_topic(number, index, stamps, places, len(topics)), span)
            before = b""
        if metadata is not None:
            self._remark(*metadata)
        self._put(DataEnd(data_section_crc=0))
        self._summary(every)

    def _put(self, record: Header | Metadata | DataEnd) -> int:
        """Write one record; its length."""
        records = RecordBuilder()
        record.write(records)
        return self._stream.write(_bytes(records))

    def _remark(self, name: str, values: Mapping[str, str]) -> None:
        """The metadata: like `Writer`, before the chunk that the last message does not fill."""
        offset = self._stream.tell()
        length = self._put(Metadata(name=name, metadata=dict(values)))
        self._metadata.append(MetadataIndex(offset=offset, length=length, name=name))

    def _chunk(
        self, before: bytes, topics: Sequence[_Topic], grouped: tuple[Ints, Ints, Ints, Ints], span: tuple[int, int]
    ) -> None:
        """One chunk and the indices of its messages, grouped as `by_topic` does it; `span` has first and last stamp."""
        numbers, starts, entries, rows = grouped
        ours = [(int(k), slice(int(a), int(b))) for k, a, b in zip(numbers, starts[:-1], starts[1:], strict=True)]
        size = max(int(entries[mine.stop - 1, 1]) + len(topics[k].record) for k, mine in ours)
        records = self._room[:size]
        records[: len(before)] = np.frombuffer(before, dtype=np.uint8)
        for topic, mine in ours:
            topics[topic].place(records, entries[mine], rows[mine])
            self._counts[topic + 1] = self._counts.get(topic + 1, 0) + mine.stop - mine.start
        data = self._compressor.compress(records.data)
        about = *span, len(records), zlib.crc32(records.data), len(ZSTD), ZSTD, len(data)
        offset, length = self._stream.tell(), CHUNK.size + len(data)
        self._stream.write(CHUNK.pack(Opcode.CHUNK, length - 9, *about))
        self._stream.write(data)
        places, indices, at = list[int](), list[bytes](), offset + length
        for topic, mine in ours:
            places += topic + 1, at
            packed = entries[mine].astype("<i8", copy=False).tobytes()
            size = len(packed)
            indices += INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, topic + 1, size), packed
            at += INDEX.size + size
        self._stream.write(b"".join(indices))
        said = struct.pack("<QQQQI", *span, offset, length, 10 * len(ours)) + struct.pack(
            f"<{len(ours) * 'HQ'}", *places
        )
        said += struct.pack("<QI4sQQ", at - offset - length, len(ZSTD), ZSTD, len(data), len(records))
        self._indices.append(struct.pack("<BQ", Opcode.CHUNK_INDEX, len(said)) + said)

    def _summary(self, every: Sequence[Messages]) -> None:
        """Everything that a reader needs to find its way, and where it lies."""
        start, builder, offsets = self._stream.tell(), RecordBuilder(), []
        seen = [m.stamps for m in every if len(m.stamps)]
        first, last = min((int(s.min()) for s in seen), default=0), max((int(s.max()) for s in seen), default=0)
        about = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._indices),
            message_count=sum(map(len, seen)),
            message_end_time=last,
            message_start_time=first,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        groups: dict[Opcode, Sequence[Any]] = {
            Opcode.SCHEMA: self._schemas,
            Opcode.CHANNEL: self._channels,
            Opcode.STATISTICS: [about],
            Opcode.CHUNK_INDEX: self._indices,
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.METADATA_INDEX: self._metadata,
        }
        for opcode, records in groups.items():
            here = builder.count
            for record in records:
                if isinstance(record, bytes):
                    builder.write(record)
                else:
                    record.write(builder)
            offsets.append(
                SummaryOffset(group_opcode=opcode, group_start=start + here, group_length=builder.count - here)
            )
        where = start + builder.count
        for offset in offsets:
            offset.write(builder)
        data = _bytes(builder)
        crc = zlib.crc32(struct.pack("<BQQQ", Opcode.FOOTER, 20, start, where), zlib.crc32(data))
        Footer(summary_start=start, summary_offset_start=where, summary_crc=crc).write(builder)
        self._stream.write(data + _bytes(builder) + MAGIC)


def _bytes(builder: RecordBuilder) -> bytes:
    """What was written to it."""
    return bytes(builder.end())  # type: ignore[no-untyped-call]


class _Topic:
    """The records of a topic: all that they share, and what varies, a piece at a time."""

    def __init__(self, channel: int, messages: Messages) -> None:
        self.messages, stamps = messages, messages.stamps
        self.order = None if np.all(stamps[1:] >= stamps[:-1]) else np.argsort(stamps, kind="stable")
        head = struct.pack("<BQHIQQ", Opcode.MESSAGE, HEAD - 9 + len(messages.template), channel, 0, 0, 0)
        self.record = np.concatenate((np.frombuffer(head, dtype=np.uint8), messages.template))
        self._start, self._piece = 0, np.zeros((0, 0), dtype=np.uint8)

    @property
    def stamps(self) -> Ints:
        """Stamps (N,) [ns], rising."""
        return self.messages.stamps if self.order is None else self.messages.stamps[self.order]

    def place(self, records: Bytes, entries: Ints, index: Ints) -> None:
        """Put records with stamps and places `entries` (M, 2) there; `index` (M,) is where they come in time."""
        rows = index if self.order is None else self.order[index]
        ends = (rows[0], rows[-1]) if self.order is None else (rows.min(), rows.max())
        first, last = int(ends[0]), int(ends[1]) + 1
        if first < self._start or last > self._start + len(self._piece):
            stop = max(last, min(first + PIECE, len(self.messages.stamps)))
            self._start, self._piece = first, self.messages.varying(first, stop)
        placed(records, entries, rows, self.record, self._piece, self._start, self.messages.spans)


class _Order:
    """Messages of all topics by time, then by topic, a chunk at a time."""

    def __init__(self, topics: Sequence[_Topic]) -> None:
        every = [topic.stamps for topic in topics]
        apart = list({id(stamps): stamps for stamps in every}.values())
        places = dict(zip(map(id, apart), np.cumsum([0, *map(len, apart)]).tolist(), strict=False))
        self._stamps = np.concatenate(apart) if apart else np.zeros(0, dtype=np.int64)
        self._starts = np.array([places[id(stamps)] for stamps in every], dtype=np.int64)
        self._counts = np.array([len(stamps) for stamps in every], dtype=np.int64)
        self.sizes = np.array([len(topic.record) for topic in topics], dtype=np.int64)
        self.left = int(self._counts.sum())
        self._done, self._now = np.zeros(len(topics), dtype=np.int64), np.array([0, len(topics)], dtype=np.int64)
        self._room = np.empty((4, CHUNK_SIZE // HEAD + 2), dtype=np.int64)

    def next(self, before: int) -> tuple[bool, Ints, Ints, Ints, Ints]:
        """Whether a message fills the next chunk, of which `before` bytes are taken; topic number, index in its topic,
        stamp and place of its messages.
        """  # noqa: D205
        count, whole = merged(
            self._stamps, self._starts, self._counts, self.sizes, self._done, self._now, before, CHUNK_SIZE, self._room
        )
        self.left -= count
        number, index, stamps, places = self._room[:, :count]
        return whole, number, index, stamps, places
