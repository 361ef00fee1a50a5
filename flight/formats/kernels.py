"""Loops over the bytes of messages, read and written, compiled.

Writing an MCAP file, these are the order of messages, and records filled in place; their plain form, message by
message, is the `mcap` package's `Writer` (tests/flight/test_mcap_messages.py).

numba compiles them once per machine and keeps them (docs/decisions/0030-messages-where-they-lie.md).
"""

from typing import Any

import numpy as np
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from wrenchgap.flight.flight import Mask

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

END, OTHER, FULL, BROKEN = range(4)
"""Why a walk stops: no record left; one that it does not read; no room for more messages; one that cannot be."""
RECORD, MESSAGE = 9, 22
"""Bytes of an MCAP record's opcode and length, and of a message's numbers before its payload."""
MESSAGE_OPCODE = 5
ZSTD = 0xFD2FB528
"""The first four bytes of what zstd compressed, as a number."""
LAST_TIME = 2**63 - 1  # ns, in the year 2262


@njit(cache=True, nogil=True)
def _number(data: Bytes, place: Any, size: int) -> Any:
    """An unsigned little-endian number."""
    value = np.uint64(0)
    for k in range(size):
        value |= np.uint64(data[place + k]) << np.uint64(8 * k)
    return value


@njit(cache=True, nogil=True)
def walked(data: Bytes, start: int, stop: int, passed: Mask, places: Ints) -> tuple[int, int, int]:
    """Go through MCAP records from `start` to `stop` and note the messages: how many, and where and why it ended.

    A column of `places` (4, room) becomes channel, log time [ns], first byte and length of a payload.
    Records whose opcode is `passed` (256,) are passed over. The walk ends before a record that it does not read:
    another opcode, a message that is too short, later than `LAST_TIME`, or compressed by itself.
    """
    position: Any = start
    count = 0
    while position + RECORD <= stop:
        opcode = data[position]
        length = _number(data, position + 1, 8)
        first = position + RECORD
        if opcode == 0 or length > np.uint64(stop - first):
            return count, position, BROKEN
        size = np.int64(length)
        if opcode == MESSAGE_OPCODE:
            if size < MESSAGE:
                return count, position, OTHER
            time = _number(data, first + 6, 8)
            if time > np.uint64(LAST_TIME) or (
                size >= MESSAGE + 4 and _number(data, first + MESSAGE, 4) == np.uint64(ZSTD)
            ):
                return count, position, OTHER
            if count == places.shape[1]:
                return count, position, FULL
            places[0, count] = np.int64(data[first]) | np.int64(data[first + 1]) << 8
            places[1, count] = np.int64(time)
            places[2, count] = first + MESSAGE
            places[3, count] = size - MESSAGE
            count += 1
        elif not passed[opcode]:
            return count, position, OTHER
        position = first + size
    return count, position, END


_OP, _CONN, _TIME = (np.frombuffer(name, dtype=np.uint8) for name in (b"op=", b"conn=", b"time="))


@njit(cache=True, nogil=True)
def _named(data: Bytes, place: Any, name: Bytes) -> bool:
    """Whether a field has this name; within the data, as a header is followed by four bytes at least."""
    if place + len(name) > len(data):
        return False
    for k in range(len(name)):  # noqa: SIM110 - numba knows no generators
        if data[place + k] != name[k]:
            return False
    return True


@njit(cache=True, nogil=True)
def walked_bag(data: Bytes, places: Ints) -> int:
    """Go through the records of a ROS 1 chunk and note the messages; gives how many, or -1 where something is odd.

    A column of `places` (6, room) becomes connection, log time [ns], first byte and length of the payload, where the
    record begins, and where the connection records just before it begin. Source: http://wiki.ros.org/Bags/Format/2.0
    """
    position: Any = np.int64(0)
    before: Any = np.int64(0)
    count, size = 0, len(data)
    while position < size:
        if position + 4 > size:
            return -1
        first: Any = position + 4
        stop: Any = first + np.int64(_number(data, position, 4))
        if stop + 4 > size:
            return -1
        op: Any = np.int64(-1)
        number: Any = np.int64(-1)
        time: Any = np.int64(-1)
        while first < stop:
            if first + 4 > stop:
                return -1
            length = np.int64(_number(data, first, 4))
            at = first + 4
            first = at + length
            if first > stop:
                return -1
            if length == 4 and _named(data, at, _OP):
                op = np.int64(data[at + 3])
            elif length == 9 and _named(data, at, _CONN):
                number = np.int64(_number(data, at + 5, 4))
            elif length == 13 and _named(data, at, _TIME):
                time = np.int64(_number(data, at + 5, 4)) * 1_000_000_000 + np.int64(_number(data, at + 9, 4))
            elif _named(data, at, _OP) or _named(data, at, _CONN) or _named(data, at, _TIME):
                return -1
        start = stop + 4
        end = start + np.int64(_number(data, stop, 4))
        if end > size or (op != 2 and op != 7):
            return -1
        if op == 2:
            if number < 0 or time < 0:
                return -1
            found = places[:, count]
            found[0], found[1], found[2], found[3], found[4], found[5] = (
                number, time, start, end - start, position, before,
            )  # fmt: skip
            count += 1
            before = end
        position = end
    return count


