"""The same flight under two names: a copy, a cut, or the same samples under other stamps.

What was measured does not come twice: the last digits of an IMU are noise. So two logs are of one flight where they
share rows of samples, whatever their names, formats, stamps and bytes are. Rows are rounded to five digits, since a
text file or another type of number keeps no more, and told by a hash. Of a long log the smallest hashes are kept: of
the same rows these are the same, wherever a cut begins (bottom-k sketch; Broder, "On the resemblance and containment
of documents", 1997).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import Array, Flight

Hashes = NDArray[np.uint64]


@dataclass(frozen=True)
class SketchSettings:
    """How two logs are found to be of one flight."""

    kept: int = 32768
    """Hashes of a series that are kept, at most."""
    fleet: int = 256
    """Hashes that are kept of each of many logs (2 KB): `fewest` of them are a fifth of a flight."""
    fewest: int = 50
    """Rows that two series must share: less is chance, a rest, or a moment that two cuts have in common."""
    shared: float = 0.05
    """Share of the rows of the shorter one from which on two logs are of one flight."""
    dropped_bits: int = 7
    """Of the 24 bits of a number in single precision: what is kept, 17, are five digits."""


SKETCH = SketchSettings()


ODD = np.uint64(0x9E3779B97F4A7C15)
"""By which a row's numbers are told apart from the same in another order."""


@dataclass(frozen=True)
class Sketch:
    """The smallest hashes of the distinct rows of each role, ascending."""

    hashes: dict[str, Hashes]

    def shared(self, other: Sketch) -> float:
        """Share of the shorter one's rows that the other has too: the least of all roles that both have.

        From the hashes up to where both are whole.
        """
        shares = []
        for role in self.hashes.keys() & other.hashes.keys():
            both = self.hashes[role], other.hashes[role]
            whole = min((h[-1] for h in both if len(h) == SKETCH.kept), default=np.uint64(2**64 - 1))
            a, b = (h[h <= whole] for h in both)
            common = len(np.intersect1d(a, b, assume_unique=True))
            shares.append(common / min(len(a), len(b)) if common >= SKETCH.fewest else 0.0)
        return min(shares, default=0.0)


def sketch(flight: Flight) -> Sketch:
    """What tells a flight from others, by its samples alone."""
    columns = {
        "imu": ("omega_B", "specific_force_B"),
        "commanded": ("wrench_B",),
        "actuators": ("rotor_speed", "tilt"),
        "odometry": ("position_E", "quat_EB"),
    }
    played = flight.series()
    if "imu" in played:
        played.pop("odometry", None)
    found = {
        role: row_hashes([getattr(played[role], name) for name in names])
        for role, names in columns.items()
        if role in played
    }
    return Sketch({role: hashes for role, hashes in found.items() if len(hashes) >= SKETCH.fewest})


def signature(flight: Flight) -> NDArray[np.int64]:
    """The smallest hashes (up to `SKETCH.fleet`,) of the IMU's samples, or the commands' without one, to find a flight
    again among many logs.
    """  # noqa: D205
    found = sketch(flight).hashes
    return next(iter(found.values()), np.empty(0, dtype=np.uint64))[: SKETCH.fleet].view(np.int64)


def row_hashes(columns: Sequence[Array]) -> Hashes:
    """The smallest `SKETCH.kept` hashes of the distinct rows of arrays (N, C) side by side, ascending."""
    hashes = every_row_hash(columns)
    some = min(len(hashes), 4 * SKETCH.kept)
    if some < len(hashes):  # hours of log need not be sorted
        fewer = np.unique(np.partition(hashes, some)[:some])
        hashes = hashes if len(fewer) < SKETCH.kept else fewer
    return np.unique(hashes)[: SKETCH.kept]


def every_row_hash(columns: Sequence[Array]) -> Hashes:
    """A hash (N,) of each row of arrays (N, C) side by side, of the first five digits of its numbers."""
    total: Hashes = np.zeros(len(columns[0]), dtype=np.uint64)
    half = np.uint32(1 << (SKETCH.dropped_bits - 1))
    for column in (column for values in columns for column in values.T):
        bits = (column.astype(np.float32) + np.float32(0.0)).view(np.uint32)  # -0.0 is 0.0
        total *= ODD
        total += (bits + half) >> np.uint32(SKETCH.dropped_bits)
    return _mixed(total)


def _mixed(numbers: Hashes) -> Hashes:
    """A permutation of 64-bit numbers that looks random (finaliser of SplitMix64; Steele, Lea and Flood 2014)."""
    numbers = (numbers + ODD).astype(np.uint64)
    numbers = (numbers ^ (numbers >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    numbers = (numbers ^ (numbers >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(numbers ^ (numbers >> np.uint64(31)))


class Repeats:
    """Flights as they are given, each once."""

    def __init__(self, flights: Sequence[Flight] = ()) -> None:
        self._known = [(flight, sketch(flight)) for flight in flights]

    def refuse(self, flight: Flight, where: str = "", remedy: str = "name each flight once") -> None:
        """Raise LogError where the flight is one of those before, by its bytes or its samples; else note it."""
        own = sketch(flight)
        for other, known in self._known:
            share = 1.0 if other.content_hash == flight.content_hash else own.shared(known)
            if share > SKETCH.shared:
                both = f"{100 * share:.0f} % of the shorter one's samples are in both"
                raise LogError(f"{where or flight.path}: is the same flight as {other.path} ({both}); {remedy}")
        self._known.append((flight, own))


def refuse_seen(fitted: Sequence[Flight], unseen: Sequence[Flight]) -> None:
    """Raise LogError where a flight that shall test was fitted as well."""
    if not unseen:
        return
    known = Repeats(fitted)
    for flight in unseen:
        known.refuse(flight, remedy="test on another flight than those that are fitted")
