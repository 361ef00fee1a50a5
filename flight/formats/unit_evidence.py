"""In which unit columns are whose header does not say it: what the numbers themselves rule out.

Units of a rate differ by 57, those of an acceleration by 9.8 and more, and a flight shows which is meant: a gyroscope
turns as the attitude does, an accelerometer reads 1 g along body z at its median. Where neither can be seen, nothing
is decided here.
"""

from dataclasses import dataclass

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import GRAVITY, Array, SpeedUnit, Stamps


@dataclass(frozen=True)
class EvidenceThresholds:
    """From when on a unit is decided."""

    window: float = 0.1
    """Time [s] over which rates are averaged: vibration and the noise of an attitude average out, a turn at 20 rad/s
    is still less than half a turn."""
    moving: float = 0.1
    """Rate of the attitude [rad/s] that a tenth of the windows must exceed: motion capture at rest shows 0.02."""
    apart: float = 4.0
    """Factor by which the sizes of gyroscope and attitude's rate may differ: the units are 57 apart, so up to its root,
    7.5, one is the nearer; delays and filters make less than 2."""
    gravity: float = 0.3
    """Share by which the median of an accelerometer may differ from 1 g."""
    counts: float = 0.15
    """Share by which it may differ from a power of two of counts, which are twice as many for the next."""
    upright: float = 0.8
    """Share of the median that must lie along z, or a sustained turn without gravity could pass for 1 g."""
    windows: int = 20
    """Windows that a ratio needs."""


EVIDENCE = EvidenceThresholds()
RATES = {"rad s": 1.0, "deg s": 180.0 / np.pi}
"""Units of a rate in 1 rad/s."""
ACCELERATIONS = {"g": 1.0, "m s2": GRAVITY, "mg": 1000.0}
"""Units of an acceleration in 1 g."""


def rate_unit(stamps: Stamps, gyro: Array, quat_EB: Array) -> tuple[str, float] | None:
    """The unit of a gyroscope (N, 3) beside an attitude (N, 4), stamps [ns], and the ratio of their sizes; or None."""
    norm = np.linalg.norm(quat_EB, axis=1)
    rows = np.flatnonzero(np.isfinite(gyro).all(axis=1) & (norm > 0.5) & (norm < 2.0))
    time = (stamps[rows] - stamps[rows[0]]) * 1e-9 if len(rows) else np.zeros(0)
    step = float(np.median(np.diff(time))) if len(time) > 2 else 0.0
    stride = max(round(EVIDENCE.window / step), 1) if step > 0.0 else 1
    starts = np.arange(0, len(rows) - stride, stride)
    if step <= 0.0 or len(starts) < EVIDENCE.windows:
        return None
    span = time[starts + stride] - time[starts]
    whole = (span > 0.0) & (span < 2.0 * stride * step)  # no gap within
    if whole.sum() < EVIDENCE.windows:
        return None
    starts, span = starts[whole], span[whole]
    quat = quat_EB[rows] / norm[rows, None]
    turned = np.linalg.norm(so3.rotation_between(quat[starts], quat[starts + stride]), axis=1) / span
    sums = np.concatenate((np.zeros((1, 3)), np.cumsum(gyro[rows], axis=0)))
    read = np.linalg.norm((sums[starts + stride] - sums[starts]) / stride, axis=1)
    seen = float(np.percentile(turned, 90))
    if seen < EVIDENCE.moving:
        return None
    ratio = float(np.percentile(read, 90)) / seen
    fitting = (u for u, size in RATES.items() if 1.0 / EVIDENCE.apart < ratio / size < EVIDENCE.apart)
    unit = next(fitting, None)
    return None if unit is None else (unit, ratio)


def upright_median(acc: Array) -> float | None:
    """Size of the median reading of an accelerometer (N, 3) in its own unit; None where it does not lie along z."""
    known = acc[np.isfinite(acc).all(axis=1)]
    median = np.median(known, axis=0) if len(known) else np.zeros(3)
    size = float(np.linalg.norm(median))
    return size if size > 0.0 and abs(median[2]) >= EVIDENCE.upright * size else None


def acceleration_unit(size: float) -> str | None:
    """The unit in which an upright median is 1 g."""
    return next((u for u, one in ACCELERATIONS.items() if abs(size / one - 1.0) < EVIDENCE.gravity), None)


def counts_of_gravity(size: float) -> int | None:
    """How many counts 1 g is, by an upright median: a power of two, as a sensor of some whole range has it."""
    nearest = 2 ** round(np.log2(size)) if 200.0 < size < 20_000.0 else 0
    return nearest if nearest and abs(size / nearest - 1.0) < EVIDENCE.counts else None


def blackbox_outputs(motor: Array) -> tuple[Array, SpeedUnit] | None:
    """Motor outputs (N, R) of Betaflight or INAV: pulse widths, or DSHOT values as shares of full throttle; or None.

    DSHOT commands throttle by 48 to 2047, and 0 stops; a pulse is not shorter than 900 us, and none of a flight by
    DSHOT stays above 900, which is 43 % of full throttle.
    """
    used = motor[np.isfinite(motor) & (motor > 0.0)]
    if not len(used) or used.max() > 2100.0 or motor[np.isfinite(motor)].min() < 0.0:
        return None
    if used.min() >= 900.0:
        return motor, "pwm"
    shares = np.clip((motor - 48.0) / (2047.0 - 48.0), 0.0, 1.0)
    return (shares, "normalised") if used.max() <= 2047.0 else None
