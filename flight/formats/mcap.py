"""MCAP files (https://mcap.dev/spec): any compression, chunked or not, indexed or not, whole or cut short.

The file is walked from the front and its index is not used, so that a file that lost its end gives all that it holds.
A record is one byte of opcode, eight of length, then its body; a chunk's body holds compressed records. Where a record
cannot be, the walk goes on at the next chunk: a chunk's lengths and compression contradict each other anywhere else.
"""

import base64
import mmap
import os
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, BinaryIO, ClassVar

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel as ChannelRecord
from mcap.records import Schema
from numpy.typing import NDArray

from wrenchgap.flight.budget import LIMITS, Account
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats.kernels import BROKEN, FULL, LAST_TIME, OTHER, grouped, walked
from wrenchgap.flight.formats.reader import (
    REPLACED,
    Batch,
    Channel,
    Gatherer,
    Places,
    Reader,
    Wanted,
    decompressed,
    normalised_type,
)

Buffer = bytes | memoryview
MAGIC = b"\x89MCAP0\r\n"
_RECORD = struct.Struct("<BQ")  # opcode, length of the body
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, places of the summary and of its offsets, checksum
_STATISTICS = struct.Struct("<QH4I2Q")  # counts of six kinds, first and last log time [ns]; then counts by channel
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CHUNK = struct.Struct("<QQQII")  # start, end, uncompressed size, uncompressed crc, length of the compression's name


SEVERAL = -1
"""Instead of an opcode: messages that are in no chunk."""


