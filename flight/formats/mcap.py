"""MCAP files (https://mcap.dev/spec): any compression, chunked or not, indexed or not, whole or cut short.

The file is walked from the front and its index is not used, so that a file that lost its end gives all that it holds.
A record is one byte of opcode, eight of length, then its body; a chunk's body holds compressed records.
"""

from __future__ import annotations

import base64
import mmap
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from typing import ClassVar

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel as ChannelRecord
from mcap.records import Schema

from wrenchgap.flight.errors import LogError
from wrenchgap.flight.formats.reader import Batch, Channel, Gatherer, Reader, Wanted, normalised_type, plain_payload

LAST_TIME = 2**63 - 1  # ns, in the year 2262
MAGIC = b"\x89MCAP0\r\n"
_RECORD = struct.Struct("<BQ")  # opcode, length of the body
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CHUNK = struct.Struct("<QQQII")  # start, end, uncompressed size, uncompressed crc, length of the compression's name


@dataclass
class McapReader(Reader):
    """Reads one MCAP file."""

    name: ClassVar[str] = "MCAP"
    magic: ClassVar[bytes] = MAGIC

    _schemas: dict[int, Schema] = field(default_factory=dict)
    _channels: dict[int, Channel] = field(default_factory=dict)
    _cut: bool = False
    _damaged_chunks: int = 0
    _orphans: int = 0
    _broken: int = 0

    def batches(self, wanted: Wanted) -> Iterator[Batch]:
        """Walk through the file once, from the front."""
        gathered = Gatherer()
        with self.path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            for opcode, body in self._records(data, len(MAGIC)):
                if opcode == Opcode.CHUNK:
                    chunk = self._decompressed(body)
                    for inner_opcode, inner in self._records(chunk, 0):
                        yield from self._safely(inner_opcode, inner, wanted, gathered)
                elif opcode == Opcode.DATA_END:
                    break
                else:
                    yield from self._safely(opcode, body, wanted, gathered)
            else:
                self._cut = True
        yield from gathered.flush()
        self._report()

    def _records(self, data: bytes | mmap.mmap, position: int) -> Iterator[tuple[int, bytes]]:
        """Opcode and body of each record; of a chunk at the end that was cut, what there is of it."""
        size, unpack, header = len(data), _RECORD.unpack_from, _RECORD.size
        while position + header <= size:
            opcode, length = unpack(data, position)
            start = position + header
            position = start + length
            if position > size:
                self._cut = True
                if opcode == Opcode.CHUNK:
                    yield opcode, data[start:size]
                return
            yield opcode, data[start:position]

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
            payload = plain_payload(body[_MESSAGE.size :]) if wanted(channel) else b""
            yield from gathered.add(channel, log_time_ns, payload)
        elif opcode == Opcode.SCHEMA:
            schema = Schema.read(ReadDataStream(BytesIO(body)))
            self._schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
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
            raise LogError(
                f"{self.path}: chunk compressed with {compression!r}, expected none, lz4 or zstd; "
                "rewrite it with `mcap compress`"
            )
        if len(body) < start + 8:
            return b""
        (length,) = struct.unpack_from("<Q", body, start)
        records = _DECOMPRESS[compression](body[start + 8 : start + 8 + length])
        complete = len(body) >= start + 8 + length
        if complete and (len(records) != size or (crc and zlib.crc32(records) != crc)):
            self._damaged_chunks += 1
            return b""
        return records

    def _report(self) -> None:
        if self._cut:
            self.notes.append(f"{self.path.name} is cut short (no end record): read as far as it goes.")
        for count, kind, fate in (
            (self._damaged_chunks, "chunk(s)", "are damaged (checksum) and left out."),
            (self._broken, "record(s)", "are damaged: left out."),
            (self._orphans, "message(s)", "belong to no channel or time: left out."),
        ):
            if count:
                self.notes.append(f"{count} {kind} of {self.path.name} {fate}")


def _unzstd(data: bytes) -> bytes:
    """Decompress as far as it goes; small steps, because an error loses the step that it is met in."""
    try:
        with zstandard.ZstdDecompressor().stream_reader(data) as stream:
            whole = stream.readall()
    except zstandard.ZstdError:
        return _in_steps(zstandard.ZstdDecompressor().decompressobj(), data, zstandard.ZstdError)
    return bytes(whole)


def _unlz4(data: bytes) -> bytes:
    try:
        return bytes(lz4.frame.decompress(data))
    except (RuntimeError, EOFError):
        return _in_steps(lz4.frame.LZ4FrameDecompressor(), data, RuntimeError)


def _in_steps(decompressor: object, data: bytes, error: type[Exception], step: int = 1024) -> bytes:
    found = bytearray()
    try:
        for start in range(0, len(data), step):
            found += decompressor.decompress(data[start : start + step])  # type: ignore[attr-defined]
    except (error, EOFError):
        pass
    return bytes(found)


_DECOMPRESS: dict[str, Callable[[bytes], bytes]] = {"": bytes, "zstd": _unzstd, "lz4": _unlz4}
_DEFINITIONS = {"ros2msg": "msg", "ros1msg": "msg", "ros2idl": "idl", "jsonschema": "jsonschema"}
