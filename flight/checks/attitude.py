"""IMU against attitude: units, axes, gravity, frames, order of the quaternion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.motion import MotionMeans, best_axes, cosine, rms, without_mean
from wrenchgap.flight.checks.remedies import factor, option
from wrenchgap.flight.filters import smooth
from wrenchgap.flight.flight import AXES, GRAVITY, Array, Flight
from wrenchgap.flight.mapping_units import FRD, NED
from wrenchgap.flight.row_kernels import empty, lengths
from wrenchgap.flight.stamps import spread
from wrenchgap.flight.unmeasured import unmeasured_axes

DEGREES = 180.0 / np.pi


@dataclass(frozen=True)
class AttitudeThresholds:
    """From when on IMU and attitude contradict each other."""

    rows: int = 12_000
    """Rows of an IMU from which its unit is told."""
    run: int = 4_000
    """Rows of each run of them; the runs are spread over the flight."""
    still_rate: float = 0.03
    """Rate [rad/s] below which an attitude tells nothing of a gyroscope."""
    upright_deg: float = 15.0
    """Angle from up [deg] within which the median specific force, rotated to E, points up."""
    same_motion: float = 0.8
    """Cosine between the rates of attitude and gyroscope from which on they show one motion."""
    rate_factor: float = 1.25
    """Factor between rates of attitude and gyroscope from which on they are not said to agree. Of 78 recorded logs two
    are beyond, where the attitude's noise is half of its rate; at 1.5 none of these, at 1.12 three healthy ones
    more."""
    steady: float = 0.35
    """Spread of the size of a specific force over its mean below which it has gravity in it."""


ATTITUDE = AttitudeThresholds()


LARGEST = 5.0 * GRAVITY
"""Median specific force that no flight has: an odometry that says so is not in metres, and is no measure of an IMU."""


def accelerometer_unit(flight: Flight, seen: MotionMeans | None) -> Iterator[Check]:
    """Unit, and gravity."""
    imu = flight.imu
    if imu is None or "force_z" in unmeasured_axes(flight):
        return
    absent = empty(imu.specific_force_B)
    values = imu.specific_force_B[:, ~absent] if absent.any() else imu.specific_force_B
    parts = spread(len(values), ATTITUDE.rows, ATTITUDE.run)
    size = np.concatenate([lengths(smooth(imu.time[rows], values[rows])) for rows in parts])
    median = float(np.median(size))
    described = f"Median specific force is {median:.2f} m/s^2"
    expected = GRAVITY if seen is None else float(np.median(lengths(seen.force())))
    expected = expected if expected < LARGEST else GRAVITY
    if _without_gravity(seen, size):
        instead = "--topic imu=none" if flight.odometry is not None else "--unmeasured force_x,force_y,force_z"
        yield Check("accelerometer-unit", "bad", f"{described}: gravity was removed; record the raw one", instead)
    elif 0.8 < median / max(expected / GRAVITY, 0.1) < 1.25 and median < 4.0:
        yield Check("accelerometer-unit", "bad", f"{described}: it is in units of g", option(flight, "g", "imu"))
    elif median < 3.0 and expected > 6.0:
        yield Check(
            "accelerometer-unit", "bad", f"{described}, expected about {expected:.2f}: its unit is unknown",
            option(flight, f"accel*{factor(expected / max(median, 1e-9))}", "imu"),
        )  # fmt: skip
    elif median > 100.0 and 0.7 < median / (1000.0 * expected / GRAVITY) < 1.4:
        yield Check("accelerometer-unit", "bad", f"{described}: it is in milli-g", option(flight, "mg", "imu"))
    elif not 0.7 < median / expected < 1.6:
        level = "bad" if not 0.4 < median / expected < 2.5 else "warn"
        mend = option(flight, f"accel*{factor(expected / median)}", "imu") if level == "bad" else None
        words = f"{described}, expected about {expected:.2f}: check its unit and scale."
        yield Check("accelerometer-unit", level, words, mend)  # type: ignore[arg-type]
    else:
        yield Check("accelerometer-unit", "ok", f"{described}.")


def _without_gravity(seen: MotionMeans | None, size: Array) -> bool:
    """Whether the accelerometer shows the acceleration alone: the odometry tells, else that its size is no constant."""
    if seen is not None and seen.accel is not None and not np.isnan(seen.accel).any():
        with_it, without = seen.force(), seen.force(gravity=0.0)
        if rms(without) > 0.3 and rms(seen.accel) > 0.3:
            fits = cosine(without, seen.accel)
            return fits > 0.7 and fits > cosine(with_it, seen.accel) + 0.1 and rms(seen.accel) < 0.6 * rms(with_it)
    return float(np.median(size)) < 3.0 and float(np.std(size)) > ATTITUDE.steady * float(np.mean(size))


@dataclass(frozen=True)
class Reading:
    """One way to read an attitude: words for its topic, whether the IMU is forward-right-down, and how well it fits."""

    words: str
    imu_down: bool
    gyro: float
    up: float


def frames(flight: Flight, seen: MotionMeans | None) -> Iterator[Check]:
    """Axes of the IMU, and the attitude's frames."""
    imu = flight.imu
    if imu is None or "force_z" in unmeasured_axes(flight):
        return
    force_z = float(np.median(imu.specific_force_B[:, 2]))
    if seen is None or seen.gyro is None or seen.accel is None or np.isnan([*seen.gyro, *seen.accel]).any():
        if force_z < -0.3 * GRAVITY and not _without_gravity(None, lengths(imu.specific_force_B)):
            yield _upside_down(flight, force_z)
        return
    away = _away_from_up(seen.attitude, seen.accel)
    if away is None:
        return
    together, alone = _turned(flight, seen)
    moving = rms(without_mean(seen.rate)) > ATTITUDE.still_rate
    alike = cosine(without_mean(seen.rate), without_mean(seen.gyro)) if moving else 1.0
    best = _best_reading(seen, force_z) if away > ATTITUDE.upright_deg or alike < ATTITUDE.same_motion else None
    if together is not None and (best is None or best.imu_down or together[1] > best.gyro - 0.02):
        yield together[0]
    elif best is not None and (best.words or best.imu_down):
        yield from _as_read(flight, best, away, force_z)
    elif alone is not None:
        yield alone[0]
    elif away > ATTITUDE.upright_deg:
        hint = "the attitude is not body to east-north-up (NED, inverted, or another quaternion order), and no reading "
        words = f"Rotated to E, the median specific force points {away:.0f} deg away from up"
        yield Check("inertial-frame", "bad", f"{words}: {hint}of it fits the IMU")
    else:
        yield Check("body-frame", "ok", "The IMU turns as the attitude does.")
        yield Check("inertial-frame", "ok", f"Specific force, rotated to E, points up within {away:.1f} deg.")


