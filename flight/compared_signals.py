"""Which topics of a flight are compared, and as what: rates, specific forces, velocities, wrenches.

How two signals are compared is in `flight.offsets`. `shifted` moves a topic's stamps when the user says so: never by
itself, and always on record.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import AXES, GRAVITY, Array, Flight, Gap, OdometrySeries, ReferenceSeries, Series
from wrenchgap.flight.offsets import EVERYWHERE, OFFSETS, Intervals, Offset, Signal, offset
from wrenchgap.flight.row_kernels import empty

GRAVITY_E = np.array([0.0, 0.0, GRAVITY])
"""What an accelerometer at rest reads, in E [m/s^2]."""


def sensor_offsets(flight: Flight, within: Intervals = EVERYWHERE, one_motion: float = 0.85) -> tuple[Offset, ...]:
    """Offsets between the sensor topics: IMU to odometry, and odometry's pose to its own twist.

    Rates and accelerations are differences of neighbouring samples, stamped half-way: exactly the mean over the
    interval, so without any phase. What the accelerometer should read is made from the odometry alone, attitude and
    velocity, so that its clock is in one of the two signals only.

    Below the coherence `one_motion` what two sensors have in common may be the noise of one of them, which has moved
    the vehicle through the controller: coherent, and late by whatever the controller's phase is.
    """
    pairs = map(_measured, _sensor_pairs(flight))
    return tuple(
        offset(*pair, within=within, gains=OFFSETS.alike, coherent=one_motion) for pair in pairs if pair[0].axes
    )


def _measured(pair: tuple[Signal, Signal]) -> tuple[Signal, Signal]:
    """Both signals on the axes that were measured."""
    known = ~np.any([empty(s.values) for s in pair], axis=0)
    if known.all():
        return pair
    first, second = (replace(s, values=s.values[:, known], axes=tuple(np.array(s.axes)[known])) for s in pair)
    return first, second


def tracking_offsets(flight: Flight, within: Intervals = EVERYWHERE) -> tuple[Offset, ...]:
    """By how much the odometry follows the reference late: the controller's doing, for information."""
    odometry, reference = flight.odometry, flight.reference
    if odometry is None or reference is None:
        return ()
    positions = _velocity("reference position", reference), _velocity("odometry position", odometry)
    wanted = _rate("reference attitude", reference, reference.quat_ED)
    attitudes = wanted, _rate("odometry attitude", odometry, odometry.quat_EB)
    return tuple(offset(first, second, within=within) for first, second in (positions, attitudes))


def controller_offset(flight: Flight, within: Intervals = EVERYWHERE) -> Offset | None:
    """By how much the commanded wrench lags the desired one; None where the log lacks one of them."""
    desired, commanded = flight.desired, flight.commanded
    if desired is None or commanded is None:
        return None
    first = _signal("desired wrench", desired, desired.wrench_B, AXES)
    return offset(first, _signal("commanded wrench", commanded, commanded.wrench_B, AXES), within=within)


def _signal(name: str, series: Series, values: Array, axes: tuple[str, ...] = ("x", "y", "z")) -> Signal:
    return Signal(name, series.time, values, axes, series.gaps)


def _sensor_pairs(flight: Flight) -> Iterator[tuple[Signal, Signal]]:
    imu, odometry = flight.imu, flight.odometry
    if odometry is None:
        return
    attitude = _rate("odometry attitude", odometry, odometry.quat_EB)
    rate = None if odometry.omega_B is None else _signal("odometry rate", odometry, odometry.omega_B)
    if imu is not None:
        gyroscope = _signal("gyroscope", imu, imu.omega_B)
        yield gyroscope, attitude
        if rate is not None:
            yield gyroscope, rate
        if odometry.velocity_E is not None:
            accelerometer = _signal("accelerometer", imu, imu.specific_force_B)
            yield accelerometer, _felt(odometry, odometry.time, odometry.velocity_E)
    if rate is not None:
        yield rate, attitude
    if odometry.velocity_E is not None:
        velocity = _signal("odometry velocity", odometry, odometry.velocity_E)
        yield velocity, _velocity("odometry position", odometry)


def odometry_motion(odometry: OdometrySeries) -> tuple[Signal, Signal]:
    """Body rates and specific force that an odometry alone amounts to."""
    known = odometry.omega_B
    rate = _rate("rate", odometry, odometry.quat_EB) if known is None else _signal("rate", odometry, known)
    if odometry.velocity_E is not None:
        return rate, _felt(odometry, odometry.time, odometry.velocity_E)
    mean = _velocity("velocity", odometry)
    return rate, _felt(odometry, mean.time, mean.values)


