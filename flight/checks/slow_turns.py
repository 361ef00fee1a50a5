"""A gyroscope that loses slow turns: one that takes its bias off by itself, by a high-pass.

Behind a high-pass of the corner f, c = 2 pi f, a rate omega is read as g, with the integral G of g:

    dg/dt = domega/dt - c g,    omega - g = c G + a constant.

So what the attitude turns faster than the gyroscope says grows with the angle that the gyroscope has turned, in every
axis by the same c. It looks like a drag on the turning, J c omega. A bias and its drift are taken off both sides in
each block, and what a delay d between the two would make, d dg/dt; an attitude that leaks back to the level makes c
negative.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks import gyroscope_scale
from wrenchgap.flight.checks.sensor_windows import SCALE, comparable_blocks, detrended, odometry_delay
from wrenchgap.flight.flight import Flight
from wrenchgap.flight.stamps import interpolated

BEFORE = (*gyroscope_scale.BEFORE, "gyroscope", "gyroscope-scale")
"""Checks that leave no slow turns to speak of where they are bad."""


def high_pass(flight: Flight) -> tuple[float, float] | None:
    """Corner [Hz] of the gyroscope's high-pass by the attitude, and its standard deviation; None where nothing is to be
    compared, or the axes that say something do not agree that there is one.
    """  # noqa: D205
    blocks = comparable_blocks(flight, "gyroscope")
    if not blocks:
        return None
    shift, sums = odometry_delay(blocks) or 0.0, []  # slow turns that are lost may look like a long delay
    for block in blocks:
        time = block.time - shift
        turned = interpolated(time, block.sensor_time, block.integrals)
        middle = 0.5 * (time[1:] + time[:-1])
        step = np.diff(time)[:, None]
        change = detrended(middle, np.gradient(np.diff(turned, axis=0) / step, middle, axis=0))
        angle, faster = (
            values - change * np.sum(change * values, axis=0) / np.maximum(np.sum(change**2, axis=0), 1e-30)
            for values in (
                detrended(middle, 0.5 * (turned[1:] + turned[:-1])),
                detrended(middle, np.diff(block.reference - turned, axis=0) / step),
            )
        )
        for rows in np.array_split(np.arange(len(middle)), block.segments):
            sums.append((np.sum(angle[rows] ** 2, axis=0), np.sum(angle[rows] * faster[rows], axis=0)))
    square, product = np.transpose(sums, (1, 0, 2))
    total, count = np.sum(square, axis=0), len(sums)
    if np.any(total <= 0.0):
        return None
    corner = np.sum(product, axis=0) / total
    std = np.sqrt(np.sum((product - corner * square) ** 2, axis=0) * count / (count - 1)) / total
    weight = 1.0 / np.maximum(std, 1e-12) ** 2
    mean, mean_std = np.sum(weight * corner) / np.sum(weight), 1.0 / np.sqrt(np.sum(weight))
    if np.any(corner < 0.0):
        return None
    return float(mean) / (2.0 * np.pi), float(mean_std) / (2.0 * np.pi)


def slow_turns(flight: Flight, known: Sequence[Check]) -> Iterator[Check]:
    """Whether the gyroscope keeps the slow turns that the attitude shows; nothing where `known` says that it reads
    another quantity.
    """  # noqa: D205
    wrong = any(check.name in BEFORE and check.level == "bad" for check in known)
    found = None if flight.imu is None or wrong else high_pass(flight)
    if found is not None and found[0] > max(SCALE.least_corner, SCALE.sigmas * found[1]):
        words = f"The gyroscope loses slow turns, as behind a high-pass of {found[0]:.2g} Hz, by the "
        words += "attitude: that looks like a drag on turning. Switch off what takes its bias away in flight"
        yield Check("gyroscope-scale", "bad", words)