def _upside_down(flight: Flight, force_z: float) -> Check:
    words = f"Median specific force along body z is {force_z:.2f} m/s^2: the axes are forward-right-down"
    return Check("body-frame", "bad", words, option(flight, "frd", "imu"))


def _best_reading(seen: MotionMeans, force_z: float) -> Reading | None:
    """The reading of attitude and IMU that fits; where the IMU reads down in hover, one that has it so."""
    tried = [_reading(seen, words, down) for words in WORLDS for down in (False, True)]
    still = rms(without_mean(seen.rate)) < ATTITUDE.still_rate
    fitting = [r for r in tried if r.up < ATTITUDE.upright_deg and (r.gyro > ATTITUDE.same_motion or still)]
    likely = (force_z < 0.0,)
    return max(fitting, key=lambda r: (round(r.gyro, 1), r.imu_down in likely, -len(r.words)), default=None)


def _as_read(flight: Flight, best: Reading, away: float, force_z: float) -> Iterator[Check]:
    """What is wrong with an attitude, or an IMU, that fits when it is read otherwise."""
    if best.imu_down:
        yield _upside_down(flight, force_z)
    if best.words:
        parts = ("pose", "twist") if "twist" in flight.mapping or not flight.mapping else ("pose",)
        words = (
            f"Rotated to E, the median specific force points {away:.0f} deg away from up, or the attitude turns unlike "
            f"the gyroscope; read as {best.words} it points up within {best.up:.1f} deg and turns alike (cosine "
            f"{best.gyro:.2f})"
        )
        yield Check("inertial-frame", "bad", words, option(flight, best.words, *parts))