@dataclass
class McapReader(Reader):
    """Reads one MCAP file."""

    name: ClassVar[str] = "MCAP"
    expected: ClassVar[str] = "MCAP (.mcap)"
    magic: ClassVar[bytes] = MAGIC

    _schemas: dict[int, Schema] = field(default_factory=dict)
    _channels: dict[int, Channel] = field(default_factory=dict)
    _cut: bool = False
    _gaps: int = 0
    _unknown: Counter[str] = field(default_factory=Counter)
    _damaged_chunks: int = 0
    _orphans: int = 0
    _broken: int = 0
    _walked: int = 0
    _places: NDArray[np.int64] = field(default_factory=lambda: np.empty((4, LIMITS.mcap_messages), dtype=np.int64))

    def batches(self, wanted: Wanted) -> Iterator[Batch]:
        """Walk through the file once, from the front."""
        gathered = Gatherer(self.account)
        with self.path.open("rb", buffering=LIMITS.mcap_piece) as file:
            for opcode, body in self._records(file):
                if opcode == Opcode.CHUNK:
                    yield from self._chunk(self._decompressed(body), wanted, gathered)
                elif opcode == SEVERAL:
                    yield from self._alone(body, wanted, gathered)
                elif opcode == Opcode.DATA_END:
                    break
                else:
                    yield from self._safely(opcode, body, wanted, gathered)
            else:
                self._cut = True
        yield from gathered.flush()
        if self._unknown and not gathered.total:
            raise LogError(
                f"{self.path}: chunks compressed with {' and '.join(map(repr, self._unknown))}, expected none, lz4 or "
                "zstd; rewrite it with `mcap compress`"
            )
        self._report()

    def _records(self, file: BinaryIO) -> Iterator[tuple[int, bytes]]:
        """Opcode and body of each record of the file; of a chunk at the end that was cut, what there is of it.

        What is written behind the end that the file has now is not waited for. Messages that are in no chunk come
        several at once, of which `_alone` says how many bytes are messages; where those are few, the next come by one.
        """
        alone = 0
        size, position, header = os.fstat(file.fileno()).st_size, file.seek(len(MAGIC)), _RECORD.size
        while position + header <= size:
            opcode, length = _RECORD.unpack(file.read(header).ljust(header, b"\0"))
            start, stop = position + header, position + header + length
            self.account.check_time()
            if opcode == Opcode.MESSAGE and alone <= 0:
                file.seek(position)
                yield SEVERAL, file.read(min(LIMITS.mcap_piece, size - position))
                alone = 0 if self._walked > LIMITS.mcap_piece // 4 else LIMITS.mcap_alone
                position = file.seek(position + self._walked)
                continue
            if opcode and stop <= size:
                alone -= 1
                if opcode in _READ:
                    self.account.ask(length, "a record")
                    yield opcode, file.read(length)
                position = file.seek(stop)
                continue
            if os.fstat(file.fileno()).st_size < size:
                raise LogError(f"{self.path}: {REPLACED}")
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                following = min(_next_chunk(data, start), size)
            if following < size:
                self._gaps += 1
            else:
                self._cut = True
            if opcode == Opcode.CHUNK:
                yield opcode, file.read(min(following - start, LIMITS.mcap_chunk))
            position = file.seek(following)

    def _alone(self, records: bytes, wanted: Wanted, gathered: Gatherer) -> Iterator[Batch]:
        """The messages with which bytes of the file begin, where they lie; the first odd one ends them."""
        data, why, self._walked = np.frombuffer(records, dtype=np.uint8), FULL, 0
        while why == FULL:
            count, self._walked, why = walked(data, self._walked, len(records), _NONE_PASSED, self._places)
            yield from self._found(records, count, wanted, gathered)

    def _chunk(self, records: bytes, wanted: Wanted, gathered: Gatherer) -> Iterator[Batch]:
        """The messages of a chunk where they lie; records of another kind, and messages that are odd, one by one."""
        data, position, size = np.frombuffer(records, dtype=np.uint8), 0, len(records)
        why = OTHER
        while why in (OTHER, FULL):
            count, position, why = walked(data, position, size, _PASSED, self._places)
            yield from self._found(records, count, wanted, gathered)
            if why == OTHER:
                opcode, length = _RECORD.unpack_from(records, position)
                start = position + _RECORD.size
                position = start + length
                yield from self._safely(opcode, records[start:position], wanted, gathered)
        self._broken += why == BROKEN

    def _found(self, records: bytes, count: int, wanted: Wanted, gathered: Gatherer) -> Iterator[Batch]:
        """What a walk found, channel by channel."""
        if not count:
            return
        identifiers, bounds, (times, starts, lengths) = grouped(self._places, count)
        for identifier, first, stop in zip(
            identifiers.tolist(), bounds[:-1].tolist(), bounds[1:].tolist(), strict=True
        ):
            channel = self._channels.get(identifier)
            if channel is None:
                self._orphans += stop - first
                continue
            rows = slice(first, stop)
            payloads = Places(records, starts[rows], lengths[rows]) if wanted(channel) else None
            yield from gathered.direct(channel, times[rows], payloads)

    def _safely(self, opcode: int, body: bytes, wanted: Wanted, gathered: Gatherer) -> Iterator[Batch]:
        try:
            yield from self._take(opcode, body, wanted, gathered)
        except (struct.error, UnicodeDecodeError, EndOfFile, zstandard.ZstdError):
            self._broken += 1

    def _take(self, opcode: int, body: bytes, wanted: Wanted, gathered: Gatherer) -> Iterator[Batch]:
        if opcode == Opcode.MESSAGE:
            identifier, _, log_time_ns, _ = _MESSAGE.unpack_from(body)
            channel = self._channels.get(identifier)
            if channel is None or log_time_ns > LAST_TIME:
                self._orphans += 1
                return
            payload = decompressed(body[_MESSAGE.size :]) if wanted(channel) else b""
            yield from gathered.add(channel, log_time_ns, payload)
        elif opcode == Opcode.SCHEMA:
            self.account.take(len(body) + LIMITS.mcap_record, "schemas")
            schema = Schema.read(ReadDataStream(BytesIO(body)))
            self._schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            self.account.take(len(body) + LIMITS.mcap_record, "channels")
            record = ChannelRecord.read(ReadDataStream(BytesIO(body)))
            self._channels[record.id] = self._channel(record)

    def _channel(self, record: ChannelRecord) -> Channel:
        schema = self._schemas.get(record.schema_id)
        if schema is None:
            return Channel(record.topic, "unknown", record.message_encoding)
        text = schema.data.decode(errors="replace") if schema.encoding in _DEFINITIONS else None
        if schema.encoding == "protobuf":  # a description in bytes
            text = base64.b64encode(schema.data).decode()
        return Channel(
            record.topic,
            normalised_type(schema.name),
            record.message_encoding,
            text or None,
            _DEFINITIONS.get(schema.encoding, "msg"),
        )

    def _decompressed(self, body: bytes) -> bytes:
        """The records of a chunk; of one that was cut, as many as there are; of a damaged one, none."""
        if len(body) < _CHUNK.size:
            return b""
        _, _, size, crc, name_length = _CHUNK.unpack_from(body)
        start = _CHUNK.size + name_length
        compression = body[_CHUNK.size : start].decode(errors="replace")
        if compression not in _DECOMPRESS:
            self._unknown[compression[:12]] += 1
            return b""
        if len(body) < start + 8:
            return b""
        (length,) = struct.unpack_from("<Q", body, start)
        complete = len(body) >= start + 8 + length
        most = min(size, LIMITS.mcap_chunk)
        self.account.ask(len(body) + 2 * most, "a chunk")
        inside = memoryview(body)[start + 8 : start + 8 + length]
        records = (_at_once(compression, inside, most) if complete else b"") or _DECOMPRESS[compression](inside, most)
        right = len(records) == size and (not crc or zlib.crc32(records) == crc)
        if len(records) > most or (complete and not right):
            self._damaged_chunks += 1
            return b""
        return records

    def _report(self) -> None:
        if self._cut:
            self.damage.append(f"{self.path.name} is cut short (no end record): read as far as it goes.")
        unknown = " and ".join(map(repr, self._unknown))
        for count, kind, fate in (
            (self._gaps, "place(s)", "are damaged: left out up to the next chunk."),
            (self._unknown.total(), "chunk(s)", f"are compressed with {unknown}, or damaged: left out."),
            (self._damaged_chunks, "chunk(s)", "are damaged (checksum) and left out."),
            (self._broken, "record(s)", "are damaged: left out."),
            (self._orphans, "message(s)", "belong to no channel or time: left out."),
        ):
            if count:
                self.damage.append(f"{count} {kind} of {self.path.name} {fate}")


