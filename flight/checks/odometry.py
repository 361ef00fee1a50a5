"""An odometry against itself and against the accelerometer: rates, velocity, lengths."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.attitude import ATTITUDE, rate_check
from wrenchgap.flight.checks.motion import AXES_SEARCH, MotionMeans, best_axes, cosine, rms, without_mean
from wrenchgap.flight.checks.remedies import factor, option
from wrenchgap.flight.flight import GRAVITY, Array, Flight


@dataclass(frozen=True)
class OdometryThresholds:
    """From when on an odometry contradicts itself or the accelerometer."""

    standing: float = 0.05
    """Speed [m/s] below which velocities are not compared."""
    shaken: float = 0.3
    """Acceleration [m/s^2] below which lengths are not compared with the accelerometer."""
    empty: float = 0.01
    """Share of the attitude's rates below which the odometry's own are no rates."""
    alike: float = 0.8
    """Cosine from which on two signals are the same up to a factor."""
    factor: float = 1.4
    """Factor beyond which lengths are in another unit or scale: an estimator's filter takes down a fifth."""
    offset: float = 0.1
    """Offset [m/s] of a velocity from which on it matters: times a usual drag of 0.3 / s half of what an accelerometer
    may be off by. Of 42 recorded and simulated logs 41 are below 0.02, the other is 0.09 +- 0.07: doubled, it would
    find the same ones, and miss what bends drag and wind most."""
    sigmas: float = 5.0
    """Standard errors by which such an offset must be beyond zero, from the scatter of its medians over blocks."""


ODOMETRY = OdometryThresholds()


UNITS = {1000.0: "mm", 100.0: "cm"}


def odometry_rate(flight: Flight, seen: MotionMeans | None) -> Iterator[Check]:
    """The odometry's own rates against its attitude."""
    if seen is None or seen.own_rate is None:
        return
    turned, logged = rms(without_mean(seen.rate)), rms(seen.own_rate)
    if logged < ODOMETRY.empty * turned and turned > ATTITUDE.still_rate:
        words = f"Odometry's rates are {logged / turned:.1g} times those of its attitude: nobody fills them in"
        yield Check("odometry-rate", "bad", words, "--topic twist=none")
        return
    found = rate_check("odometry-rate", flight, (seen.rate, seen.own_rate), ("twist",), "rate")
    if found.level != "ok":
        yield found


def velocity(flight: Flight, seen: MotionMeans | None) -> Iterator[Check]:
    """The odometry's velocity against its positions; the accelerometer says which of them is wrong."""
    if seen is None or seen.velocity is None:
        return
    moved, logged = seen.moved, seen.velocity
    if rms(moved) < ODOMETRY.standing and rms(logged) < ODOMETRY.standing:
        return
    if offset := _velocity_offset(seen):
        words = f"Odometry's velocity is off its differentiated position by {offset}, all the time: an estimator's or "
        yield Check("velocity", "bad", f"{words}a radar's bias", "--topic twist=none")
        return
    alike = cosine(moved, logged)
    slope = float(np.sum(logged * moved) / max(np.sum(moved**2), 1e-30))
    misfit = rms(logged - moved) / max(rms(moved), 1e-12)
    said = f"Odometry's velocity is {slope:.3g} times the differentiated position (misfit {100 * misfit:.0f} %)"
    if alike > 0.9 and not _near_one(slope):
        of_velocity, of_position = _scale(seen, seen.acceleration), _scale(seen, seen.curve)
        wrong_position = of_position is not None and not _near_one(of_position)
        wrong_position &= of_velocity is None or _near_one(of_velocity)
        if wrong_position or (of_position is None and slope < 0.02):
            mend = option(flight, _unit(1.0 / slope, "position"), "pose")
        else:
            mend = option(flight, _unit(slope, "velocity"), "twist")
        yield Check("velocity", "bad", f"{said}: another unit or scale", mend)
    elif alike < 0.3 and rms(moved) > 6.0 * ODOMETRY.standing:
        yield Check("velocity", "bad", f"{said}: another frame or vehicle", "--topic twist=none")
    elif abs(slope - 1.0) > 0.15 or misfit > 0.5:
        yield Check("velocity", "warn", f"{said}: another frame, unit or clock.")
    else:
        yield Check("velocity", "ok", f"Odometry's velocity agrees with its position (factor {slope:.2f}).")