WORLDS = (
    *("", "frd", "ned", "ned,frd", "inverse", "wxyz", "wxyz,inverse"),
    *("wxyz,ned,frd", "wxyz,ned", "wxyz,frd", "inverse,ned,frd"),
)
"""Ways to read a pose."""


def _reading(seen: MotionMeans, words: str, down: bool) -> Reading:
    """How well rates and specific force fit where the pose is read in this way."""
    assert seen.gyro is not None
    assert seen.accel is not None
    quat = seen.attitude
    rate = seen.rate
    if "wxyz" in words:  # what was taken for x y z w was w x y z
        quat = quat[:, [1, 2, 3, 0]]
        rate = _rates_of(seen, quat)
    if "inverse" in words:
        quat = so3.conjugate(quat)
        rate = -so3.rotate_inverse(quat, rate) if "wxyz" not in words else _rates_of(seen, quat)
    if "ned" in words:
        quat = so3.multiply(np.tile(so3.from_matrix(NED), (len(quat), 1)), quat)
    if "frd" in words:
        quat = so3.multiply(quat, np.tile(so3.from_matrix(FRD), (len(quat), 1)))
        rate = rate @ FRD
    gyro, accel = (v @ FRD if down else v for v in (seen.gyro, seen.accel))
    up = _away_from_up(quat, accel)
    return Reading(words, down, cosine(without_mean(rate), without_mean(gyro)), 180.0 if up is None else up)


def _rates_of(seen: MotionMeans, quat: Array) -> Array:
    """Rates (K, 3) of other attitudes at the middles of the intervals, in proportion, over as many of them."""
    q, rows = so3.continuous(quat), np.arange(len(quat))
    before, after = np.maximum(rows - seen.apart, 0), np.minimum(rows + seen.apart, len(quat) - 1)
    turned = so3.rotation_between(q[before], q[after])
    usual = np.median(lengths(turned))
    turned[lengths(turned) > 20.0 * usual + 1e-12] = 0.0  # over a pause
    return np.asarray(turned)


def _away_from_up(quat_EB: Array, force_B: Array) -> float | None:
    """Angle [deg] of the median specific force from up, None where there is none to speak of."""
    mean_E = np.median(so3.rotate(quat_EB, force_B), axis=0)
    size = float(np.linalg.norm(mean_E))
    if size < 0.3 * float(np.median(lengths(force_B))) or size == 0.0:
        return None
    return float(np.degrees(np.arccos(np.clip(mean_E[2] / size, -1.0, 1.0))))


def _turned(flight: Flight, seen: MotionMeans) -> tuple[tuple[Check, float] | None, tuple[Check, float] | None]:
    """An IMU that is mounted otherwise than the mapping says: all of it, and its gyroscope alone; each with its fit."""
    assert seen.gyro is not None
    assert seen.accel is not None
    rates = without_mean(seen.rate), without_mean(seen.gyro)
    if rms(rates[0]) < ATTITUDE.still_rate or rms(rates[1]) == 0.0:
        return None, None
    forces = seen.force(), seen.accel
    together, whole = best_axes([rates, forces]), None
    if together is not None and _improves_force(forces, together.matrix):
        named = "forward-right-down" if together.words == "frd" else together.words
        words = (
            f"The gyroscope goes with the attitude's rate by a cosine of {together.as_is:.2f}, with the IMU's axes "
            f"read as {named} by {together.fits:.2f}"
        )
        whole = Check("body-frame", "bad", words, option(flight, together.words, "imu")), together.fits
    alone = best_axes([rates])
    if alone is None or len(alone.words.split(",")) > 1:
        return whole, None
    words = f"The gyroscope goes with the attitude's rate by a cosine of {alone.as_is:.2f}, as gyro.{alone.words} by "
    mend = option(flight, f"gyro.{alone.words}", "imu")
    found = Check("body-frame", "bad", f"{words}{alone.fits:.2f}: opposite or swapped axes", mend)
    return whole, (found, alone.fits)


