"""An MCAP file out of arrays: the bytes that `mcap.writer.Writer` gives for the same messages, a whole chunk at once.

A chunk is filled by compiled code, indexed by array operations, and compressed; all other records are those of the
`mcap` package. The specification is its `Writer`, message by message (tests/flight/test_mcap_messages.py compares the
bytes). Format: https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from numba import njit
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

MAGIC = bytes((137, 77, 67, 65, 80, 48, 13, 10))
LEVEL = 1
"""Of zstd. Its default, 3, takes twice the time on numbers that hardly repeat, and its files are not smaller."""
CHUNK_SIZE = 1024 * 1024
"""A chunk ends with the message that brings it beyond this [bytes]."""
HEAD = 31
"""Bytes of a message record before its payload: opcode 1, length 8, channel 2, sequence 4, two times of 8."""


@dataclass(frozen=True)
class Messages:
    """One topic: N messages at `stamps` (N,) [ns] of one `type`, `definition` its text.

    Every payload is `template` (length,), CDR, with bytes of its own in some places: `varying` (N, V), of which
    `spans` (S, 3) say what goes where: first byte in `varying`, first byte in the payload, number of bytes.
    """

    topic: str
    type: str
    definition: str
    stamps: Ints
    template: Bytes
    varying: Bytes
    spans: Ints

    @property
    def payloads(self) -> Bytes:
        """All of them (N, length): what `placed` puts together, in plain numpy."""
        rows = np.repeat(self.template[None], len(self.stamps), axis=0)
        for source, target, size in self.spans.tolist():
            rows[:, target : target + size] = self.varying[:, source : source + size]
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
        self._indices: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._compressor = zstandard.ZstdCompressor(level=LEVEL)

    def write(self, every: Sequence[Messages], library: str, metadata: tuple[str, Mapping[str, str]] | None) -> None:
        self._stream.write(MAGIC)
        self._put(Header(profile="ros2", library=library))
        number, index, stamps = _in_order([m.stamps for m in every])
        sizes = HEAD + np.array([len(m.template) for m in every], dtype=np.int64)
        records = RecordBuilder()
        for n, channel in enumerate(self._channels):
            if all(channel.schema_id != before.schema_id for before in self._channels[:n]):
                self._schemas[channel.schema_id - 1].write(records)
            channel.write(records)
        before, whole, start = _bytes(records), True, 0
        self._room = np.empty(len(before) + CHUNK_SIZE + int(sizes.max(initial=0)), dtype=np.uint8)
        ends = np.cumsum(sizes[number]) if len(number) else np.zeros(0, dtype=np.int64)
        while start < len(number):
            room = CHUNK_SIZE - len(before) + (int(ends[start - 1]) if start else 0)
            stop = int(np.searchsorted(ends, room, side="right")) + 1
            whole, stop = stop <= len(number), min(stop, len(number))
            if not whole and metadata is not None:
                self._remark(*metadata)
                metadata = None
            part = slice(start, stop)
            self._chunk(before, every, number[part], index[part], stamps[part], sizes)
            before, start = b"", stop
        if metadata is not None:
            self._remark(*metadata)
        self._put(DataEnd(data_section_crc=0))
        self._summary(stamps)

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
        self, before: bytes, every: Sequence[Messages], number: Ints, index: Ints, stamps: Ints, sizes: Ints
    ) -> None:
        """One chunk and the indices of its messages."""
        lengths = sizes[number]
        places = len(before) + np.cumsum(lengths) - lengths
        records = self._room[: int(places[-1] + lengths[-1])]
        records[: len(before)] = np.frombuffer(before, dtype=np.uint8)
        topics, starts, entries, rows = by_topic(number, index, stamps, places, len(every))
        ours = [(int(k), slice(int(a), int(b))) for k, a, b in zip(topics, starts[:-1], starts[1:], strict=True)]
        for topic, mine in ours:
            m = every[topic]
            placed(records, entries[mine], rows[mine], topic + 1, m.template, m.varying, m.spans)
            self._counts[topic + 1] = self._counts.get(topic + 1, 0) + mine.stop - mine.start
        data = self._compressor.compress(records.data)
        span = int(stamps.min()), int(stamps.max())
        start, builder = self._stream.tell(), RecordBuilder()
        said = {"message_start_time": span[0], "message_end_time": span[1], "uncompressed_size": len(records)}
        Chunk(compression="zstd", data=data, uncompressed_crc=zlib.crc32(records.data), **said).write(builder)
        length = self._stream.write(_bytes(builder))
        offsets, indices = {}, bytearray()
        for topic, mine in ours:
            offsets[topic + 1] = start + length + len(indices)
            packed = entries[mine].astype("<i8", copy=False).tobytes()
            size = len(packed)
            indices += struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + size, topic + 1, size) + packed
        self._stream.write(indices)
        self._indices.append(
            ChunkIndex(
                chunk_length=length,
                chunk_start_offset=start,
                compression="zstd",
                compressed_size=len(data),
                message_index_length=len(indices),
                message_index_offsets=offsets,
                **said,
            )
        )

    def _summary(self, stamps: Ints) -> None:
        """Everything that a reader needs to find its way, and where it lies."""
        start, builder, offsets = self._stream.tell(), RecordBuilder(), []
        first, last = (int(stamps.min()), int(stamps.max())) if len(stamps) else (0, 0)
        about = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._indices),
            message_count=len(stamps),
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


def _in_order(stamps: Sequence[Ints]) -> tuple[Ints, Ints, Ints]:
    """Topic number, index and stamp of all messages, by time, then by topic."""
    if not stamps:
        return (np.zeros(0, dtype=np.int64),) * 3
    every = np.concatenate(stamps)
    starts = np.cumsum([0, *map(len, stamps)])
    order = np.argsort(every, kind="stable")  # topics come one after the other: equal stamps stay in their order
    number = np.repeat(np.arange(len(stamps), dtype=np.int32), np.diff(starts))
    return taken(order, number, starts, every)


@njit(cache=True, nogil=True)
def taken(order: Ints, number: NDArray[np.int32], starts: Ints, stamps: Ints) -> tuple[Ints, Ints, Ints]:
    """Topic number, index in its topic and stamp of messages in this order; `starts` (T + 1,) of the topics."""
    found, index, times = np.empty_like(order), np.empty_like(order), np.empty_like(order)
    for k in range(len(order)):
        n = order[k]
        found[k], index[k], times[k] = number[n], n - starts[number[n]], stamps[n]
    return found, index, times


@njit(cache=True, nogil=True)
def by_topic(number: Ints, index: Ints, stamps: Ints, places: Ints, topics: int) -> tuple[Ints, Ints, Ints, Ints]:
    """Messages grouped by topic: the topics as they appear (T,), where each begins (T + 1,), and in these groups stamps
    and places (N, 2), and indices (N,). `number` (N,) has the topic of each.
    """  # noqa: D205
    count = np.zeros(topics, dtype=np.int64)
    found, starts = np.empty(topics, dtype=np.int64), np.zeros(topics + 1, dtype=np.int64)
    many = 0
    for n in range(len(number)):
        if count[number[n]] == 0:
            found[many] = number[n]
            many += 1
        count[number[n]] += 1
    at = np.zeros(topics, dtype=np.int64)
    for k in range(many):
        at[found[k]] = starts[k]
        starts[k + 1] = starts[k] + count[found[k]]
    entries, rows = np.empty((len(number), 2), dtype=np.int64), np.empty(len(number), dtype=np.int64)
    for n in range(len(number)):
        here = at[number[n]]
        at[number[n]] += 1
        entries[here, 0], entries[here, 1], rows[here] = stamps[n], places[n], index[n]
    return found[:many], starts[: many + 1], entries, rows


@njit(cache=True, nogil=True)
def placed(
    records: Bytes, entries: Ints, index: Ints, channel: int, template: Bytes, varying: Bytes, spans: Ints
) -> None:
    """Message records of one topic into `records`: stamps and places in `entries` (N, 2), rows `index` (N,).

    Plain form: `mcap.records.Message.write`, of `Messages.payloads`.
    """
    length = len(template)
    for n in range(len(index)):
        stamp, at, row = entries[n, 0], entries[n, 1], index[n]
        records[at] = 5
        for k in range(8):
            records[at + 1 + k] = ((22 + length) >> (8 * k)) & 255
            records[at + 15 + k] = (stamp >> (8 * k)) & 255
            records[at + 23 + k] = (stamp >> (8 * k)) & 255
        for k in range(2):
            records[at + 9 + k] = (channel >> (8 * k)) & 255
        for k in range(4):
            records[at + 11 + k] = (row >> (8 * k)) & 255
        for k in range(length):
            records[at + 31 + k] = template[k]
        for s in range(len(spans)):
            source, target = spans[s, 0], at + 31 + spans[s, 1]
            for k in range(spans[s, 2]):
                records[target + k] = varying[row, source + k]
