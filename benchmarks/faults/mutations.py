"""Damage that any file may suffer: bytes cut, flipped, doubled, moved, and numbers made absurd."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

Mutation = Callable[[bytes, np.random.Generator], bytes]

ABSURD = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**63, 2**64 - 1)
"""Lengths and counts that no small file has, and their neighbours where signs turn."""


def _place(data: bytes, rng: np.random.Generator, room: int = 1) -> int:
    """A place in the data: anywhere, or near its beginning, where headers are."""
    end = max(len(data) - room, 1)
    return int(rng.integers(end if rng.random() < 0.6 else min(end, 400)))


def cut_end(data: bytes, rng: np.random.Generator) -> bytes:
    """The end is missing, as of a recorder that lost power."""
    return data[: int(rng.integers(len(data)))]


def cut_last_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    """A few bytes are missing."""
    return data[: -int(rng.integers(1, min(60, len(data))))]


def cut_middle(data: bytes, rng: np.random.Generator) -> bytes:
    """A run is missing."""
    start = _place(data, rng)
    return data[:start] + data[start + int(rng.integers(1, 3000)) :]


def cut_beginning(data: bytes, rng: np.random.Generator) -> bytes:
    """The beginning is missing, but not the magic bytes."""
    return data[:16] + data[16 + int(rng.integers(1, max(len(data) - 16, 2))) :]


def flip_bits(data: bytes, rng: np.random.Generator) -> bytes:
    """Some bits are turned over."""
    out = bytearray(data)
    for _ in range(int(rng.choice([1, 2, 5, 50]))):
        out[_place(data, rng)] ^= 1 << int(rng.integers(8))
    return bytes(out)


def random_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    """A run is noise."""
    start, length = _place(data, rng), int(rng.choice([1, 4, 16, 200]))
    return data[:start] + rng.bytes(length) + data[start + length :]


def same_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    """A run is all zeros or all ones, as a card that lost a block gives it."""
    start, length = _place(data, rng), int(rng.choice([4, 64, 512, 4096]))
    return (
        data[:start] + bytes([int(rng.choice([0, 255]))]) * len(data[start : start + length]) + data[start + length :]
    )


def insert_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes that do not belong there."""
    start = _place(data, rng)
    return data[:start] + rng.bytes(int(rng.integers(1, 300))) + data[start:]


def absurd_number(data: bytes, rng: np.random.Generator) -> bytes:
    """Four or eight bytes become a length or count that cannot be."""
    size = int(rng.choice([2, 4, 8]))
    start = _place(data, rng, size)
    number = int(rng.choice(np.array(ABSURD, dtype=object))) % 2 ** (8 * size)
    return data[:start] + number.to_bytes(size, "little") + data[start + size :]


def double_block(data: bytes, rng: np.random.Generator) -> bytes:
    """A run stands twice."""
    start, length = _place(data, rng), int(rng.integers(1, 5000))
    return data[: start + length] + data[start : start + length] + data[start + length :]


def swap_blocks(data: bytes, rng: np.random.Generator) -> bytes:
    """Two runs have changed places."""
    a, b = sorted(int(x) for x in rng.integers(len(data), size=2))
    length = int(rng.integers(1, max(b - a, 2)))
    return data[:a] + data[b : b + length] + data[a + length : b] + data[a : a + length] + data[b + length :]


def twice(data: bytes, rng: np.random.Generator) -> bytes:
    """The whole file behind itself."""
    return data + data


def garbage_behind(data: bytes, rng: np.random.Generator) -> bytes:
    """Noise behind the end."""
    return data + rng.bytes(int(rng.integers(1, 5000)))


def swap_number_text(data: bytes, rng: np.random.Generator) -> bytes:
    """A digit of a text becomes something else."""
    digits = [i for i, byte in enumerate(data[:20000]) if 48 <= byte <= 57]
    if not digits:
        return flip_bits(data, rng)
    at = int(rng.choice(digits))
    words = (b"nan", b"-", b"1e999", b"", b"\x00", b"'", b"[", b"99999999999999999999", b"text", b"\xff", b"\n")
    return data[:at] + words[int(rng.integers(len(words)))] + data[at + 1 :]


def several(data: bytes, rng: np.random.Generator) -> bytes:
    """Two or three of the others, one after another."""
    for _ in range(int(rng.integers(2, 4))):
        data = BYTES[int(rng.integers(len(BYTES)))](data, rng) or b"\0"
    return data


BYTES: tuple[Mutation, ...] = (
    *(cut_end, cut_last_bytes, cut_middle, cut_beginning, flip_bits, random_bytes, same_bytes, insert_bytes),
    *(absurd_number, double_block, swap_blocks, twice, garbage_behind, swap_number_text),
)
ANY: tuple[Mutation, ...] = (*BYTES, several)
"""What any file may suffer."""


def in_folder(path: Path, change: Mutation, rng: np.random.Generator) -> None:
    """Damage a file, or one of the files of a folder."""
    files = [path] if path.is_file() else sorted(p for p in path.rglob("*") if p.is_file())
    target = files[int(rng.integers(len(files)))]
    target.write_bytes(change(target.read_bytes() or b"\0", rng))
