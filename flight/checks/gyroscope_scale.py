"""The gyroscope against the attitude: its scale, axis by axis (`sensor_scales`), and whether it keeps slow turns.

One that takes its bias off by itself, by a high-pass, loses slow turns. Behind a high-pass of the corner f,
c = 2 pi f, a rate omega is read as g, with the integral G of g:

    dg/dt = domega/dt - c g,    omega - g = c G + a constant.

So what the attitude turns faster than the gyroscope says grows with the angle that the gyroscope has turned, in every
axis by the same c. It looks like a drag on the turning, J c omega. A bias and its drift are taken off both sides in
each block, and what a delay d between the two would make, d dg/dt; an attitude that leaks back to the level makes c
negative. An axis counts where G is more than what remains of the two sides makes as an angle: in a still hover G is the
integral of the gyroscope's noise, and against that the noise itself goes in every block without its mean (Dickey and
Fuller, J. Am. Stat. Assoc. 74, 1979).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.clipping import is_clipped
from wrenchgap.flight.checks.remedies import factor, option, turns
from wrenchgap.flight.checks.sensor_scales import Scale, sensor_scales
from wrenchgap.flight.checks.sensor_windows import SCALE, comparable_blocks, detrended, odometry_delay
from wrenchgap.flight.flight import Flight
from wrenchgap.flight.stamps import interpolated

BEFORE = ("body-frame", "inertial-frame", "clock-unit")
"""Checks that leave no scale to speak of where they are bad."""
BEFORE_TURNS = (*BEFORE, "gyroscope", "gyroscope-scale")
"""Checks that leave no slow turns to speak of where they are bad."""


def gyroscope_scale(flight: Flight, known: Sequence[Check]) -> Iterator[Check]:
    """Scale of the gyroscope against the attitude; nothing where `known` says that it is another quantity."""
    bad = {c.name for c in known if c.level == "bad"}
    if flight.imu is None or not bad.isdisjoint(BEFORE):
        return
    scales = sensor_scales(flight, "gyroscope")
    if scales is not None and any(scale.unsteady for scale in scales.values()):
        yield _unsteady(scales)
    elif "gyroscope" in bad:
        return
    elif scales is None:
        why = "no attitude is logged" if flight.odometry is None else "attitude or IMU come too slowly or too briefly"
        yield Check("gyroscope-scale", "ok", f"Not tested: {why}.")
    elif off := {axis: scale for axis, scale in scales.items() if scale.off}:
        yield _wrong(flight, scales, off, is_clipped(known, "gyroscope"))
    else:
        yield Check("gyroscope-scale", "ok", _bounds_in_words(scales))


def without_factor(found: Sequence[Check]) -> list[Check]:
    """The checks; of a gyroscope that is clipped, or has no one scale, none offers a factor."""
    unsteady = any(c.name == "gyroscope-scale" and c.level != "ok" and c.mend is None for c in found)
    if not unsteady and not is_clipped(found, "gyroscope"):
        return [*found]
    return [replace(c, mend=None) if c.name == "gyroscope" and "unit or scale" in c.words else c for c in found]


def _bounds_in_words(scales: dict[str, Scale]) -> str:
    """The bounds of every axis, and of which axes they say nothing."""
    known, unknown = list[str](), list[str]()
    for axis, b in ((axis, scale.best) for axis, scale in scales.items()):
        said = f"{axis} {b.low:.3f} to {b.high:.3f}" if 0.0 < b.low < b.high < 2.0 else axis
        (known if b.width < SCALE.widest else unknown).append(said)
    words = [f"No axis is off by {100 * SCALE.reported:g} % beyond doubt ({', '.join(known)})."] if known else []
    words += [f"Not known, for too little motion next to noise: {', '.join(unknown)}."] if unknown else []
    return " ".join(words)


def _unsteady(scales: dict[str, Scale]) -> Check:
    """Of axes that have no one scale."""
    faults = {axis: fault for axis, scale in scales.items() if (fault := scale.fault()) is not None}
    said = "; ".join(f"{axis} {fault.words}" for axis, fault in faults.items())
    words = f"The gyroscope is not the attitude's rate: {said}. No factor mends that: "
    words += "one of the two failed or was set anew, or the sensor reaches the end of its range"
    worst = max(fault.size for fault in faults.values())
    return Check("gyroscope-scale", "bad" if worst > SCALE.refused else "warn", words)


def _wrong(flight: Flight, scales: dict[str, Scale], off: dict[str, Scale], clipped: bool) -> Check:
    """Of axes `off` that have a wrong scale; what mends it is no factor where the sensor is `clipped`."""
    furthest = max(abs(scale.value - 1.0) for scale in off.values())
    said = ", ".join(f"{axis} {scale.value:.3f}" for axis, scale in off.items())
    words = f"The gyroscope is not the attitude's rate: scale {said}, steady over time, size and frequency; its "
    words += "datasheet's sensitivity, or the full-scale range that the driver assumes, may be another"
    common, mend = float(np.mean([scale.value for scale in off.values()])), None
    if clipped:
        words += ", or what it missed beyond its range (see `clipped`)"
    elif all(scale.allows(common) for scale in scales.values()):
        mend = option(flight, f"gyro*{factor(1.0 / common)}", "imu")
    elif not turns(flight, "imu", "gyroscope"):  # else the sensor's axes are not the body's
        mend = option(flight, ",".join(f"gyro.{axis}*{factor(1.0 / s.value)}" for axis, s in off.items()), "imu")
    return Check("gyroscope-scale", "bad" if furthest > SCALE.refused else "warn", words, mend)


def high_pass(flight: Flight) -> tuple[float, float] | None:
    """Corner [Hz] of the gyroscope's high-pass by the attitude, and its standard deviation; None where nothing is to be
    compared, or the axes that say something do not agree that there is one.
    """  # noqa: D205
    blocks = comparable_blocks(flight, "gyroscope")
    if not blocks:
        return None
    shift, sums, rates = odometry_delay(blocks) or 0.0, [], []  # slow turns that are lost may look like a long delay
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
        rates.append((middle, step, angle, faster))
        for rows in np.array_split(np.arange(len(middle)), block.segments):
            sums.append((np.sum(angle[rows] ** 2, axis=0), np.sum(angle[rows] * faster[rows], axis=0)))
    square, product = np.transpose(sums, (1, 0, 2))
    total, count = np.sum(square, axis=0), len(sums)
    if np.any(total <= 0.0):
        return None
    corner = np.sum(product, axis=0) / total
    std = np.sqrt(np.sum((product - corner * square) ** 2, axis=0) * count / (count - 1)) / total
    random_walk = np.zeros(3)  # of the angle, from what the regression leaves of the rate
    for time, step, angle, faster in rates:
        walk = detrended(time, np.cumsum((faster - corner * angle) * step, axis=0))
        random_walk += np.sum(walk**2, axis=0)
    counts = total > SCALE.turned**2 * random_walk
    if not counts.any() or np.any(corner[counts] < 0.0):
        return None
    weight = np.where(counts, 1.0 / np.maximum(std, 1e-12) ** 2, 0.0)
    mean, mean_std = np.sum(weight * corner) / np.sum(weight), 1.0 / np.sqrt(np.sum(weight))
    return float(mean) / (2.0 * np.pi), float(mean_std) / (2.0 * np.pi)


def slow_turns(flight: Flight, known: Sequence[Check]) -> Iterator[Check]:
    """Whether the gyroscope keeps the slow turns that the attitude shows; nothing where `known` says that it reads
    another quantity.
    """  # noqa: D205
    wrong = any(check.name in BEFORE_TURNS and check.level == "bad" for check in known)
    found = None if flight.imu is None or wrong else high_pass(flight)
    if found is not None and found[0] > max(SCALE.least_corner, SCALE.sigmas * found[1]):
        words = f"The gyroscope loses slow turns, as behind a high-pass of {found[0]:.2g} Hz, by the "
        words += "attitude: that looks like a drag on turning. Switch off what takes its bias away in flight"
        yield Check("gyroscope-scale", "bad", words)


def gyroscope_bias(flight: Flight, known: Sequence[Check], least: float = 0.05, sigmas: float = 5.0) -> Iterator[Check]:
    """Whether the gyroscope reads more than the attitude turns, all the time: by `least` [rad/s] and `sigmas` standard
    errors over blocks. Of 16 recorded flights the largest is 0.037 +- 0.03; half of `least` says it of none either.
    """  # noqa: D205
    wrong = any(check.name in BEFORE_TURNS and check.level != "ok" for check in known)
    blocks = [] if flight.imu is None or wrong else comparable_blocks(flight, "gyroscope")
    if len(blocks) < 3:
        return
    shift, biases = odometry_delay(blocks) or 0.0, []
    for block in blocks:
        time = block.time - shift
        more = interpolated(time, block.sensor_time, block.integrals) - block.reference
        biases.append(np.polyfit(time - time.mean(), more, 1)[0])
    mean, std = np.mean(biases, axis=0), np.std(biases, axis=0, ddof=1) / np.sqrt(len(biases))
    if np.any(off := np.abs(mean) > np.maximum(least, sigmas * std)):
        said = " and ".join(f"{mean[k]:+.2f} rad/s about {'xyz'[k]}" for k in np.flatnonzero(off))
        words = f"The gyroscope reads {said} that the attitude does not turn: a bias that nobody took off"
        yield Check("gyroscope-scale", "warn", f"{words}: calibrate it at rest.")