def _rate(name: str, series: OdometrySeries | ReferenceSeries, quat: Array) -> Signal:
    """Mean body rates between neighbouring attitudes, log(q_k^-1 q_k+1) / dt."""
    q = so3.continuous(quat)
    turned = so3.rotation_between(q[:-1], q[1:])
    return differences(name, series.time, turned, series.gaps)


def _velocity(name: str, series: OdometrySeries | ReferenceSeries) -> Signal:
    """Mean velocities between neighbouring positions."""
    return differences(name, series.time, np.diff(series.position_E, axis=0), series.gaps)


def _felt(odometry: OdometrySeries, time: Array, velocity_E: Array) -> Signal:
    """R_EB^T (dv_E/dt + g e_z): what an accelerometer at the odometry's origin would read."""
    mean = differences("odometry velocity", time, np.diff(velocity_E, axis=0), odometry.gaps)
    quat_EB = so3.interpolate(mean.time, odometry.time, so3.continuous(odometry.quat_EB))
    return replace(mean, values=so3.rotate_inverse(quat_EB, mean.values + GRAVITY_E))


def differences(name: str, time: Array, steps: Array, gaps: tuple[Gap, ...]) -> Signal:
    """Steps (N-1, C) between samples at `time` (N,) as rates at the middles of the intervals, none over a gap."""
    middle, rates = 0.5 * (time[1:] + time[:-1]), steps / np.diff(time)[:, None]
    if gaps:
        keep = np.all([(middle < gap.start) | (middle > gap.stop) for gap in gaps], axis=0)
        middle, rates = middle[keep], rates[keep]
    return Signal(name, middle, rates, gaps=gaps)


SHIFTABLE = ("imu", "odometry", "reference", "battery")
"""Roles whose stamps may be moved. Not the commands: a response that lags them is a candidate effect."""


def shifted(flight: Flight, shifts: Mapping[str, float], largest: float = 10.0) -> Flight:
    """The flight with the stamps of some topics moved by seconds (positive: later); named by role or topic.

    The shifts are kept in `Flight.shifts` and said in its notes. To undo that the odometry lags the IMU by 12 ms, move
    it by -0.012. Raises UsageError for a role or topic that this flight lacks, a role of commands, or a shift that is
    not a sensible number of seconds: beyond the `largest` [s] somebody mistook milliseconds for seconds.
    """
    moved: dict[str, Series] = {}
    notes = []
    for name, seconds in shifts.items():
        role, series = _named(flight, name)
        if role not in SHIFTABLE:
            raise UsageError(
                f"--shift {name}: stamps of the {role} wrench or actuators are not moved, because a response that lags "
                f"them is an effect to be found (command_delay, servo_lag, motor_lag); can be moved: {_movable(flight)}"
            )
        if not abs(seconds) <= largest:
            raise UsageError(f"--shift {name}={seconds:g}: expected seconds, at most {largest:g}, e.g. -0.0123")
        if role in moved:
            raise UsageError(f"--shift {name}: {role} is shifted twice; say it once")
        gaps = tuple(Gap(gap.start + seconds, gap.stop + seconds) for gap in series.gaps)
        moved[role] = replace(series, time=series.time + seconds, gaps=gaps)
        notes.append(f"{flight.name}: stamps of {series.topic} ({role}) moved by {1e3 * seconds:+.4g} ms, as asked.")
    together = {role: shifts.get(role, shifts.get(series.topic, 0.0)) for role, series in moved.items()}
    return replace(
        flight,
        **moved,  # type: ignore[arg-type]
        checks=None if moved else flight.checks,
        shifts={**flight.shifts, **together},
        notes=(*flight.notes, *notes),
    )


def _named(flight: Flight, name: str) -> tuple[str, Series]:
    """The role and series that a role or a topic stands for."""
    played = flight.series()
    if name in played:
        return name, played[name]
    for role, series in played.items():
        if name in series.topic.split(" + "):
            return role, series
    raise UsageError(f"--shift {name}: {flight.path.name} has no such role or topic; can be moved: {_movable(flight)}")


def _movable(flight: Flight) -> str:
    return ", ".join(f"{r} ({s.topic})" for r, s in flight.series().items() if r in SHIFTABLE) or "none"
