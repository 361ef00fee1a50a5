"""The accelerometer against gravity and the odometry's acceleration: the size of its mean, and axis by axis.

Axis by axis, what changes of R_EB^T (dv/dt + g e_z) is compared with what the axis reads (`sensor_scales`): it may read
the opposite or another axis, from some moment on or throughout, or have another gain.

Newton: the mean of R_EB f is g e_z plus the mean acceleration. Means are weighted by hats w of half-width h about
t_k, for which the acceleration is that of three positions alone (a velocity is integrated to one), and add up to the
whole flight:

    a_k = (p(t_k + h) - 2 p(t_k) + p(t_k - h)) / h^2,    ratio = sum |<w R_EB f>| / sum |g e_z + a_k|.

Lengths, so that a mounting error, which turns all readings alike, is no error of size. The ratio is that of scale, or
of a bias along the vertical: near hover these are the same. Its standard deviation is that of the hats, in which noise
of the positions at their ends counts as well.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.clipping import is_clipped
from wrenchgap.flight.checks.motion import MotionMeans
from wrenchgap.flight.checks.remedies import factor, option
from wrenchgap.flight.checks.sensor_scales import Scale, sensor_scales
from wrenchgap.flight.checks.sensor_windows import SCALE, steady_blocks
from wrenchgap.flight.flight import AXES, GRAVITY, Flight
from wrenchgap.flight.row_kernels import integral
from wrenchgap.flight.stamps import interpolated
from wrenchgap.flight.unmeasured import unmeasured_axes

BEFORE = ("accelerometer-unit", "body-frame", "inertial-frame", "velocity", "odometry-scale", "clock-unit")
"""Checks that leave no ratio to speak of where they are bad."""


@dataclass(frozen=True)
class GravityRatio:
    """Size of the mean specific force over what it should be; its standard deviation, and what it should be."""

    value: float
    std: float
    expected: float  # m/s^2


def accelerometer_scale(flight: Flight, seen: MotionMeans | None, known: Sequence[Check]) -> Iterator[Check]:
    """Specific force against gravity, and its axes; nothing where `known` says that either is another quantity."""
    if flight.imu is None or any(c.level == "bad" and c.name in BEFORE for c in known):
        return
    ratio = gravity_ratio(flight, seen)
    size = None if ratio is None else _size(flight, ratio, known)
    scales = sensor_scales(flight, "accelerometer") or {}
    plain = "z" in scales and scales["z"].allows(1.0) and scales["z"].best.width < SCALE.widest
    if plain or size is None or size.level != "bad":  # else one factor for all axes, of which changes say less
        size = _axes(scales) or size
    yield from [] if size is None else [size]


def _size(flight: Flight, ratio: GravityRatio, known: Sequence[Check]) -> Check:
    """The mean against gravity."""
    said = f"{ratio.value:.3f} +- {ratio.std:.3f} times that of gravity and the odometry's acceleration"
    off = abs(ratio.value - 1.0)
    if off < max(SCALE.reported, SCALE.sigmas * ratio.std):
        return Check("accelerometer-scale", "ok", f"The mean specific force is {said}.")
    bias = (ratio.value - 1.0) * ratio.expected
    words = f"The mean specific force is {said}: the accelerometer has a scale of {ratio.value:.3f}, or "
    words += f"a bias of {bias:+.2f} m/s^2 along the vertical (accelerometer_bias); the ground station "
    words += "calibrates both"
    scaled = f"accel*{factor(1.0 / ratio.value)}"
    undone = None if is_clipped(known, "accelerometer") else option(flight, scaled, "imu")
    if off > SCALE.refused:
        words += ". If it is the scale, reading can undo it" * (undone is not None)
        return Check("accelerometer-scale", "bad", words, undone)
    words += f". Only where you know that it is the scale: `{undone}`" * (undone is not None)
    return Check("accelerometer-scale", "warn", words)  # no mend: of a bias it would be the wrong one


def _axes(scales: Mapping[str, Scale]) -> Check | None:
    """Axes that contradict the odometry, by name; by a warning alone where they may be mounted askew."""
    wrong: dict[str, str] = {}
    largest = 0.0
    for axis, scale in scales.items():
        fault = scale.fault()
        size = fault.size if fault is not None else 0.0
        if fault is not None and size > SCALE.refused_axis:
            wrong[axis], largest = fault.words, max(largest, size)
        elif not scale.unsteady and scale.least_excess > SCALE.refused:
            wrong[axis] = f"has a scale of {scale.best.low:.2f} to {scale.best.high:.2f}"
            largest = max(largest, scale.least_excess)
    if not wrong:
        return None
    said = "; ".join(f"{axis} {words}" for axis, words in wrong.items())
    words = f"The accelerometer does not read the odometry's acceleration: {said}. One of the two failed or was set "
    mend = f"--unmeasured {','.join(f'force_{axis}' for axis in wrong)}"
    return Check("accelerometer-scale", "bad" if largest > SCALE.refused_axis else "warn", f"{words}anew", mend)


def gravity_ratio(
    flight: Flight, seen: MotionMeans | None, half: float = 1.0, least: float = 0.5
) -> GravityRatio | None:
    """The ratio; None without odometry or accelerometer, or where too little gravity is in the specific force.

    `half` [s] is the half-width of a hat: a position that is off by 1 cm makes 0.25 % of g, and 8 s of flight are
    enough. A hat whose expected specific force is below `least` of g is not used: in free fall nothing is to scale.
    """
    odometry, imu, absent = flight.odometry, flight.imu, unmeasured_axes(flight)
    if seen is None or odometry is None or imu is None or imu.period > SCALE.slowest_imu or "force_z" in absent:
        return None
    measured = [k for k, axis in enumerate(AXES[:3]) if axis not in absent]
    place = odometry.position_E if odometry.velocity_E is None else integral(odometry.time, odometry.velocity_E)
    hats = []
    for start, stop in steady_blocks(odometry, imu):
        rows = slice(*np.searchsorted(imu.time, (start, stop)))
        time = imu.time[rows]
        axes_E = so3.matrix(so3.interpolate(time, odometry.time, odometry.quat_EB))[:, :, measured]
        for middle in np.arange(start + half, stop - half, half):
            weight = np.maximum(0.0, 1.0 - np.abs(time - middle) / half) * np.gradient(time)
            before, at, after = interpolated(middle + half * np.array([-1.0, 0.0, 1.0]), odometry.time, place)
            expected_E = (after - 2.0 * at + before) / half**2 + np.array([0.0, 0.0, GRAVITY])
            forces = imu.specific_force_B[rows][:, measured], expected_E @ axes_E  # read, and what there was to read
            hats.append([np.linalg.norm(np.einsum("k,kea,ka", weight, axes_E, f)) / np.sum(weight) for f in forces])
    hats = [hat for hat in hats if hat[1] > least * GRAVITY]
    if len(hats) < SCALE.fewest_segments:
        return None
    read, expected = np.transpose(hats)
    value, count = float(np.sum(read) / np.sum(expected)), len(hats)
    scatter = float(np.sqrt(np.sum((read - value * expected) ** 2) * count / (count - 1)))
    return GravityRatio(value, scatter / float(np.sum(expected)), float(np.mean(expected)))
