"""Damage that knows the format of a log: records and fields that are well formed and say what cannot be."""

from __future__ import annotations

import sqlite3
import struct
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard

Fault = Callable[[Path, np.random.Generator], None]
Records = list[tuple[int, bytes]]

RECURSIVE = b"lab_msgs/Loop next\nfloat64 x\n" + b"=" * 80 + b"\nMSG: lab_msgs/Loop\nlab_msgs/Loop next\nfloat64 x\n"
DEFINITIONS = (
    RECURSIVE,
    b"float64[2000000000] x",
    b"float64[<=99999999999999999999] x",
    b"geometry_msgs/Vector3[100000000] many",
    b"string[4000000000] words",
    b"float64 x\n" * 20000,
    b"this is no definition at all {{{",
    b"\xff\xfe\x00garbage",
    b"float64 9x\nint128 y\n",
    b"",
    b"=" * 80 + b"\nMSG: \n",
    b"std_msgs/Header header\n" + b"(" * 3000,
)
TYPES = (b"", b"/", b"sensor_msgs/Imu/x/y", b"Loop", b"\xff\xff", b"lab_msgs/Loop", b"a" * 70000)


def _pick(values: tuple[bytes, ...], rng: np.random.Generator) -> bytes:
    return values[int(rng.integers(len(values)))]


# --- MCAP: a magic, records of one byte of opcode and eight of length, a magic (https://mcap.dev/spec)

MAGIC = b"\x89MCAP0\r\n"
SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 3, 4, 5, 6, 15


def records(data: bytes, start: int) -> Records:
    """Records of a valid run."""
    out = []
    while start + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, start)
        if start + 9 + length > len(data):
            break
        out.append((opcode, data[start + 9 : start + 9 + length]))
        start += 9 + length
    return out


def joined(found: Records) -> bytes:
    """The bytes of records."""
    return b"".join(struct.pack("<BQ", opcode, len(body)) + body for opcode, body in found)


def chunk(inner: bytes, compression: bytes = b"", size: int | None = None, crc: int | None = None) -> bytes:
    """The body of a chunk."""
    packed = {b"zstd": zstandard.compress, b"lz4": lz4.frame.compress}.get(compression, bytes)(inner)
    head = struct.pack("<QQQ", 0, 2**62, len(inner) if size is None else size)
    head += struct.pack("<II", zlib.crc32(inner) if crc is None else crc, len(compression))
    return head + compression + struct.pack("<Q", len(packed)) + packed


@cache
def bomb(compression: str, megabytes: int) -> bytes:
    """So many megabytes of zeros, compressed."""
    if compression == "zstd":
        packer = zstandard.ZstdCompressor(level=1).compressobj()
        return b"".join([packer.compress(bytes(2**20)) for _ in range(megabytes)] + [packer.flush()])
    packed = lz4.frame.LZ4FrameCompressor()
    parts = [packed.begin(), *(packed.compress(bytes(2**20)) for _ in range(megabytes)), packed.flush()]
    return b"".join(parts)


def _bomb(compression: bytes, megabytes: int) -> bytes:
    """The body of a chunk that holds one."""
    load = bomb(compression.decode(), megabytes)
    head = struct.pack("<QQQII", 0, 2**62, megabytes * 2**20, 0, len(compression))
    return head + compression + struct.pack("<Q", len(load)) + load


def _unpacked(path: Path) -> Records:
    """All records before the summary, out of their chunks."""
    out: Records = []
    for opcode, body in records(path.read_bytes(), len(MAGIC)):
        if opcode == DATA_END:
            break
        if opcode != CHUNK:
            out.append((opcode, body))
            continue
        (length,) = struct.unpack_from("<I", body, 28)
        kind, packed = body[32 : 32 + length], body[40 + length :]
        if kind == b"zstd":
            packed = zstandard.ZstdDecompressor().decompressobj().decompress(packed)
        elif kind == b"lz4":
            packed = lz4.frame.decompress(packed)
        out += records(packed, 0)
    return out


