"""Compiled pieces of writing an MCAP file: the order of messages, messages by topic, and records filled in place.

Their plain form, message by message, is the `mcap` package's `Writer` (tests/flight/test_mcap_messages.py).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from wrenchgap.flight.formats.kernels import copy_bytes

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

HEAD = 31
"""Bytes of a message record before its payload: opcode 1, length 8, channel 2, sequence 4, two times of 8."""


@njit(cache=True, nogil=True)
def merged(
    stamps: Ints, starts: Ints, counts: Ints, sizes: Ints, done: Ints, now: Ints, at: int, most: int, found: Ints
) -> tuple[int, bool]:  # fmt: skip
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


def _put(_: Any, target: Any, at: Any, value: Any) -> Any:
    """Store a 64-bit integer into an array of bytes from `at` on, the lowest byte first."""

    def generated(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        place = builder.gep(context.make_array(signature.args[0])(context, builder, args[0]).data, [args[1]])
        word = context.get_value_type(types.int64)
        builder.store(args[2], builder.bitcast(place, word.as_pointer()), align=1)
        return context.get_dummy_value()

    return types.void(target, types.int64, types.int64), generated


put: Any = intrinsic(_put)


@njit(cache=True, nogil=True)
def placed(
    records: Bytes, entries: Ints, index: Ints, record: Bytes, varying: Bytes, first: int, spans: Ints
) -> None:  # fmt: skip
    """Message records of one topic into `records`: stamps and places in `entries` (N, 2), rows `index` (N,).

    `record` (HEAD + length,) is what they share; `varying` (M, V) begins with row `first`. Plain form:
    `mcap.records.Message.write`, of `Messages.payloads`.
    """
    flat, width = varying.reshape(-1), varying.shape[1]
    for n in range(len(index)):
        stamp, at, row = entries[n, 0], entries[n, 1], index[n]
        copy_bytes(records, at, record, 0, len(record))
        put(records, at + 11, row)
        put(records, at + 15, stamp)
        put(records, at + 23, stamp)
        for s in range(len(spans)):
            copy_bytes(records, at + HEAD + spans[s, 1], flat, (row - first) * width + spans[s, 0], spans[s, 2])