def _velocity_offset(seen: MotionMeans) -> str:
    """An offset of the velocity that is constant in E or B, in words; empty where there is none, or where a factor or
    another frame would be as good a reason.
    """  # noqa: D205
    assert seen.velocity is not None
    swings = [v - np.median(v, axis=0) for v in (seen.moved, seen.velocity)]
    slope = float(np.sum(swings[0] * swings[1])) / max(float(np.sum(swings[0] ** 2)), 1e-30)
    if rms(swings[0]) > ODOMETRY.standing and not _near_one(slope):
        return ""
    apart = seen.velocity - seen.moved
    for frame, difference in (("E", apart), ("B", so3.rotate_inverse(seen.attitude, apart))):
        blocks = np.array([np.median(part, axis=0) for part in np.array_split(difference, AXES_SEARCH.blocks)])
        offset = np.median(difference, axis=0)
        error = blocks.std(axis=0, ddof=1) / np.sqrt(len(blocks))
        axis = int(np.argmax(np.abs(offset)))
        clear = abs(offset[axis]) > max(ODOMETRY.offset, ODOMETRY.sigmas * error[axis])
        if clear and rms(difference - offset) < 0.5 * rms(difference):
            return f"{offset[axis]:+.2f} m/s along {'xyz'[axis]} in {frame}"
    return ""


def _near_one(ratio: float) -> bool:
    return 1.0 / ODOMETRY.factor < ratio < ODOMETRY.factor


def _unit(ratio: float, vector: str) -> str:
    """The word for lengths that are `ratio` times what they should be."""
    near = next((word for k, word in UNITS.items() if 0.8 < ratio / k < 1.25), None)
    return near or f"{vector}*{factor(1.0 / ratio)}"


def odometry_scale(flight: Flight, seen: MotionMeans | None) -> Iterator[Check]:
    """Lengths of the odometry against the accelerometer."""
    scale = None if seen is None else _scale(seen, seen.accelerating)
    if seen is None or scale is None:
        yield from [] if seen is None else _position_axes(flight, seen)
        return
    if _near_one(scale):
        yield Check("odometry-scale", "ok", f"Accelerations of the odometry are {scale:.2f} times the accelerometer's.")
        return
    other = None if seen.velocity is None else _scale(seen, seen.curve)
    if other is not None and _near_one(other):
        return  # the positions are right: `velocity` says it
    unit = next((word for k, word in UNITS.items() if 0.7 < scale / k < 1.4), None)
    words = unit or f"position*{factor(1.0 / scale)}"
    if seen.velocity is not None and unit:
        mend = option(flight, words, "pose", "twist")
    else:
        mend = option(flight, words, "pose")
        if seen.velocity is not None:
            mend += f" {option(flight, f'velocity*{factor(1.0 / scale)}', 'twist')}"
    said = f"Accelerations of the odometry are {scale:.3g} times the accelerometer's: its lengths are not in metres"
    yield Check("odometry-scale", "bad", said, mend)


def _position_axes(flight: Flight, seen: MotionMeans) -> Iterator[Check]:
    """Positions whose axes are others than those of the attitude, as of motion capture with y up."""
    if seen.accel is None or np.isnan(seen.accel).any():
        return
    felt = without_mean(so3.rotate(seen.attitude, seen.accel) - np.array([0.0, 0.0, GRAVITY]))
    found = best_axes([(felt, without_mean(seen.accelerating))]) if rms(felt) > ODOMETRY.shaken else None
    if found is None or found.fits < ODOMETRY.alike:
        return
    words = f"Accelerations of the odometry go with the accelerometer's by a cosine of {found.as_is:.2f}, and of "
    words += f"{found.fits:.2f} with positions and velocities read as {found.words}: their axes are not those of the "
    yield Check("inertial-frame", "bad", f"{words}attitude; convert them (z up, as the attitude has it)")


def _scale(seen: MotionMeans, acceleration: Array | None) -> float | None:
    """Accelerations (K, 3) over those that the accelerometer shows; None where they are not alike, or too small."""
    if acceleration is None or seen.accel is None or np.isnan(seen.accel).any():
        return None
    felt = without_mean(so3.rotate(seen.attitude, seen.accel) - np.array([0.0, 0.0, GRAVITY]))
    shown = without_mean(acceleration)
    if rms(felt) < ODOMETRY.shaken or cosine(shown, felt) < ODOMETRY.alike:
        return None
    blocks = zip(*(np.array_split(v, AXES_SEARCH.blocks) for v in (shown, felt)), strict=True)
    logarithms = np.log([rms(a) / max(rms(b), 1e-12) for a, b in blocks])
    return float(np.exp(np.median(logarithms))) if np.std(logarithms) < 0.7 else None