def time_range(file: BinaryIO, account: Account) -> tuple[int, int] | None:
    """First and last log time [ns] by the statistics in the summary of a file, where it has them.

    Of the records that its footer points at the lengths alone are looked at: it may point at a chunk, which unfolds.
    Raises OSError or struct.error where the file is cut, BudgetError where there is no end of records.
    """
    file.seek(-(_FOOTER.size + len(MAGIC)), os.SEEK_END)
    opcode, _, position, _, _ = _FOOTER.unpack(file.read(_FOOTER.size))
    end = file.tell() - _FOOTER.size
    while opcode == Opcode.FOOTER and 0 < position < end:
        account.check_time()
        file.seek(position)
        kind, length = _RECORD.unpack(file.read(_RECORD.size))
        if kind == Opcode.STATISTICS:
            *_, first, last = _STATISTICS.unpack(file.read(_STATISTICS.size))
            return first, last
        position += _RECORD.size + length
    return None


def _next_chunk(data: mmap.mmap | bytes, start: int) -> int:
    """Where the next chunk begins; the end of the data where there is none."""
    header, size = _RECORD.size, len(data)
    place = data.find(_CHUNK_OPCODE, start)
    while place >= 0 and place + header + _CHUNK.size <= size:
        length = _RECORD.unpack_from(data, place)[1]
        name_length = _CHUNK.unpack_from(data, place + header)[4]
        name = place + header + _CHUNK.size
        if name_length <= 4 and place + header + length <= size and name + name_length + 8 <= size:
            known = data[name : name + name_length].decode(errors="replace") in _DECOMPRESS
            inside = struct.unpack_from("<Q", data, name + name_length)[0]
            if known and _CHUNK.size + name_length + 8 + inside == length:
                return place
        place = data.find(_CHUNK_OPCODE, place + 1)
    return size


def _at_once(compression: str, data: memoryview, most: int) -> bytes:
    """The records of a whole chunk, in one piece; none where they are not exactly as many bytes as it says."""
    try:
        if compression == "zstd" and zstandard.frame_content_size(data) == most:
            return bytes(zstandard.ZstdDecompressor().decompress(data))
        if compression == "lz4":
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most + 1))
    except (RuntimeError, EOFError, zstandard.ZstdError):
        pass
    return b""


def _unzstd(data: Buffer, most: int) -> bytes:
    """Decompress as far as it goes, and no further than just beyond `most` bytes.

    Small steps where there is an error, because it loses the step that it is met in.
    """
    found = bytearray()
    try:
        with zstandard.ZstdDecompressor().stream_reader(data) as stream:
            while len(found) <= most and (piece := stream.read(LIMITS.mcap_piece)):
                found += piece
    except zstandard.ZstdError:
        return _in_steps(zstandard.ZstdDecompressor().decompressobj, data, most, 1024)
    return bytes(found)


def _in_steps(make: Callable[[], Any], data: Buffer, most: int, step: int) -> bytes:
    """Decompress step by step, as far as it goes, and no further than just beyond `most` bytes."""
    found, decompressor = bytearray(), make()
    try:
        for start in range(0, len(data), step):
            found += decompressor.decompress(data[start : start + step])
            if len(found) > most:
                break
    except (RuntimeError, EOFError, zstandard.ZstdError):
        pass
    return bytes(found)


def _unlz4(data: Buffer, most: int) -> bytes:
    make = lz4.frame.LZ4FrameDecompressor
    return _in_steps(make, data, most, LIMITS.mcap_piece) or _in_steps(make, data, most, 1024)


_READ = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.DATA_END})
"""Records that are read; an attachment may be larger than the log."""
_PASSED = np.ones(256, dtype=np.bool_)
_PASSED[[Opcode.SCHEMA, Opcode.CHANNEL]] = False
"""Records within a chunk that are passed over."""
_NONE_PASSED = np.zeros(256, dtype=np.bool_)
_CHUNK_OPCODE = bytes([Opcode.CHUNK])
_DECOMPRESS: dict[str, Callable[[Buffer, int], bytes]] = {
    "": lambda data, most: bytes(data[: most + 1]),
    "zstd": _unzstd,
    "lz4": _unlz4,
}
_DEFINITIONS = {"ros2msg": "msg", "ros1msg": "msg", "ros2idl": "idl", "jsonschema": "jsonschema"}