def _improves_force(forces: tuple[Array, Array], turn: Array) -> bool:
    """Whether the accelerometer allows this turn of the IMU."""
    truth, reading = forces
    return cosine(truth, reading @ turn.T) > cosine(truth, reading) - 0.02


def gyroscope(flight: Flight, seen: MotionMeans | None) -> Iterator[Check]:
    """Unit of the gyroscope, and whether it shows the motion of the attitude."""
    if flight.imu is None or flight.odometry is None:
        return
    if seen is None or seen.gyro is None:
        period = flight.odometry.period
        slow = (
            f"The odometry comes every {period:.2g} s: too slowly, or too rarely beside the IMU, to check a gyroscope."
        )
        yield Check("gyroscope", "ok", slow)
        return
    known = [k for k, axis in enumerate(AXES[3:]) if axis not in unmeasured_axes(flight)]
    if not known:
        return
    yield rate_check("gyroscope", flight, (seen.rate[:, known], seen.gyro[:, known]), ("imu",), "gyro")


def rate_check(name: str, flight: Flight, pair: tuple[Array, Array], parts: tuple[str, ...], vector: str) -> Check:
    """A rate against that of the attitude: unit, size, likeness. `pair` is truth and reading, (K, C) each."""
    truth, reading = (without_mean(v) for v in pair)
    if rms(truth) < ATTITUDE.still_rate:
        return Check(name, "ok", "The attitude hardly moves: its unit cannot be checked.")
    alike, ratio = cosine(truth, reading), rms(reading) / rms(truth)
    slope = float(np.sum(truth * reading) / np.sum(truth**2))
    said = f"It is {slope:.3g} times the attitude's rate (cosine {alike:.2f})"
    if 0.7 * DEGREES < ratio < 1.4 * DEGREES and abs(alike) > 0.5:
        return Check(name, "bad", f"{said}: deg/s", option(flight, "deg", *parts))
    if alike < -0.5:
        words = f"{said}: its sign is opposite"
        return Check(name, "bad", words, option(flight, f"{vector}*-1", *parts))
    if alike > 0.9 and not 0.75 < ratio < 1.33:
        mend = option(flight, f"{vector}*{factor(1.0 / slope)}", *parts)
        return Check(name, "bad", f"{said}: another unit or scale", mend)
    if not 1.0 / ATTITUDE.rate_factor < slope < ATTITUDE.rate_factor and rms(truth) > 2.0 * ATTITUDE.still_rate:
        return Check(name, "warn", f"{said}: {_apart(flight, slope, ratio, parts, vector)}")
    between = f"{slope:.2f}" if alike > 0.995 else f"{slope:.2f} to {ratio**2 / slope:.2f}, by the noise of either"
    return Check(name, "ok", f"It agrees with the attitude's rate (factor {between}).")


def _apart(flight: Flight, slope: float, ratio: float, parts: tuple[str, ...], vector: str) -> str:
    """What may be the matter with a rate that is no more than like the attitude's."""
    if slope <= 0.0:
        return "check clocks, units and axes."
    high = ratio**2 / slope
    scale = option(flight, f"{vector}*{factor(1.0 / float(np.sqrt(slope * high)))}", *parts)
    return (
        f"the factor is between {slope:.2f} and {high:.2f}. Noise of the attitude makes it small, and so does a delay "
        f"between the two (see the timing; --shift odometry=SECONDS); a wrong scale would be mended by {scale}."
    )