def _save(path: Path, found: Records) -> None:
    path.write_bytes(MAGIC + joined([*found, (DATA_END, bytes(4))]) + MAGIC)


def _numbers(found: Records, opcode: int) -> list[int]:
    return [i for i, (kind, _) in enumerate(found) if kind == opcode]


def mcap_order(path: Path, rng: np.random.Generator) -> None:
    """Messages in another order, some twice, some gone."""
    found = _unpacked(path)
    messages = [found[i] for i in _numbers(found, MESSAGE)]
    rows = rng.integers(len(messages), size=len(messages)) if rng.random() < 0.5 else rng.permutation(len(messages))
    rest = [record for record in found if record[0] != MESSAGE]
    _save(path, rest + [messages[i] for i in rows])


def mcap_shuffled(path: Path, rng: np.random.Generator) -> None:
    """Records of all kinds in any order: messages before their channel, channels before their schema."""
    found = _unpacked(path)
    _save(path, [found[i] for i in rng.permutation(len(found))])


def mcap_few(path: Path, rng: np.random.Generator) -> None:
    """None, one or two messages are left."""
    found = _unpacked(path)
    keep = set(_numbers(found, MESSAGE)[: int(rng.integers(3))])
    _save(path, [record for i, record in enumerate(found) if record[0] != MESSAGE or i in keep])


def mcap_times(path: Path, rng: np.random.Generator) -> None:
    """Log times that cannot be."""
    found, chosen = _unpacked(path), []
    share = rng.choice([0.02, 0.5, 1.0])
    for opcode, body in found:
        if opcode == MESSAGE and rng.random() < share:
            time = int(rng.choice(np.array([0, 1, 2**63 - 1, 2**63, 2**64 - 1, 10**9], dtype=object)))
            body = body[:6] + struct.pack("<Q", time) + body[14:]
        chosen.append((opcode, body))
    _save(path, chosen)


