"""IMU against attitude: units, axes, gravity, frames, order of the quaternion."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.check import Check, Level
from wrenchgap.flight.checks.motion import MotionMeans, best_axes, cosine, rms, without_mean
from wrenchgap.flight.checks.remedies import factor, option
from wrenchgap.flight.filters import smooth
from wrenchgap.flight.flight import AXES, DEGREE, GRAVITY, Array, Flight
from wrenchgap.flight.mapping_units import FRD, NED
from wrenchgap.flight.row_kernels import empty, lengths
from wrenchgap.flight.stamps import spread
from wrenchgap.flight.unmeasured import unmeasured_axes


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
    expected = GRAVITY if seen is None else float(np.median(lengths(seen.force())))
    expected = expected if expected < LARGEST else GRAVITY
    scaled = f"accel*{factor(expected / max(median, 1e-9))}"
    words, mend = f"Median specific force is {median:.2f} m/s^2", None
    level: Level = "bad"
    if _without_gravity(seen, size):
        words += ": gravity was removed; record the raw one"
        mend = "--topic imu=none" if flight.odometry is not None else "--unmeasured force_x,force_y,force_z"
    elif 0.8 < median / max(expected / GRAVITY, 0.1) < 1.25 and median < 4.0:
        words, mend = f"{words}: it is in units of g", option(flight, "g", "imu")
    elif median < 3.0 and expected > 6.0:
        words += f", expected about {expected:.2f}: its unit is unknown"
        mend = option(flight, scaled, "imu")
    elif median > 100.0 and 0.7 < median / (1000.0 * expected / GRAVITY) < 1.4:
        words, mend = f"{words}: it is in milli-g", option(flight, "mg", "imu")
    elif not 0.7 < median / expected < 1.6:
        level = "bad" if not 0.4 < median / expected < 2.5 else "warn"
        words += f", expected about {expected:.2f}: check its unit and scale."
        mend = option(flight, scaled, "imu") if level == "bad" else None
    else:
        words, level = f"{words}.", "ok"
    yield Check("accelerometer-unit", level, words, mend)


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
    words = f"Rotated to E, the median specific force points {away:.0f} deg away from up"
    if together is not None and (best is None or best.imu_down or together[1] > best.gyro - 0.02):
        yield together[0]
    elif best is not None and (best.words or best.imu_down):
        if best.imu_down:
            yield _upside_down(flight, force_z)
        if best.words:
            parts = ("pose", "twist") if "twist" in flight.mapping or not flight.mapping else ("pose",)
            words = (
                f"{words}, or the attitude turns unlike the gyroscope; read as {best.words} it points up within "
                f"{best.up:.1f} deg and turns alike (cosine {best.gyro:.2f})"
            )
            yield Check("inertial-frame", "bad", words, option(flight, best.words, *parts))
    elif alone is not None:
        yield alone
    elif away > ATTITUDE.upright_deg:
        hint = "the attitude is not body to east-north-up (NED, inverted, or another quaternion order), and no reading "
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


def _turned(flight: Flight, seen: MotionMeans) -> tuple[tuple[Check, float] | None, Check | None]:
    """An IMU that is mounted otherwise than the mapping says: all of it, with its fit, and its gyroscope alone."""
    assert seen.gyro is not None
    assert seen.accel is not None
    rates = without_mean(seen.rate), without_mean(seen.gyro)
    if rms(rates[0]) < ATTITUDE.still_rate or rms(rates[1]) == 0.0:
        return None, None
    truth, reading = forces = seen.force(), seen.accel
    together, whole = best_axes([rates, forces]), None
    said = "The gyroscope goes with the attitude's rate by a cosine of"
    if together is not None and cosine(truth, reading @ together.matrix.T) > cosine(truth, reading) - 0.02:
        named = "forward-right-down" if together.words == "frd" else together.words
        words = f"{said} {together.as_is:.2f}, with the IMU's axes read as {named} by {together.fits:.2f}"
        whole = Check("body-frame", "bad", words, option(flight, together.words, "imu")), together.fits
    alone = best_axes([rates])
    if alone is None or len(alone.words.split(",")) > 1:
        return whole, None
    words = f"{said} {alone.as_is:.2f}, as gyro.{alone.words} by {alone.fits:.2f}: opposite or swapped axes"
    return whole, Check("body-frame", "bad", words, option(flight, f"gyro.{alone.words}", "imu"))


def gyroscope(flight: Flight, seen: MotionMeans | None) -> Iterator[Check]:
    """Unit of the gyroscope, and whether it shows the motion of the attitude."""
    if flight.imu is None or flight.odometry is None:
        return
    if seen is None or seen.gyro is None:
        words = (
            f"The odometry comes every {flight.odometry.period:.2g} s: too slowly, or too rarely beside the IMU, to "
        )
        yield Check("gyroscope", "ok", f"{words}check a gyroscope.")
        return
    known = [k for k, axis in enumerate(AXES[3:]) if axis not in unmeasured_axes(flight)]
    if known:
        yield rate_check("gyroscope", flight, (seen.rate[:, known], seen.gyro[:, known]), ("imu",), "gyro")


def rate_check(name: str, flight: Flight, pair: tuple[Array, Array], parts: tuple[str, ...], vector: str) -> Check:
    """A rate against that of the attitude: unit, size, likeness. `pair` is truth and reading, (K, C) each."""
    truth, reading = (without_mean(v) for v in pair)
    if rms(truth) < ATTITUDE.still_rate:
        return Check(name, "ok", "The attitude hardly moves: its unit cannot be checked.")
    alike, ratio = cosine(truth, reading), rms(reading) / rms(truth)
    slope = float(np.sum(truth * reading) / np.sum(truth**2))
    said = f"It is {slope:.3g} times the attitude's rate (cosine {alike:.2f})"
    if 0.7 < ratio * DEGREE < 1.4 and abs(alike) > 0.5:
        return Check(name, "bad", f"{said}: deg/s", option(flight, "deg", *parts))
    if alike < -0.5:
        return Check(name, "bad", f"{said}: its sign is opposite", option(flight, f"{vector}*-1", *parts))
    if alike > 0.9 and not 0.75 < ratio < 1.33:
        mend = option(flight, f"{vector}*{factor(1.0 / slope)}", *parts)
        return Check(name, "bad", f"{said}: another unit or scale", mend)
    high = ratio / alike if alike else np.inf
    alike_within_noise = 1.0 / ATTITUDE.rate_factor < slope < ATTITUDE.rate_factor or (
        alike > 0.5 and slope < 1.0 < high
    )
    if alike_within_noise or rms(truth) <= 2.0 * ATTITUDE.still_rate:
        between = f"{slope:.2f}" if alike > 0.995 else f"{slope:.2f} to {high:.2f}, by the noise of either"
        return Check(name, "ok", f"It agrees with the attitude's rate (factor {between}).")
    if slope <= 0.0 or ratio == 0.0:  # the second: so small that its square is none
        return Check(name, "warn", f"{said}: check clocks, units and axes.")
    scale = option(flight, f"{vector}*F", *parts)
    words = (
        f"{said}. Its scale is between {slope:.2f}, if the attitude is without noise, and {high:.2f}, if this is. "
        "Noise of the attitude or a delay between the two (see the timing; --shift odometry=SECONDS) may cause that; "
        f"if the scale is wrong, {scale} with F between {1.0 / high:.2f} and {1.0 / slope:.2f} corrects it."
    )
    return Check(name, "warn", words)