@njit(cache=True, nogil=True)
def grouped(places: Ints, count: int) -> tuple[Ints, Ints, Ints]:
    """The first `count` columns of `places` (4, room), channel by channel, as they come within a channel.

    Channels (C,), the first column of each and the number of all (C + 1,), and times, first bytes, lengths (3, count).
    """
    channels, numbers = np.empty(count, dtype=np.int64), np.zeros(count + 1, dtype=np.int64)
    group = np.empty(count, dtype=np.int64)
    known, at = 0, 0
    for i in range(count):
        channel = places[0, i]
        if at >= known or channels[at] != channel:
            at = 0
            while at < known and channels[at] != channel:
                at += 1
            if at == known:
                channels[at] = channel
                known += 1
        group[i] = at
        numbers[at + 1] += 1
    for k in range(known):
        numbers[k + 1] += numbers[k]
    place = numbers[:known].copy()
    out = np.empty((3, count), dtype=np.int64)
    for i in range(count):
        to = place[group[i]]
        place[group[i]] += 1
        for k in range(3):
            out[k, to] = places[k + 1, i]
    return channels[:known].copy(), numbers[: known + 1].copy(), out


def _memcpy(context: Any, target: Any, place: Any, source: Any, first: Any, size: Any) -> Any:
    """Bytes from one array of bytes to another, as C's memcpy: a loop over so few takes five times as long."""

    def made(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        to, of = (context.make_array(signature.args[k])(context, builder, arguments[k]) for k in (0, 2))
        ends = builder.gep(to.data, [arguments[1]]), builder.gep(of.data, [arguments[3]])
        cgutils.raw_memcpy(builder, *ends, arguments[4], 1)  # type: ignore[no-untyped-call]
        return context.get_dummy_value()

    return types.void(target, types.int64, source, types.int64, types.int64), made


copy_bytes: Any = intrinsic(_memcpy)


@njit(cache=True, nogil=True)
def copied(
    data: Bytes,
    starts: Ints,
    lengths: Ints,
    fixed: Ints,
    expected: Bytes,
    ranges: Ints,
    fits: Mask,
    rows: Bytes,
    used: int,
) -> int:
    """Copy the numbers of the messages that have the `expected` bytes where a layout is `fixed`; gives how many.

    Messages begin at `starts` (N,) and have `lengths` (N,), which must be len(expected). `fixed` (F, 2) are first byte
    and number of bytes that must be the same; `ranges` (R, 3) are first byte, place in the row and number of bytes
    that are copied, to `rows` (room, width) from `used` on. `fits` (N,) says afterwards of which messages there are
    rows.
    """
    count, width = 0, rows.shape[1]
    for i in range(len(starts)):
        start = starts[i]
        good = lengths[i] == len(expected)
        for f in range(len(fixed)):
            if not good:
                break
            first = fixed[f, 0]
            for k in range(first, first + fixed[f, 1]):
                if data[start + k] != expected[k]:
                    good = False
                    break
        fits[i] = good
        if good:
            for r in range(len(ranges)):
                copy_bytes(rows, (used + count) * width + ranges[r, 1], data, start + ranges[r, 0], ranges[r, 2])
            count += 1
    return count


HEAD = 31
"""Bytes of a message record before its payload: opcode 1, length 8, channel 2, sequence 4, two times of 8."""


@njit(cache=True, nogil=True)
def merged(
    stamps: Ints, starts: Ints, counts: Ints, sizes: Ints, done: Ints, now: Ints, at: int, most: int, found: Ints
) -> tuple[int, bool]:
    """The next messages by time, then by topic, until one ends beyond `most` bytes, the first at place `at`.

    Topic k has rising stamps, `counts[k]` from `starts[k]` on in `stamps`, of which `done[k]` are through, and records
    of `sizes[k]` bytes; `now` (2,) is the stamp at hand and the topic whose turn it is. Gives how many there are, and
    whether one did end there; number, index, stamp and place of each are in the rows of `found` (4, M).
    """
    many, topics = 0, len(starts)
    while True:
        while now[1] < topics:
            k = now[1]
            if done[k] == counts[k] or stamps[starts[k] + done[k]] != now[0]:
                now[1] += 1
                continue
            found[0, many], found[1, many], found[2, many], found[3, many] = k, done[k], now[0], at
            many += 1
            done[k] += 1
            at += sizes[k]
            if at > most:
                return many, True
        none = True
        for k in range(topics):
            if done[k] < counts[k]:
                stamp = stamps[starts[k] + done[k]]
                if none or stamp < now[0]:
                    now[0], none = stamp, False
        if none:
            return many, False
        now[1] = 0


@njit(cache=True, nogil=True)
def placed(records: Bytes, places: Ints, record: Bytes, varying: Bytes, rows: Ints, spans: Ints) -> None:
    """Message records of one topic into `records`, at `places` (N,).

    `record` (length,) is what they share. Of `varying` (M, V), `rows` (N,) is what each has of its own; of these bytes
    `spans` (S, 3) are first byte, first byte in the record, and how many.
    """
    flat, width = varying.reshape(-1), varying.shape[1]
    for n in range(len(rows)):
        copy_bytes(records, places[n], record, 0, len(record))
        for s in range(len(spans)):
            to, of = places[n] + spans[s, 1], rows[n] * width + spans[s, 0]
            copy_bytes(records, to, flat, of, spans[s, 2])
