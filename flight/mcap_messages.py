"""An MCAP file out of arrays: the bytes that `mcap.writer.Writer` gives for the same messages, a whole chunk at once.

A chunk is filled by compiled code, indexed by array operations, and compressed; all other records are those of the
`mcap` package. No more of the messages is held than `PIECE` of each topic. The specification is its `Writer`, message
by message (tests/flight/test_mcap_messages.py compares the bytes). Format: https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from wrenchgap.flight.formats.kernels import HEAD, Bytes, Ints, grouped, merged, placed

MAGIC = bytes((137, 77, 67, 65, 80, 48, 13, 10))
INDEX = struct.Struct("<BQHI")
"""Head of a message index record: opcode, length, channel, bytes of the pairs that follow."""
STAMPED = np.dtype([("sequence", "<u4"), ("log_time", "<i8"), ("publish_time", "<i8")])
"""The part of a message record's head that differs from message to message, up to the payload."""
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


def write_messages(
    stream: IO[bytes], every: Sequence[Messages], library: str, metadata: tuple[str, Mapping[str, str]] | None
) -> None:
    """All messages by time, then by topic; a message's sequence is its place in its topic.

    Like `Writer`, the metadata comes before the chunk that the last message does not fill.
    """
    _File(stream, every).write(library, metadata)


