# Long because every kind of file stands here, each in one function.
"""Small files with large appetites: well-formed logs that ask for gigabytes, or for minutes.

Each is a function that writes one; `size` scales it, and the usual size is what `benchmarks/attacks/appetites.py`
opens. The fuzzer begins with small ones of the same kinds (`benchmarks.faults.fuzz.seeds`).
"""

from __future__ import annotations

import bz2
import json
import re
import sqlite3
import struct
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import zstandard

from benchmarks.faults import structured

Maker = Callable[[Path, int], None]
ULOG = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
IMU = b"std_msgs/Header header\n"


def ulog_message(kind: str, body: bytes) -> bytes:
    """One message of a ULog."""
    return struct.pack("<HB", len(body), ord(kind)) + body


def ulog_nested(path: Path, size: int) -> None:
    """A format of `size` formats of 300 numbers, subscribed to many times."""
    formats = ["inner:float[300] x;", f"deep:uint64_t timestamp;inner[{size}] a;"]
    found = ULOG + ulog_message("B", bytes(40)) + b"".join(ulog_message("F", text.encode()) for text in formats)
    found += b"".join(ulog_message("A", struct.pack("<BH", 0, i) + b"deep") for i in range(300))
    path.write_bytes(found)


def ulog_long_name(path: Path, size: int) -> None:
    """A format of 400 formats of 900 numbers, in a field whose name has `size` letters."""
    formats = ["inner:uint8_t[900] x;", f"deep:uint64_t timestamp;inner[400] {'a' * size};"]
    found = ULOG + ulog_message("B", bytes(40)) + b"".join(ulog_message("F", text.encode()) for text in formats)
    path.write_bytes(found + ulog_message("A", struct.pack("<BH", 0, 1) + b"deep"))


def ulog_subscriptions(path: Path, size: int) -> None:
    """A topic of three numbers, subscribed to `size` times, with a message each."""
    found = [ULOG, ulog_message("B", bytes(40)), ulog_message("F", b"few:uint64_t timestamp;float x;float y;")]
    for i in range(size):
        found.append(ulog_message("A", struct.pack("<BH", i >> 16 & 255, i & 65535) + b"few"))
        found.append(ulog_message("D", struct.pack("<HQff", i & 65535, i, 1.0, 2.0)))
    path.write_bytes(b"".join(found))


def ulog_beyond(path: Path, size: int) -> None:
    """`size` pieces of information, then a message that claims more than is there: pyulog went back from the end."""
    about = ulog_message("I", b"\x08char[9] x" + bytes(9))
    path.write_bytes(ULOG + ulog_message("B", bytes(40)) + size * about + struct.pack("<HB", 60_000, 0) + bytes(10))


