"""Flat tops: channels that reached the end of their range, or of what was logged of them.

A sensor that reached the end of its range reads one value, over and over, while the motion goes on. It is clipped where
its largest (or smallest) value comes in runs of equal samples while other axes go on, and much more often than the
values next to it: noise and quantisation repeat those as often, at rest everything stands still, and a sensor that is
logged faster than it reads repeats every value. What a flight did beyond is not in the log. Nor may it be where the
commands of several rotors stop at one highest value below full throttle, or where one rotor or arm stops at a value
that others go beyond.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.flight.row_kernels import runs


@dataclass(frozen=True)
class ClippingThresholds:
    """From when on repeated values at the end of a channel's range are clipping."""

    fewest_samples: int = 6
    """In runs at the end of the range, at least: white noise does not repeat its largest value. With 3 or 12, and
    `oftener` halved or doubled, the same logs are found among those of benchmarks/meaning (seed 31) and 78 recorded
    ones."""
    largest_share: float = 0.5
    """Share of the samples: a channel that hardly ever changes is another check's (`constant-channel`, `frozen`)."""
    most_of_one: float = 0.9
    """The same of a rotor or an arm that stops where others do not: more is a channel of one value."""
    neighbours: int = 10
    """Values next to the end of the range that it is compared with."""
    oftener: float = 4.0
    """How many times as often as each of its neighbours the end of the range must come."""
    stops: float = 0.05
    """Share of clipped samples from which on the log stops: the rms of such a channel is off by several per cent."""


CLIPPING = ClippingThresholds()


@dataclass(frozen=True)
class Clipped:
    """A channel at the upper (`sign` 1) or lower (-1) end of its range: the `value`, and how many of its samples are
    there, `count` and `share`.
    """  # noqa: D205

    name: str
    sign: float
    value: float
    count: int
    share: float


def clipped(flight: Flight) -> Iterator[Check]:
    """Axes of gyroscope and accelerometer that are clipped."""
    if flight.imu is None:
        return
    readings = (flight.imu.omega_B, flight.imu.specific_force_B)
    for sensor, unit, values in zip(("gyroscope", "accelerometer"), ("rad/s", "m/s^2"), readings, strict=True):
        found = [one for axis, column in zip("xyz", values.T, strict=True) for one in flat_tops(axis, column, readings)]
        if found:
            said = ", ".join(f"{c.name} at {c.value:+.4g} {unit} in {c.count} samples" for c in found)
            share = max(c.share for c in found)
            words = f"{sensor} reaches the end of its range: {said} ({100 * share:.2g} %); what it missed is in no "
            words += "filter or fit: set a larger range in the driver"
            yield Check("clipped", "bad" if share > CLIPPING.stops else "warn", words)


def is_clipped(found: Sequence[Check], sensor: str) -> bool:
    """Whether `clipped` has found the sensor."""
    return any(c.name == "clipped" and c.words.startswith(sensor) for c in found)


def flat_tops(
    name: str, values: Array, readings: Sequence[Array], largest_share: float = CLIPPING.largest_share
) -> Iterator[Clipped]:
    """The ends of a channel (N,) at which it is clipped; `readings` (N, C) are the channels of all sensors.

    With more than `largest_share` of the samples at an end it is not clipped.
    """
    for sign in (1.0, -1.0):
        end = float(values.max() if sign > 0.0 else values.min())
        at = values == end
        count, most = int(np.count_nonzero(at)), largest_share * len(values)
        if not np.isfinite(end) or end == 0.0 or not CLIPPING.fewest_samples <= count < most:
            continue  # no range ends at zero: a simulator without noise rests there
        repeated = [slice(a, b) for a, b in runs(at) if b - a > 1]
        going_on = (r for r in repeated if any(np.any(np.abs(np.diff(v[r], axis=0)) > 0.0) for v in readings))
        flat = sum(r.stop - r.start for r in going_on)
        if flat >= CLIPPING.fewest_samples and count > CLIPPING.oftener * _most_beside(sign * values, sign * end):
            yield Clipped(name, sign, end, count, count / len(values))


def _most_beside(values: Array, top: float) -> int:
    """How often the most frequent of the `CLIPPING.neighbours` values below the largest comes."""
    count = min(len(values), 50 * CLIPPING.neighbours + int(np.sum(values == top)))
    high = np.partition(values, len(values) - count)[len(values) - count :]
    _, often = np.unique(high[high < top], return_counts=True)
    return int(max(often[-CLIPPING.neighbours :], default=0))


def limited(flight: Flight) -> Iterator[Check]:
    """Commands of several rotors that stop at one highest value; of single rotors and arms that stop where others do
    not. Which speed [rad/s] is full throttle a model file says (`stopped_together`).
    """  # noqa: D205
    if flight.actuators is None:
        return
    speeds = flight.actuators.rotor_speed
    if flight.actuators.unit != "rad/s":
        yield from stopped_together(speeds, 1.0)
    for kind, values in (("rotor_speed", speeds), ("tilt", flight.actuators.tilt)):
        yield from _stopped(kind, values)


def stopped_together(speeds: Array, full: float, rounding: float = 1e-3) -> Iterator[Check]:
    """Commands (N, R) of several rotors that stop at one highest value, which is not full throttle, `full`, to the
    relative `rounding` of either.
    """  # noqa: D205
    top = float(speeds.max(initial=0.0))
    found = [c for v in speeds.T for c in flat_tops("", v, (speeds,)) if c.value == top]
    if len(found) > 1 and abs(top - full) > rounding * full:
        share = 100.0 * float(np.mean(np.any(speeds == top, axis=1)))
        words = f"the commands of {len(found)} rotors stop at {top:.4g}, one or more of them in {share:.2g} % "
        words += "of the samples: is it their limit, or that of what was logged? What the rotors "
        words += "made beyond is in no prediction"
        yield Check("clipped", "warn", words)


def _stopped(kind: str, values: Array) -> Iterator[Check]:
    """Single ones of these commands (N, C) that stop at a value which others go beyond; of rotors at a highest one, as
    all stand at their idle speeds before a flight.
    """  # noqa: D205
    ends = {1.0: values.max(initial=-np.inf), -1.0: values.min(initial=np.inf)}
    flat = [c for k, v in enumerate(values.T) for c in flat_tops(f"{kind} {k}", v, (values,), CLIPPING.most_of_one)]
    found = [c for c in flat if c.value != ends[c.sign] and (c.sign > 0.0 or kind == "tilt")]
    if found and len({c.name for c in found}) < values.shape[1] / 2:
        said = " and ".join(f"{c.name} stops at {c.value:.4g} in {100.0 * c.share:.2g} % of the samples" for c in found)
        words = f"{said}, and others go beyond: is it a limit of its own, or of what was logged? "
        words += "What was made beyond is in no prediction"
        worst = max(c.share for c in found)
        yield Check("clipped", "bad" if worst > CLIPPING.stops else "warn", words)