class _File:
    """What the summary of a file needs to know of its chunks, gathered as they are written."""

    def __init__(self, stream: IO[bytes], every: Sequence[Messages]) -> None:
        self._stream, self._every = stream, every
        definitions = {m.type: m.definition.encode() for m in every}
        schemas = {name: k for k, name in enumerate(definitions, 1)}
        self._schemas = [
            records.Schema(id=k, data=definitions[name], encoding="ros2msg", name=name) for name, k in schemas.items()
        ]
        self._channels = [
            records.Channel(id=k, topic=m.topic, message_encoding="cdr", metadata={}, schema_id=schemas[m.type])
            for k, m in enumerate(every, 1)
        ]
        self._chunks: list[records.ChunkIndex] = []
        self._metadata: list[records.MetadataIndex] = []
        self._counts: Counter[int] = Counter()
        self._compressor = zstandard.ZstdCompressor(level=1)  # 3 takes twice the time, and its files are not smaller

    def write(self, library: str, metadata: tuple[str, Mapping[str, str]] | None) -> None:
        self._stream.write(MAGIC)
        self._put(records.Header(profile="ros2", library=library))
        builder, known = RecordBuilder(), set[int]()
        for channel in self._channels:
            if channel.schema_id not in known:
                self._schemas[channel.schema_id - 1].write(builder)
                known.add(channel.schema_id)
            channel.write(builder)
        before, topics = _bytes(builder), [_Topic(k, m) for k, m in enumerate(self._every, 1)]
        order = _Order(topics)
        self._room = np.empty(len(before) + CHUNK_SIZE + int(order.sizes.max(initial=0)), dtype=np.uint8)
        while order.left:
            count, whole = order.next(len(before))
            if not whole and metadata is not None:
                self._remark(*metadata)
                metadata = None
            self._chunk(before, topics, order.room, count)
            before = b""
        if metadata is not None:
            self._remark(*metadata)
        self._put(records.DataEnd(data_section_crc=0))
        self._summary()

    def _put(self, record: Any) -> int:
        """Write one record; its length."""
        builder = RecordBuilder()
        record.write(builder)
        return self._stream.write(_bytes(builder))

    def _remark(self, name: str, values: Mapping[str, str]) -> None:
        offset = self._stream.tell()
        length = self._put(records.Metadata(name=name, metadata=dict(values)))
        self._metadata.append(records.MetadataIndex(offset=offset, length=length, name=name))

    def _chunk(self, before: bytes, topics: Sequence[_Topic], found: Ints, count: int) -> None:
        """One chunk of the first `count` messages in `found`, which are as `merged` gives them, and their indices."""
        numbers, bounds, grouped_by_topic = grouped(found, count)
        parts = np.split(grouped_by_topic, bounds[1:-1], axis=1)
        ours = list(zip(numbers.tolist(), parts, strict=True))
        data = self._room[: max(int(places[-1]) + len(topics[k].record) for k, (_, _, places) in ours)]
        data[: len(before)] = np.frombuffer(before, dtype=np.uint8)
        for k, (index, _, places) in ours:
            topics[k].place(data, index, places)
            self._counts[k + 1] += len(index)
        chunk = records.Chunk(
            compression="zstd",
            data=self._compressor.compress(data.data),
            message_start_time=int(found[2, 0]),
            message_end_time=int(found[2, count - 1]),
            uncompressed_crc=zlib.crc32(data.data),
            uncompressed_size=len(data),
        )
        offset = self._stream.tell()
        length = self._put(chunk)
        offsets = {}
        for k, (_, stamps, places) in ours:
            offsets[k + 1] = self._stream.tell()
            pairs = np.stack((stamps, places), axis=1).astype("<i8", copy=False).tobytes()
            self._stream.write(INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(pairs), k + 1, len(pairs)) + pairs)
        self._chunks.append(
            records.ChunkIndex(
                chunk_length=length,
                chunk_start_offset=offset,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                message_end_time=chunk.message_end_time,
                message_index_length=self._stream.tell() - offset - length,
                message_index_offsets=offsets,
                message_start_time=chunk.message_start_time,
                uncompressed_size=chunk.uncompressed_size,
            )
        )

    def _summary(self) -> None:
        """Everything that a reader needs to find its way, and where it lies."""
        start, builder, offsets = self._stream.tell(), RecordBuilder(), []
        seen = [m.stamps for m in self._every if len(m.stamps)]
        about = records.Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(map(len, seen)),
            message_end_time=max((int(s.max()) for s in seen), default=0),
            message_start_time=min((int(s.min()) for s in seen), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        groups: dict[Opcode, Sequence[Any]] = {
            Opcode.SCHEMA: self._schemas,
            Opcode.CHANNEL: self._channels,
            Opcode.STATISTICS: [about],
            Opcode.CHUNK_INDEX: self._chunks,
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.METADATA_INDEX: self._metadata,
        }
        for opcode, group in groups.items():
            here = builder.count
            for record in group:
                record.write(builder)
            length = builder.count - here
            offsets.append(records.SummaryOffset(group_opcode=opcode, group_start=start + here, group_length=length))
        where = start + builder.count
        for offset in offsets:
            offset.write(builder)
        data = _bytes(builder)
        crc = zlib.crc32(struct.pack("<BQQQ", Opcode.FOOTER, 20, start, where), zlib.crc32(data))
        self._stream.write(data)
        self._put(records.Footer(summary_start=start, summary_offset_start=where, summary_crc=crc))
        self._stream.write(MAGIC)


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
        size = STAMPED.itemsize
        self._spans = np.vstack(([0, HEAD - size, size], np.add(messages.spans.reshape(-1, 3), [size, HEAD, 0])))
        self._start, self._piece = 0, np.zeros((0, 0), dtype=np.uint8)

    @property
    def stamps(self) -> Ints:
        """Stamps (N,) [ns], rising."""
        return self.messages.stamps if self.order is None else self.messages.stamps[self.order]

    def place(self, records: Bytes, index: Ints, places: Ints) -> None:
        """Put records at `places` (M,); `index` (M,) is where they come in time."""
        rows = index if self.order is None else self.order[index]
        ends = (rows[0], rows[-1]) if self.order is None else (rows.min(), rows.max())
        first, last = int(ends[0]), int(ends[1]) + 1
        if first < self._start or last > self._start + len(self._piece):
            stop = max(last, min(first + PIECE, len(self.messages.stamps)))
            heads = np.empty((stop - first, 1), dtype=STAMPED)
            heads["sequence"][:, 0] = np.arange(first, stop)
            heads["log_time"][:, 0] = heads["publish_time"][:, 0] = self.messages.stamps[first:stop]
            self._start, self._piece = first, np.hstack((heads.view(np.uint8), self.messages.varying(first, stop)))
        placed(records, places, self.record, self._piece, rows - self._start, self._spans)


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
        self.room = np.empty((4, CHUNK_SIZE // HEAD + 2), dtype=np.int64)
        """Topic number, index in its topic, stamp and place of the messages of a chunk."""

    def next(self, before: int) -> tuple[int, bool]:
        """How many messages the next chunk has, of which `before` bytes are taken, and whether they fill it."""
        count, whole = merged(
            self._stamps, self._starts, self._counts, self.sizes, self._done, self._now, before, CHUNK_SIZE, self.room
        )
        self.left -= count
        return count, whole