def dataflash_instances(path: Path, size: int) -> None:
    """`size` messages, each of an instance of its own."""
    mark = b"\xa3\x95"

    def described(number: int, length: int, name: bytes, letters: bytes, columns: bytes) -> bytes:
        return mark + b"\x80" + struct.pack("<BB4s16s64s", number, length, name, letters, columns)

    found = [described(0x80, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")]
    found.append(described(0x81, 3 + 8 + 4 + 4, b"IMU", b"QIf", b"TimeUS,I,GyrX"))
    found += [mark + b"\x81" + struct.pack("<QIf", 1000 * i, i, 0.5) for i in range(size)]
    path.write_bytes(b"".join(found))


def parquet_rows(path: Path, size: int) -> None:
    """`size` rows of seven columns, each of one value that repeats."""
    import pyarrow as pa
    import pyarrow.parquet

    names = ("time_s", "gyro_x", "gyro_y", "gyro_z", "acc_x", "acc_y", "acc_z")
    part = min(size, 1_000_000)
    table = pa.table({name: np.full(part, 1.0 + i) for i, name in enumerate(names)})
    with pa.parquet.ParquetWriter(path, table.schema, compression="zstd") as writer:
        for _ in range(size // part):
            writer.write_table(table)


def parquet_text(path: Path, size: int) -> None:
    """`size` times the same 100,000 letters, which the file holds once."""
    import pyarrow as pa
    import pyarrow.parquet

    word = pa.DictionaryArray.from_arrays(pa.array(np.zeros(size, dtype=np.int32)), pa.array(["x" * 100_000]))
    table = pa.table(
        {"time_s": np.arange(size) * 0.01, "gyro_x": np.zeros(size), "note": word.cast(pa.large_string())}
        if size < 1000
        else {"time_s": np.arange(size) * 0.01, "gyro_x": np.zeros(size), "note": word}
    )
    pa.parquet.write_table(table, path, compression="zstd", store_schema=False)


def parquet_bytes(path: Path, size: int) -> None:
    """Four rows in groups of their own, each with `size` bytes of zeros."""
    import pyarrow as pa
    import pyarrow.parquet

    zeros = pa.array([bytes(size)], pa.binary())
    rows = [pa.table({"time_s": [0.01 * i], "gyro_x": [0.0], "note": zeros}) for i in range(4)]
    with pa.parquet.ParquetWriter(path, rows[0].schema, compression="zstd", use_dictionary=False) as file:
        for row in rows:
            file.write_table(row)


def parquet_page(path: Path, size: int) -> None:
    """Ten samples of two columns; the header of the second's page claims `size` bytes and as many values.

    Headers are Thrift's compact protocol: `size` is written where the statistics stood, which are left out.
    """
    import pyarrow as pa
    import pyarrow.parquet

    table = pa.table({"time_s": np.arange(10) * 0.01, "gyro_x": np.zeros(10)})
    pa.parquet.write_table(table, path, compression="snappy", use_dictionary=False)
    column = pa.parquet.ParquetFile(path).metadata.row_group(0).column(1)
    found = path.read_bytes()
    start, stop = column.data_page_offset, column.data_page_offset + column.total_compressed_size
    fields = re.match(
        rb"\x15\x00\x15([\x80-\xff]*.)\x15([\x80-\xff]*.)\x2c\x15\x14(\x15.\x15.\x15.)", found[start:stop], re.DOTALL
    )
    assert fields is not None, "pyarrow writes another header: kind, sizes, ten values, encodings"
    packed = int.from_bytes(fields[2], "little") // 2  # zigzag; one byte, since it is small
    claim, rest = b"", 2 * size
    while rest > 127:
        claim, rest = claim + bytes([rest & 127 | 128]), rest >> 7
    claim = b"\x15" + claim + bytes([rest])
    page = (
        b"\x15\x00"
        + claim
        + b"\x15"
        + fields[2]
        + b"\x2c"
        + claim
        + fields[3]
        + b"\x00\x00"
        + found[stop - packed : stop]
    )
    path.write_bytes(found[:start] + page.ljust(stop - start, b"\x00") + found[stop:])


def _mcap(schemas: Sequence[tuple[str, str, bytes]], topics: Sequence[tuple[int, str, str]]) -> structured.Records:
    """Schemas (name, encoding, text) numbered from 1, and channels (schema, topic, encoding) from 0."""

    def text(data: str | bytes) -> bytes:
        raw = data.encode() if isinstance(data, str) else data
        return struct.pack("<I", len(raw)) + raw

    found = [
        (structured.SCHEMA, struct.pack("<H", i) + text(name) + text(encoding) + text(body))
        for i, (name, encoding, body) in enumerate(schemas, 1)
    ]
    found += [
        (structured.CHANNEL, struct.pack("<HH", i, schema) + text(topic) + text(encoding) + bytes(4))
        for i, (schema, topic, encoding) in enumerate(topics)
    ]
    return found


def _message(channel: int, time_ns: int, payload: bytes) -> tuple[int, bytes]:
    return structured.MESSAGE, struct.pack("<HIQQ", channel, 0, time_ns, time_ns) + payload


def _save(path: Path, found: structured.Records) -> None:
    path.write_bytes(structured.MAGIC + structured.joined([*found, (structured.DATA_END, bytes(4))]) + structured.MAGIC)


def mcap_channels(path: Path, size: int) -> None:
    """`size` channels of one type, two messages each."""
    found = _mcap([("lab_msgs/msg/X", "ros2msg", b"float64 x")], [(1, f"/topic_{i}", "cdr") for i in range(size)])
    payload = b"\0\1\0\0" + struct.pack("<d", 1.0)
    found += [_message(i, 10**9 + t * 10**7 + i, payload) for t in range(2) for i in range(size)]
    _save(path, found)


def mcap_imus(path: Path, size: int) -> None:
    """`size` topics that could each be the IMU, two messages each."""
    found = _mcap([("sensor_msgs/msg/Imu", "ros2msg", b"")], [(1, f"/imu_{i}", "cdr") for i in range(size)])
    payload = b"\0\1\0\0" + bytes(12) + bytes(37 * 8)
    found += [_message(i, 10**9 + t * 10**7 + i, payload) for t in range(2) for i in range(size)]
    _save(path, found)


def mcap_schemas(path: Path, size: int) -> None:
    """`size` channels, each of a type of its own that has to be parsed."""
    names = [f"lab_msgs/msg/X{i}" for i in range(size)]
    found = _mcap(
        [(n, "ros2msg", f"float64[3] x{i}".encode()) for i, n in enumerate(names)],
        [(i + 1, f"/topic_{i}", "cdr") for i in range(size)],
    )
    found += [_message(i, 10**9 + i, b"\0\1\0\0" + bytes(24)) for i in range(size)]
    _save(path, found)


def mcap_chunks(path: Path, size: int) -> None:
    """`size` chunks of 240 MB of small messages each, compressed to a few kB."""
    found = _mcap([("lab_msgs/msg/X", "ros2msg", b"float64 x")], [(1, "/x", "cdr")])
    one = structured.joined([_message(0, 10**9, b"\0\1\0\0" + bytes(8))])
    megabyte = one * (2**20 // len(one))
    number = 240 if size > 1 else 1
    packer = zstandard.ZstdCompressor(level=1).compressobj(size=number * len(megabyte))
    load = b"".join([packer.compress(megabyte) for _ in range(number)] + [packer.flush()])
    head = struct.pack("<QQQII", 0, 2**62, number * len(megabyte), 0, 4) + b"zstd" + struct.pack("<Q", len(load))
    _save(path, [*found, *[(structured.CHUNK, head + load)] * size])


def mcap_arrays(path: Path, size: int) -> None:
    """`size` messages of a million numbers each, in chunks that are small in the file."""
    found = _mcap(
        [("sensor_msgs/msg/JointState", "ros2msg", b"float64[1000000] position")], [(1, "/joint_states", "cdr")]
    )
    for i in range(size):
        inner = structured.joined([_message(0, 10**9 + i * 10**7, b"\0\1\0\0" + bytes(8_000_000))])
        found.append((structured.CHUNK, structured.chunk(inner, b"zstd")))
    _save(path, found)


def mcap_json(path: Path, size: int) -> None:
    """`size` messages in JSON, each with a key of its own."""
    found = _mcap([("lab.Imu", "jsonschema", b"")], [(1, "/imu", "json")])
    for i in range(size):
        load = json.dumps({f"k{i}": 1.0, "angular_velocity": {"x": 0.0, "y": 0.0, "z": 0.0}}).encode()
        found.append(_message(0, 10**9 + i * 10**7, load))
    _save(path, found)


def mcap_long_key(path: Path, size: int) -> None:
    """JSON whose one object has a name of 100,000 letters, and in it `size` numbers."""
    load = json.dumps({"a" * 100_000: {f"k{i}": 1.0 for i in range(size)}}).encode()
    found = _mcap([("lab.Imu", "jsonschema", b"")], [(1, "/imu", "json")])
    _save(path, [*found, *(_message(0, 10**9 + i * 10**7, load) for i in range(2))])


def mcap_long_name(path: Path, size: int) -> None:
    """A JSON schema of a name of `size` letters, and in it 1,990 names."""
    inner = {"type": "object", "properties": {f"k{i}": {"type": "number"} for i in range(1990)}}
    schema = json.dumps({"type": "object", "properties": {"a" * size: inner}}).encode()
    found = _mcap([("lab.Imu", "jsonschema", schema)], [(1, "/imu", "json")])
    _save(path, [*found, *(_message(0, 10**9 + i * 10**7, b'{"x": 1.0}') for i in range(2))])


def mcap_fan(path: Path, size: int) -> None:
    """A protobuf type of 20,000 flags that contains itself 8 times; messages of 8 within 8 within ..., `size` deep."""
    from google.protobuf import descriptor_pb2 as pb2

    file = pb2.FileDescriptorProto(name="m.proto", package="lab", syntax="proto3")
    vector = file.message_type.add(name="Vector")
    for i, name in enumerate("xyz"):
        vector.field.add(name=name, number=i + 1, type=1, label=1)
    kind = file.message_type.add(name="Imu")
    for i, name in enumerate(("angular_velocity", "linear_acceleration")):
        kind.field.add(name=name, number=i + 9, type=11, label=1, type_name=".lab.Vector")
    for i in range(8):
        kind.field.add(name=f"s{i}", number=i + 1, type=11, label=1, type_name=".lab.Imu")
    for i in range(20_000):
        kind.field.add(name=f"f{i}", number=i + 20_000, type=8, label=1)
    load = b""
    for _ in range(size):
        length = bytes([len(load)]) if len(load) < 128 else bytes([len(load) & 127 | 128, len(load) >> 7])
        load = b"".join(bytes([(i + 1) << 3 | 2]) + length + load for i in range(8))
    text = pb2.FileDescriptorSet(file=[file]).SerializeToString()
    found = _mcap([("lab.Imu", "protobuf", text)], [(1, "/imu", "protobuf")])
    _save(path, [*found, *(_message(0, 10**9 + i * 10**7, load) for i in range(2))])


def mcap_open_quotes(path: Path, size: int) -> None:
    """A definition in IDL of `size` texts that are never closed."""
    _undecodable(path, "lab_msgs/msg/X", "ros2idl", '"a\\' * size)


def mcap_empty_types(path: Path, size: int) -> None:
    """A type of `size` fields of a type of `size` fields ..., six deep, the last of which has none."""
    kinds = [f"lab_msgs/T{level}" for level in range(7)]
    parts = ["\n".join(f"{inner} f{i}" for i in range(size)) for inner in kinds[1:]] + ["uint8 C=1"]
    text = f"\n{'=' * 80}\n".join([parts[0], *(f"MSG: {kinds[i]}\n{parts[i]}" for i in range(1, 7))])
    _undecodable(path, "lab_msgs/msg/T0", "ros2msg", text)


def mcap_parentheses(path: Path, size: int) -> None:
    """A constant of IDL in `size` pairs of parentheses."""
    _idl(path, f"const unsigned long A = {'(' * size}1{')' * size};")


def mcap_constants(path: Path, size: int) -> None:
    """`size` constants of IDL, each the square of the one before."""
    _idl(path, "const long A0 = 3;" + "".join(f"const long A{i} = A{i - 1} * A{i - 1};" for i in range(1, size)))


def _idl(path: Path, constants: str) -> None:
    body = f"module lab_msgs {{ module msg {{ module X_Constants {{ {constants} }}; struct X {{ double a; }}; }}; }};"
    _undecodable(path, "lab_msgs/msg/X", "ros2idl", body)


def _undecodable(path: Path, kind: str, encoding: str, text: str) -> None:
    found = _mcap([(kind, encoding, text.encode())], [(1, "/x", "cdr")])
    _save(path, [*found, *(_message(0, 10**9 + i * 10**7, b"\0\1\0\0" + bytes(8)) for i in range(2))])


def csv_alike(path: Path, size: int) -> None:
    """`size` columns of one name, and two rows."""
    path.write_text("time_s" + ",x" * size + "\n" + "0,1,2\n0.01,1,2\n", encoding="utf-8")


def csv_columns(path: Path, size: int) -> None:
    """`size` columns and two rows."""
    with path.open("w", encoding="utf-8") as file:
        file.write("time_s," + ",".join(f"c{i}" for i in range(size)) + "\n")
        for row in range(2):
            file.write(f"{0.01 * row}," + ",".join("1" * size) + "\n")


def csv_header(path: Path, size: int) -> None:
    """A header of `size` characters, most of them in one name."""
    path.write_text("time_s,gyro_x," + "x" * size + "\n0,1,2\n0.01,1,2\n", encoding="utf-8")


def csv_commas(path: Path, size: int) -> None:
    """A header of `size` commas."""
    path.write_text("time_s,gyro_x" + "," * size + "\n0,1\n0.01,1\n", encoding="utf-8")


def _bag_record(header: dict[bytes, bytes], data: bytes) -> bytes:
    fields = b"".join(struct.pack("<I", len(k) + 1 + len(v)) + k + b"=" + v for k, v in header.items())
    return struct.pack("<I", len(fields)) + fields + struct.pack("<I", len(data)) + data


def _connection(number: int, text: bytes = b"float64 x") -> bytes:
    topic = f"/topic_{number}".encode()
    about = {b"topic": topic, b"type": b"lab_msgs/X", b"md5sum": b"0" * 32, b"message_definition": text}
    data = b"".join(struct.pack("<I", len(k) + 1 + len(v)) + k + b"=" + v for k, v in about.items())
    return _bag_record({b"op": b"\x07", b"conn": struct.pack("<I", number), b"topic": topic}, data)


def _bag(
    path: Path,
    chunks: Sequence[tuple[bytes, bytes, int]],
    connections: int,
    counts: Sequence[dict[int, int]],
    indices: bytes,
) -> None:
    """Chunks (compression, packed, plain size), `indices` of their messages as they stand behind each, connections."""
    magic = b"#ROSBAG V2.0\n"
    body, places = b"", []
    for compression, packed, size in chunks:
        places.append(len(magic) + 4096 + len(body))
        body += _bag_record({b"op": b"\x05", b"compression": compression, b"size": struct.pack("<I", size)}, packed)
        body += indices
    index = len(magic) + 4096 + len(body)
    tail = b"".join(_connection(i) for i in range(connections))
    for place, inside in zip(places, counts, strict=True):
        listed = b"".join(struct.pack("<II", *pair) for pair in inside.items())
        tail += _bag_record(
            {
                b"op": b"\x06", b"ver": struct.pack("<I", 1), b"chunk_pos": struct.pack("<Q", place),
                b"start_time": struct.pack("<II", 1, 0), b"end_time": struct.pack("<II", 2, 0),
                b"count": struct.pack("<I", len(inside)),
            },
            listed,
        )  # fmt: skip
    about = {b"op": b"\x03", b"index_pos": struct.pack("<Q", index), b"conn_count": struct.pack("<I", connections)}
    about[b"chunk_count"] = struct.pack("<I", len(chunks))
    head = _bag_record(about, b"")
    path.write_bytes(magic + head[:-4] + struct.pack("<I", 4096 - len(head)) + b" " * (4096 - len(head)) + body + tail)


def _bag_messages(connections: Sequence[int], start: int) -> tuple[bytes, bytes]:
    """A message of each of the connections, from byte `start` of a chunk on, and their index."""
    places: dict[int, list[bytes]] = {}
    parts = []
    for i, number in enumerate(connections):
        at = struct.pack("<II", 1, i * 1000)
        places.setdefault(number, []).append(at + struct.pack("<I", start))
        parts.append(_bag_record({b"op": b"\x02", b"conn": struct.pack("<I", number), b"time": at}, bytes(8)))
        start += len(parts[-1])
    records = b"".join(parts)
    about = {b"op": b"\x04", b"ver": struct.pack("<I", 1)}
    index = b"".join(
        _bag_record(
            about | {b"conn": struct.pack("<I", number), b"count": struct.pack("<I", len(listed))}, b"".join(listed)
        )
        for number, listed in places.items()
    )
    return records, index


def bag_bz2(path: Path, size: int) -> None:
    """A chunk of `size` MB of zeros behind two messages, in a few hundred bytes."""
    head = _connection(0)
    records, index = _bag_messages([0, 0], len(head))
    packer = bz2.BZ2Compressor(9)
    packed = packer.compress(head + records) + b"".join(packer.compress(bytes(2**20)) for _ in range(size))
    packed += packer.flush()
    _bag(path, [(b"bz2", packed, len(head + records) + size * 2**20)], 1, [{0: 2}], index)


def bag_connections(path: Path, size: int) -> None:
    """`size` connections, one message each."""
    records, index = _bag_messages(range(size), 0)
    _bag(path, [(b"none", records, len(records))], size, [dict.fromkeys(range(size), 1)], index)


def _database(path: Path, data: str) -> sqlite3.Connection:
    path.unlink(missing_ok=True)
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
    database.execute(f"CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data {data})")
    return database


def db3_generated(path: Path, size: int) -> None:
    """1000 messages of `size` MB each, which are generated when they are read."""
    database = _database(path, f"BLOB GENERATED ALWAYS AS (zeroblob({size * 2**20})) VIRTUAL")
    database.execute("INSERT INTO topics VALUES (1, '/imu', 'sensor_msgs/msg/Imu', 'cdr')")
    database.executemany("INSERT INTO messages VALUES (?, 1, ?)", [(i, 10**9 + i * 10**7) for i in range(1000)])
    database.commit()
    database.close()


def bag_view(path: Path, size: int) -> None:
    """A folder of two bags whose messages are a view without end."""
    path.mkdir()
    for number in (0, 1):
        database = _database(path / f"bag_{number}.db3", "BLOB")
        database.execute("DROP TABLE messages")
        rows = f"SELECT {size} UNION ALL SELECT x + 1 FROM c"
        database.execute(f"CREATE VIEW messages AS WITH RECURSIVE c(x) AS ({rows}) SELECT x AS timestamp FROM c")
        database.commit()
        database.close()


def bag_metadata(path: Path, size: int) -> None:
    """A bag of one topic whose metadata.yaml has `size` empty lines, and a name with as many spaces."""
    path.mkdir()
    db3_topics(path / "bag_0.db3", 1)
    lines = "\n" * size + "relative_file_paths:\n - bag_0.db3\n - a" + " " * size + "b\n"
    (path / "metadata.yaml").write_text(lines, encoding="utf-8")


def db3_topics(path: Path, size: int) -> None:
    """`size` topics with a message each."""
    database = _database(path, "BLOB")
    database.executemany(
        "INSERT INTO topics VALUES (?, ?, 'lab_msgs/msg/X', 'cdr')", [(i, f"/t{i}") for i in range(size)]
    )
    rows = ((i, i, 10**9 + i, bytes(12)) for i in range(size))
    database.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows)
    database.commit()
    database.close()


def folder_zstd(path: Path, size: int) -> None:
    """A bag folder whose one file is `size` MB of zeros, compressed."""
    path.mkdir()
    (path / "bag_0.db3.zstd").write_bytes(structured.bomb("zstd", size))


def folder_footer(path: Path, size: int) -> None:
    """Two MCAP files whose footers say that their summary is where a chunk of `size` MB of zeros begins."""
    path.mkdir()
    packed = structured.bomb("zstd", size)
    head = struct.pack("<QQQII", 0, 2**62, size * 2**20, 0, 4) + b"zstd" + struct.pack("<Q", len(packed))
    footer = struct.pack("<QQI", len(structured.MAGIC), 0, 0)
    records = structured.joined([(structured.CHUNK, head + packed), (2, footer)])
    for name in ("a.mcap", "b.mcap"):
        (path / name).write_bytes(structured.MAGIC + records + structured.MAGIC)


MAKERS: dict[str, tuple[Maker, str, int, int]] = {
    "ulog-nested": (ulog_nested, "a.ulg", 500, 2),
    "ulog-long-name": (ulog_long_name, "a.ulg", 60_000, 5),
    "ulog-subscriptions": (ulog_subscriptions, "a.ulg", 300_000, 5),
    "ulog-beyond": (ulog_beyond, "a.ulg", 5000, 3000),
    "dataflash-instances": (dataflash_instances, "a.bin", 100_000, 20),
    "parquet-rows": (parquet_rows, "a.parquet", 50_000_000, 20),
    "parquet-text": (parquet_text, "a.parquet", 100_000, 2),
    "parquet-bytes": (parquet_bytes, "a.parquet", 150_000_000, 1000),
    "parquet-page": (parquet_page, "a.parquet", 2**31 - 1, 2**31 - 1),
    "mcap-channels": (mcap_channels, "a.mcap", 65_534, 10),
    "mcap-imus": (mcap_imus, "a.mcap", 65_534, 5),
    "mcap-schemas": (mcap_schemas, "a.mcap", 65_534, 10),
    "mcap-chunks": (mcap_chunks, "a.mcap", 100, 1),
    "mcap-arrays": (mcap_arrays, "a.mcap", 300, 1),
    "mcap-json": (mcap_json, "a.mcap", 60_000, 20),
    "mcap-long-key": (mcap_long_key, "a.mcap", 60_000, 20),
    "mcap-long-name": (mcap_long_name, "a.mcap", 800_000, 300),
    "mcap-fan": (mcap_fan, "a.mcap", 4, 1),
    "mcap-open-quotes": (mcap_open_quotes, "a.mcap", 40_000, 20),
    "mcap-empty-types": (mcap_empty_types, "a.mcap", 300, 3),
    "mcap-parentheses": (mcap_parentheses, "a.mcap", 14, 2),
    "mcap-constants": (mcap_constants, "a.mcap", 40, 3),
    "bag-view": (bag_view, "bag", 1, 1),
    "bag-metadata": (bag_metadata, "bag", 300_000, 10),
    "csv-columns": (csv_columns, "a.csv", 100_000, 20),
    "csv-alike": (csv_alike, "a.csv", 100_000, 20),
    "csv-header": (csv_header, "a.csv", 100_000_000, 500),
    "csv-commas": (csv_commas, "a.csv", 50_000_000, 50),
    "bag-bz2": (bag_bz2, "a.bag", 800, 1),
    "bag-connections": (bag_connections, "a.bag", 65_000, 5),
    "db3-generated": (db3_generated, "a.db3", 900, 1),
    "db3-topics": (db3_topics, "a.db3", 100_000, 5),
    "folder-footer": (folder_footer, "bag", 4000, 1),
    "folder-zstd": (folder_zstd, "bag", 20_000, 1),
}
"""By name: what writes it, the name of the file, the usual size, and that of a seed."""


def made(name: str, folder: Path, seed: bool = False) -> Path:
    """Write one into a folder, of the usual size or of that of a seed."""
    maker, file, usual, small = MAKERS[name]
    path = folder / file
    maker(path, small if seed else usual)
    return path


def seeds(folder: Path) -> Iterator[tuple[str, bytes]]:
    """Small ones of every kind that is one file, by name."""
    for name in MAKERS:
        place = folder / name
        place.mkdir(parents=True)
        path = made(name, place, seed=True)
        if path.is_file():
            yield name, path.read_bytes()
