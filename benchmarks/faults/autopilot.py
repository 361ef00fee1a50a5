"""Damage that knows PX4's, ArduPilot's and the Crazyflie's logs: well-formed messages that say what cannot be."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

Fault = Callable[[Path, np.random.Generator], None]

HEAD = 16
"""Bytes before the first message of a ULog."""
FORMATS = (
    b"loop:uint64_t timestamp;loop next;",
    b"a:b x;uint64_t timestamp;",
    b"a:b x;",
    b"b:a x;",
    b"sensor_combined:float[2000000000] gyro_rad;uint64_t timestamp;",
    b"sensor_combined:uint64_t timestamp;float[0] gyro_rad;",
    b"sensor_combined:float[-3] gyro_rad;",
    b"sensor_combined:uint8_t timestamp;",
    b"sensor_combined:nothing timestamp;",
    b"sensor_combined:",
    b"sensor_combined",
    b":;;;",
    b"\xff\xfe:\xff",
    b"x" * 60000,
)


def ulog_messages(data: bytes) -> list[tuple[int, bytes]]:
    """Kind and payload of each message of a valid ULog."""
    out, at = [], HEAD
    while at + 3 <= len(data):
        length, kind = struct.unpack_from("<HB", data, at)
        out.append((kind, data[at + 3 : at + 3 + length]))
        at += 3 + length
    return out


def _ulog_save(path: Path, head: bytes, found: list[tuple[int, bytes]]) -> None:
    path.write_bytes(head + b"".join(struct.pack("<HB", len(body) % 65536, kind) + body for kind, body in found))


def ulog_order(path: Path, rng: np.random.Generator) -> None:
    """Messages of any kind in another order, twice, or gone."""
    data = path.read_bytes()
    found = ulog_messages(data)
    rows = rng.permutation(len(found)) if rng.random() < 0.5 else rng.integers(len(found), size=len(found))
    if rng.random() < 0.5:
        rows = np.sort(rows)
    _ulog_save(path, data[:HEAD], [found[i] for i in rows])


def ulog_format(path: Path, rng: np.random.Generator) -> None:
    """Formats that are recursive, endless or none; subscriptions to what there is not."""
    data = path.read_bytes()
    found = ulog_messages(data)
    at = int(rng.integers(0, 8))
    for text in rng.choice(np.array(FORMATS, dtype=object), size=2):
        found.insert(at, (ord("F"), bytes(text)))
    if rng.random() < 0.5:
        name = rng.choice(np.array([b"loop", b"a", b"nothing", b"", b"\xff"], dtype=object))
        found.append((ord("A"), struct.pack("<BH", 0, int(rng.integers(6))) + bytes(name)))
        found.append((ord("D"), struct.pack("<H", int(rng.integers(6))) + rng.bytes(40)))
    _ulog_save(path, data[:HEAD], found)


def ulog_stamps(path: Path, rng: np.random.Generator) -> None:
    """Stamps that cannot be, payloads that are too short."""
    data = path.read_bytes()
    found = []
    for kind, body in ulog_messages(data):
        if kind == ord("D") and rng.random() < rng.choice([0.05, 0.9]):
            stamp = int(rng.choice(np.array([0, 2**63, 2**64 - 1, 5], dtype=object)))
            body = body[:2] + struct.pack("<Q", stamp) + body[10:]
        elif kind == ord("D") and rng.random() < 0.1:
            body = body[: int(rng.integers(len(body)))]
        found.append((kind, body))
    _ulog_save(path, data[:HEAD], found)


def ulog_other(path: Path, rng: np.random.Generator) -> None:
    """Messages of other kinds with any content: information, parameters, flags, dropouts, text."""
    data = path.read_bytes()
    found = ulog_messages(data)
    for _ in range(4):
        kind = int(rng.choice([ord(c) for c in "IMPQOLCSRB"]))
        found.insert(int(rng.integers(len(found))), (kind, rng.bytes(int(rng.choice([0, 1, 2, 9, 40, 300])))))
    _ulog_save(path, data[:HEAD], found)


def ulog_few(path: Path, rng: np.random.Generator) -> None:
    """No or one message of data."""
    data, kept, out = path.read_bytes(), int(rng.integers(3)), []
    for kind, body in ulog_messages(data):
        kept -= kind == ord("D")
        if kind != ord("D") or kept >= 0:
            out.append((kind, body))
    _ulog_save(path, data[:HEAD], out)


ULOG: tuple[Fault, ...] = (ulog_order, ulog_format, ulog_stamps, ulog_other, ulog_few)

FMT = struct.Struct("<BB4s16s64s")


def _dataflash(data: bytes) -> list[bytes]:
    """Messages of a valid dataflash log."""
    lengths, out, at = {0x80: 89}, [], 0
    while at + 3 <= len(data):
        kind = data[at + 2]
        length = lengths.get(kind, 3)
        if kind == 0x80 and at + 89 <= len(data):
            number, size, *_ = FMT.unpack_from(data, at + 3)
            lengths[number] = size
        out.append(data[at : at + length])
        at += length
    return out


def dataflash_order(path: Path, rng: np.random.Generator) -> None:
    """Messages in another order, formats after what they describe."""
    found = _dataflash(path.read_bytes())
    rows = rng.permutation(len(found)) if rng.random() < 0.5 else rng.integers(len(found), size=len(found))
    first = [found[0]] if rng.random() < 0.8 else []
    path.write_bytes(b"".join([*first, *(found[i] for i in rows)]))


def dataflash_format(path: Path, rng: np.random.Generator) -> None:
    """Formats whose length, letters or columns contradict each other."""
    found = _dataflash(path.read_bytes())
    number = int(rng.choice([0x80, 0x81, 0x82, 0x83, 0xC0]))
    name = bytes(rng.choice(np.array([b"IMU", b"PARM", b"GPS", b"FMT", b"FMTU", b"UNIT", b"\xff", b""], dtype=object)))
    letters = bytes(
        rng.choice(np.array([b"QBffffff", b"Q", b"", b"?????", b"QZZZ", b"aaaa", b"\xff\xff"], dtype=object))
    )
    columns = bytes(
        rng.choice(np.array([b"TimeUS,I,X", b"TimeUS", b"", b",,,", b"\xff", b"TimeUS,TimeUS"], dtype=object))
    )
    length = int(rng.choice([0, 1, 2, 3, 4, 20, 255]))
    made = b"\xa3\x95\x80" + FMT.pack(number, length, name, letters, columns)
    found.insert(int(rng.integers(1, 8)), made)
    body = b"\xa3\x95" + bytes([number]) + rng.bytes(max(length - 3, 0))
    path.write_bytes(b"".join([*found, *[body] * int(rng.integers(40))]))


def dataflash_few(path: Path, rng: np.random.Generator) -> None:
    """The formats alone, or with one message."""
    found = _dataflash(path.read_bytes())
    path.write_bytes(b"".join(found[: int(rng.integers(1, 16))]))


DATAFLASH: tuple[Fault, ...] = (dataflash_order, dataflash_format, dataflash_few)

VARIABLES = (
    *(b"gyro.x(?)\0", b"gyro.x(f\0", b"(f)\0", b"\0", b"gyro.x(d)\0", b"motor.m1(b)\0", b"\xff\xfe(f)\0", b"time(f)\0"),
    *(b"stateEstimate.qw(e)\0", b"acc.x(q)\0", b"x" * 5000 + b"(f)\0"),
)


def _usd_save(path: Path, data: bytes) -> None:
    path.write_bytes(data + struct.pack("<I", zlib.crc32(data)))


def usd_variables(path: Path, rng: np.random.Generator) -> None:
    """Variables that are none, twice, or of another type, under a checksum that is right."""
    data = path.read_bytes()[:-4]
    for _ in range(int(rng.integers(1, 4))):
        found = list(re.finditer(rb"[\w.]+\(\w\)\0", data))
        one = found[int(rng.integers(len(found)))]
        data = data[: one.start()] + bytes(rng.choice(np.array(VARIABLES, dtype=object))) + data[one.end() :]
    _usd_save(path, data)


def usd_numbers(path: Path, rng: np.random.Generator) -> None:
    """Times, identifiers and counts that cannot be, under a checksum that is right."""
    data = bytearray(path.read_bytes()[:-4])
    for at in rng.integers(1, int(rng.choice([50, len(data) - 8])), size=int(rng.choice([1, 5, 200]))):
        data[at : at + 8] = struct.pack("<Q", int(rng.choice(np.array([0, 2**63, 2**64 - 1, 5, 300], dtype=object))))
    _usd_save(path, bytes(data))


CRAZYFLIE_USD: tuple[Fault, ...] = (usd_variables, usd_numbers)
