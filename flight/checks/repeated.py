"""Whether a part of a recording stands in it twice, as pasting and faulty joining of files leave it."""

from collections.abc import Iterator

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.flight import Flight
from wrenchgap.flight.repeats import every_row_hash
from wrenchgap.flight.row_kernels import runs


def repeated(flight: Flight, shortest: float = 1.0) -> Iterator[Check]:
    """A stretch of `shortest` [s] or more whose samples of the IMU are those of an earlier one, in the same order.

    The last digits of an IMU are noise: single rows come again by chance where it is coarse or at rest, a second of
    them in order does not. Rows are told by hashes of five digits (`flight.repeats`).
    """
    imu = flight.imu
    if imu is None or len(imu.time) < 3:
        return
    hashes = every_row_hash([imu.omega_B, imu.specific_force_B])
    order = np.argsort(hashes, kind="stable")
    again = np.flatnonzero(hashes[order[1:]] == hashes[order[:-1]])
    earlier = np.full(len(hashes), -1)
    earlier[order[1:][again]] = order[:-1][again]
    rows = np.arange(len(hashes))
    apart = np.where(earlier >= 0, rows - earlier, 0)
    least = shortest / imu.period
    follows = (apart[1:] == apart[:-1]) & (apart[1:] > least)  # the row before is a copy from as far away
    copies = [(start, stop) for start, stop in runs(follows) if stop - start >= least]
    if not copies:
        return
    seconds = sum(float(imu.time[stop] - imu.time[start]) for start, stop in copies)
    first = copies[0][0]
    since, back = float(imu.time[first]), float(imu.time[first] - imu.time[first - apart[first + 1]])
    words = f"{seconds:.1f} s of the IMU's samples stand in the log twice, from {since:.1f} s on those of {back:.1f} s"
    ask = "a part of the recording was pasted in again; take the original, or cut it with --between"
    yield Check("repeated", "bad", f"{words} before: {ask}")