def mcap_payloads(path: Path, rng: np.random.Generator) -> None:
    """Messages that are too short, too long, compressed, or count more than they hold."""
    found = []
    for opcode, body in _unpacked(path):
        if opcode == MESSAGE and rng.random() < 0.3:
            head, load = body[:22], body[22:]
            kinds = (b"", load[: len(load) // 2], load + bytes(900), bomb("zstd", 3000))
            kinds += (load[:12] + b"\xff\xff\xff\xff" + load[16:], b"\xff" * len(load))
            body = head + kinds[int(rng.integers(len(kinds))) if rng.random() < 0.1 else int(rng.integers(3))]
        found.append((opcode, body))
    _save(path, found)


def mcap_definition(path: Path, rng: np.random.Generator) -> None:
    """A schema that is recursive, has no end, or is none."""
    found = _unpacked(path)
    at = int(rng.choice(_numbers(found, SCHEMA)))
    (number,) = struct.unpack_from("<H", found[at][1])
    name = _pick(TYPES, rng) if rng.random() < 0.4 else b"lab_msgs/msg/Loop"
    form = _pick((b"ros2msg", b"ros1msg", b"ros2idl", b"jsonschema", b"protobuf", b"\xff"), rng)
    text = _pick(DEFINITIONS, rng)
    parts = (len(name).to_bytes(4, "little") + name, len(form).to_bytes(4, "little") + form)
    body = struct.pack("<H", number) + b"".join(parts) + len(text).to_bytes(4, "little") + text
    found[at] = (SCHEMA, body)
    _save(path, found)


def mcap_channel(path: Path, rng: np.random.Generator) -> None:
    """Channels with names, encodings and numbers that cannot be, or one number for two."""
    found = _unpacked(path)
    places = _numbers(found, CHANNEL)
    at = int(rng.choice(places))
    (number,) = struct.unpack_from("<H", found[int(rng.choice(places))][1])
    (schema,) = struct.unpack_from("<H", found[at][1], 2)
    topic = _pick((b"", b"/imu", b"\xff", b"x" * 100_000, b"/odometry", b"\n", b"/a b"), rng)
    form = _pick((b"cdr", b"ros1", b"json", b"protobuf", b"cbor", b""), rng)
    body = struct.pack("<HH", number, schema if rng.random() < 0.5 else 0)
    for text in (topic, form):
        body += len(text).to_bytes(4, "little") + text
    found[at] = (CHANNEL, body + bytes(4))
    _save(path, found)


def mcap_chunk(path: Path, rng: np.random.Generator) -> None:
    """A chunk with a bad checksum, an unknown compression, one that claims terabytes, and one that holds them."""
    found = _unpacked(path)
    inner = joined(found)
    kinds = (
        lambda: chunk(inner, b"zstd", crc=12345),
        lambda: chunk(inner, b"snappy"),
        lambda: chunk(inner, b"z" * 70000),
        lambda: chunk(inner, b"zstd", size=2**42),
        lambda: chunk(inner, b"", size=2**63),
        lambda: _bomb(b"zstd", 3000),
        lambda: _bomb(b"lz4", 400),
        lambda: chunk(inner, b"lz4")[:-40],
        lambda: chunk(chunk(inner), b"zstd"),
        lambda: chunk(struct.pack("<BQ", MESSAGE, 2**63) + inner, b"zstd"),
    )
    body = kinds[int(rng.integers(len(kinds)))]()
    good = (CHUNK, chunk(inner, b"zstd"))
    _save(path, [good, (CHUNK, body)] if rng.random() < 0.5 else [(CHUNK, body)])


def mcap_length(path: Path, rng: np.random.Generator) -> None:
    """A record that claims to be longer than any disk."""
    found = _unpacked(path)
    at = int(rng.integers(len(found)))
    length = int(rng.choice(np.array([2**40, 2**63 - 1, 2**64 - 1, 0], dtype=object)))
    opcode, body = found[at]
    data = joined(found[:at]) + struct.pack("<BQ", opcode, length) + body + joined(found[at + 1 :])
    path.write_bytes(MAGIC + data + MAGIC)


MCAP: tuple[Fault, ...] = (
    *(mcap_order, mcap_shuffled, mcap_few, mcap_times, mcap_payloads, mcap_definition, mcap_channel),
    *(mcap_chunk, mcap_length),
)


# --- ROS 1 bags: fields NAME=VALUE in headers (http://wiki.ros.org/Bags/Format/2.0)


def bag_field(path: Path, rng: np.random.Generator) -> None:
    """A field of a header that cannot be: counts, positions, sizes, compressions."""
    data = bytearray(path.read_bytes())
    names = (b"chunk_count=", b"conn_count=", b"index_pos=", b"size=", b"count=", b"ver=", b"conn=", b"op=")
    names += (b"chunk_pos=", b"start_time=", b"time=", b"compression=")
    places = [i for name in names for i in _all(bytes(data), name)]
    if not places:
        return
    at = int(rng.choice(places))
    at += data[at:].index(b"=") + 1
    length = int(rng.choice([1, 4, 8]))
    data[at : at + length] = int(rng.choice([0, 255, 127])).to_bytes(1, "little") * length
    path.write_bytes(data)


def bag_definition(path: Path, rng: np.random.Generator) -> None:
    """A definition of the same length that is recursive or no definition."""
    data = path.read_bytes()
    places = _all(data, b"message_definition=")
    if not places:
        return
    at = int(rng.choice(places)) + len(b"message_definition=")
    end = data.find(b"\x00\x00", at)
    text = (_pick(DEFINITIONS, rng) * 40)[: max(min(end, at + 400) - at, 1)]
    path.write_bytes(data[:at] + text + data[at + len(text) :])


def _all(data: bytes, name: bytes) -> list[int]:
    out, at = [], data.find(name)
    while at >= 0:
        out.append(at)
        at = data.find(name, at + 1)
    return out


BAG: tuple[Fault, ...] = (bag_field, bag_field, bag_definition)


# --- ROS 2 bags in SQLite

SQL = (
    "UPDATE messages SET timestamp = 'noon' WHERE id % 3 = 0",
    "UPDATE messages SET timestamp = -timestamp WHERE id % 7 = 0",
    "UPDATE messages SET timestamp = 9223372036854775807 WHERE id % 2 = 0",
    "UPDATE messages SET timestamp = 1.5e300 WHERE id % 5 = 0",
    "UPDATE messages SET timestamp = 0",
    "UPDATE messages SET data = NULL WHERE id % 4 = 0",
    "UPDATE messages SET data = 'text' WHERE id % 4 = 1",
    "UPDATE messages SET data = zeroblob(3) WHERE id % 4 = 2",
    "UPDATE messages SET data = zeroblob(20000000) WHERE id = 5",
    "UPDATE messages SET topic_id = 999 WHERE id % 3 = 0",
    "DELETE FROM messages",
    "DELETE FROM messages WHERE id > 1",
    "INSERT INTO messages (topic_id, timestamp, data) SELECT topic_id, timestamp, data FROM messages",
    "DROP TABLE messages",
    "DROP TABLE topics",
    "DELETE FROM topics",
    "UPDATE topics SET type = 'nonsense'",
    "UPDATE topics SET type = NULL",
    "UPDATE topics SET name = NULL",
    "UPDATE topics SET name = '/same'",
    "UPDATE topics SET name = x'ff00ff'",
    "UPDATE topics SET serialization_format = 'json'",
    "UPDATE topics SET serialization_format = NULL",
    "UPDATE topics SET id = NULL",
    "UPDATE topics SET id = 'one'",
    "UPDATE message_definitions SET encoded_message_definition = :text",
    "UPDATE message_definitions SET encoded_message_definition = :text, encoding = 'ros2idl'",
    "UPDATE message_definitions SET encoded_message_definition = 17",
    "ALTER TABLE messages RENAME TO kept; CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL "
    "SELECT id + 1 FROM n) SELECT id, 1 AS topic_id, id AS timestamp, x'00' AS data FROM n",
    "ALTER TABLE topics RENAME TO kept; CREATE VIEW topics AS SELECT * FROM kept",
)


def db3_rows(path: Path, rng: np.random.Generator) -> None:
    """Tables whose rows are not what they should be."""
    file = path if path.is_file() else next(path.glob("*.db3"))
    text = _pick(DEFINITIONS, rng).decode(errors="replace")
    statements = SQL[int(rng.integers(len(SQL)))].split("; ")
    database = sqlite3.connect(file)
    try:
        for statement in statements:
            database.execute(statement, {"text": text} if ":text" in statement else ())
        database.commit()
    except sqlite3.Error:  # not every statement fits what an earlier one left
        database.rollback()
    finally:
        database.close()


def metadata(path: Path, rng: np.random.Generator) -> None:
    """A metadata.yaml that lists what is not there, or climbs out of the folder."""
    lists = ("../../etc/passwd", "/etc/passwd", "nothing.db3", "", "log.db3\n  - log.db3", "'")
    kinds = (
        "rosbag2_bagfile_information:\n  relative_file_paths:\n  - {}\n",
        "relative_file_paths: [{}]",
        "{}",
        "\x00{}",
    )
    text = kinds[int(rng.integers(len(kinds)))].format(lists[int(rng.integers(len(lists)))])
    if path.is_dir():
        (path / "metadata.yaml").write_text(text, encoding="utf-8")


DB3: tuple[Fault, ...] = (db3_rows,)
FOLDER: tuple[Fault, ...] = (db3_rows, metadata)
