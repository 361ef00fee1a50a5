"""Flat tops: a sensor that reached the end of its range reads one value, over and over, while the motion goes on.

A channel is clipped where its largest (or smallest) value comes in runs of equal samples while other axes go on, and
much more often than the values next to it: noise and quantisation repeat those as often, at rest everything stands
still, and a sensor that is logged faster than it reads repeats every value. What a flight did beyond is not in the log.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.flight import Array, Flight


@dataclass(frozen=True)
class ClippingThresholds:
    """From when on repeated values at the end of a channel's range are clipping."""

    fewest_samples: int = 6
    """In runs at the end of the range, at least: white noise does not repeat its largest value. With 3 or 12, and
    `oftener` halved or doubled, the same logs are found among those of benchmarks/meaning (seed 31) and 78 recorded
    ones."""
    largest_share: float = 0.5
    """Share of the samples: a channel that hardly ever changes is another check's (`constant-channel`, `frozen`)."""
    neighbours: int = 10
    """Values next to the end of the range that it is compared with."""
    oftener: float = 4.0
    """How many times as often as each of its neighbours the end of the range must come."""
    stops: float = 0.05
    """Share of clipped samples from which on the log stops: the rms of such a channel is off by several per cent."""


CLIPPING = ClippingThresholds()


@dataclass(frozen=True)
class Clipped:
    """A channel at one end of its range: the `value`, and the `count` of its samples there, of `total`."""

    name: str
    value: float
    count: int
    total: int

    @property
    def share(self) -> float:
        """Of the samples."""
        return self.count / self.total


def clipped(flight: Flight) -> Iterator[Check]:
    """Axes of gyroscope and accelerometer that are clipped."""
    if flight.imu is None:
        return
    readings = (flight.imu.omega_B, flight.imu.specific_force_B)
    for sensor, unit, values in (
        ("gyroscope", "rad/s", flight.imu.omega_B),
        ("accelerometer", "m/s^2", flight.imu.specific_force_B),
    ):
        found = [one for axis, column in zip("xyz", values.T, strict=True) for one in flat_tops(axis, column, readings)]
        if not found:
            continue
        said = ", ".join(f"{c.name} at {c.value:+.4g} {unit} in {c.count} samples" for c in found)
        share = max(c.share for c in found)
        words = (
            f"{sensor} reaches the end of its range: {said} ({100 * share:.2g} %); what it missed is in no filter or "
        )
        words += "fit: set a larger range in the driver"
        yield Check("clipped", "bad" if share > CLIPPING.stops else "warn", words)


def flat_tops(name: str, values: Array, readings: Sequence[Array]) -> Iterator[Clipped]:
    """The ends of a channel (N,) at which it is clipped; `readings` (N, C) are the channels of all sensors."""
    for sign in (1.0, -1.0):
        end = float(values.max() if sign > 0.0 else values.min())
        at = values == end
        if (
            not np.isfinite(end)
            or end == 0.0
            or not CLIPPING.fewest_samples <= np.count_nonzero(at) < CLIPPING.largest_share * len(values)
        ):
            continue  # no range ends at zero: a simulator without noise rests there
        edges = np.flatnonzero(np.diff(np.concatenate(([False], at, [False])).astype(int)))
        runs = zip(edges[::2], edges[1::2], strict=True)
        flat = sum(b - a for a, b in runs if b - a > 1 and any(_moves(v[a:b]) for v in readings))
        if flat >= CLIPPING.fewest_samples and at.sum() > CLIPPING.oftener * _most_beside(sign * values, sign * end):
            yield Clipped(name, end, int(at.sum()), len(values))


def _moves(readings: Array) -> bool:
    """Whether any channel changes."""
    return bool(np.any(np.abs(np.diff(readings, axis=0)) > 0.0))


def _most_beside(values: Array, top: float) -> int:
    """How often the most frequent of the `CLIPPING.neighbours` values below the largest comes."""
    count = min(len(values), 50 * CLIPPING.neighbours + int(np.sum(values == top)))
    high = np.partition(values, len(values) - count)[len(values) - count :]
    _, often = np.unique(high[high < top], return_counts=True)
    return int(max(often[-CLIPPING.neighbours :], default=0))
