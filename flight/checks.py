"""Is this log what it seems? Units, frames and stamps, asked of the data themselves.

Each check looks at one way in which real logs are wrong, and says what to do. Median values are used throughout, so
that a take-off or a crash inside the log does not decide.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.derivative import angular_velocity, smooth
from wrenchgap.flight.flight import AXES, Array, Flight, Series
from wrenchgap.flight.gravity import GRAVITY
from wrenchgap.flight.stamps import interpolated, jitter
from wrenchgap.flight.unmeasured import sentence, unmeasured_axes

DEGREES = 180.0 / np.pi

Level = Literal["ok", "warn", "bad"]


@dataclass(frozen=True)
class Check:
    """What was looked at (`name`), how it is (`level`), and in words, with a remedy where it is not well."""

    name: str
    level: Level
    message: str


def checks(flight: Flight) -> tuple[Check, ...]:
    """Everything that can be asked of a flight without knowing the vehicle."""
    return tuple(found for check in _CHECKS for found in check(flight))


def _roles(flight: Flight) -> Iterator[Check]:
    played = flight.series()
    if "commanded" not in played and "actuators" not in played:
        yield Check(
            "roles",
            "bad",
            "Neither a commanded wrench nor actuators: there is no model to compare with. "
            "Map one with --topic commanded=/your/topic.",
        )
    if "imu" not in played:
        instead = "rates and forces come from the odometry" if "odometry" in played else "map one with --topic imu=..."
        yield Check("roles", "warn" if "odometry" in played else "bad", f"No IMU: {instead}.")
    if "odometry" not in played:
        yield Check("roles", "warn", "No odometry: attitude and velocity are unknown; no counterfactual flight.")
    if {"commanded", "imu", "odometry"} <= set(played):
        yield Check("roles", "ok", f"Roles played: {', '.join(played)}.")


def _specific_force(flight: Flight) -> Iterator[Check]:
    if flight.imu is None or "force_z" in unmeasured_axes(flight):
        return
    median = float(np.median(np.linalg.norm(_measured(flight.imu.specific_force_B), axis=1)))
    described = f"Median specific force is {median:.2f} m/s^2"
    if 0.8 < median < 1.25:
        yield Check("accelerometer unit", "bad", f"{described}: it is in units of g; multiply it by 9.81.")
    elif median < 3.0:
        yield Check(
            "accelerometer unit",
            "bad",
            f"{described}: gravity was removed; record the raw accelerometer, or leave the IMU out (--topic imu=none).",
        )
    elif not 0.7 * GRAVITY < median < 1.6 * GRAVITY:
        yield Check("accelerometer unit", "warn", f"{described}, expected about 9.81: check its unit and scale.")
    else:
        yield Check("accelerometer unit", "ok", f"{described}.")


def _measured(values: Array) -> Array:
    """The columns that hold numbers."""
    return values[:, ~np.isnan(values).all(axis=0)]


def _up(flight: Flight) -> Iterator[Check]:
    if flight.imu is None or "force_z" in unmeasured_axes(flight):
        return
    force_z = float(np.median(flight.imu.specific_force_B[:, 2]))
    if force_z < -3.0:
        yield Check(
            "body frame",
            "bad",
            f"Median specific force along body z is {force_z:.2f} m/s^2: the axes are forward-right-down; "
            "convert to forward-left-up (turn y and z over).",
        )
    if flight.odometry is None or np.isnan(flight.imu.specific_force_B).any():
        return
    force_B = interpolated(flight.odometry.time, flight.imu.time, flight.imu.specific_force_B)
    mean_E = np.median(so3.rotate(flight.odometry.quat_EB, force_B), axis=0)
    size = float(np.linalg.norm(mean_E))
    angle = float(np.degrees(np.arccos(np.clip(mean_E[2] / max(size, 1e-9), -1, 1))))
    if size > 3.0 and angle > 15.0:
        yield Check(
            "inertial frame",
            "bad",
            f"Rotated to E, the median specific force points {angle:.0f} deg away from up: the attitude is not "
            "body to east-north-up (NED, inverted, or another quaternion order).",
        )
    elif size > 3.0:
        yield Check("inertial frame", "ok", f"Specific force, rotated to E, points up within {angle:.1f} deg.")


def _gyro(flight: Flight) -> Iterator[Check]:
    if flight.imu is None or flight.odometry is None or len(flight.odometry.time) < 20:
        return
    time, quat_EB = flight.odometry.time, flight.odometry.quat_EB
    known = [k for k, axis in enumerate(AXES[3:]) if axis not in unmeasured_axes(flight)]
    if not known:
        return
    truth = angular_velocity(time, quat_EB)[:, known]
    omega_B = smooth(time, interpolated(time, flight.imu.time, flight.imu.omega_B[:, known]))
    if float(np.sqrt(np.mean(truth**2))) < 0.02:
        yield Check("gyroscope", "ok", "The attitude hardly moves: the gyroscope's unit cannot be checked.")
        return
    scale = np.sum(omega_B * truth, axis=0) / np.maximum(np.sum(truth**2, axis=0), 1e-12)
    norm = float(np.sum(omega_B * truth) / np.sum(truth**2))
    moving = np.sqrt(np.mean(truth**2, axis=0)) > 0.02
    if 0.7 * DEGREES < abs(norm) < 1.4 * DEGREES:
        yield Check("gyroscope", "bad", f"It is {norm:.1f} times the attitude's rate: deg/s; divide by {DEGREES:.2f}.")
    elif np.any(scale[moving] < -0.3):
        axes = ", ".join("xyz"[k] for k, bad in zip(known, (scale < -0.3) & moving, strict=True) if bad)
        yield Check("gyroscope", "bad", f"Its sign is opposite to the attitude's rate on {axes}: check the body frame.")
    elif not 0.7 < norm < 1.3:
        yield Check("gyroscope", "warn", f"It is {norm:.2f} times the attitude's rate: check clocks and units.")
    else:
        yield Check("gyroscope", "ok", f"It agrees with the attitude's rate (factor {norm:.2f}).")


def _velocity(flight: Flight) -> Iterator[Check]:
    odometry = flight.odometry
    if odometry is None or odometry.velocity_E is None or len(odometry.time) < 20:
        return
    truth = smooth(odometry.time, odometry.position_E, derivative=1)
    speed = smooth(odometry.time, odometry.velocity_E)
    if float(np.sqrt(np.mean(truth**2))) < 0.02:
        return
    scale = float(np.sum(speed * truth) / np.sum(truth**2))
    misfit = float(np.sqrt(np.mean((speed - truth) ** 2) / np.mean(truth**2)))
    if abs(scale - 1.0) > 0.15 or misfit > 0.5:
        yield Check(
            "velocity",
            "warn",
            f"Odometry's velocity is {scale:.2f} times the differentiated position (misfit {100 * misfit:.0f} %): "
            "another frame, unit or clock.",
        )
    else:
        yield Check("velocity", "ok", f"Odometry's velocity agrees with its position (factor {scale:.2f}).")


def _units(flight: Flight) -> Iterator[Check]:
    if flight.actuators is None or flight.actuators.unit != "rad/s":
        return
    speeds, tilts = np.abs(flight.actuators.rotor_speed), np.abs(flight.actuators.tilt)
    if speeds.size and float(np.median(speeds)) > 3500.0:
        yield Check(
            "rotor speed unit",
            "warn",
            f"Median rotor speed is {np.median(speeds):.0f}: rpm? Expected rad/s (rpm / 9.549).",
        )
    if speeds.size and float(np.max(speeds)) <= 1.0 and float(np.max(speeds)) > 0:
        yield Check("rotor speed unit", "warn", "Rotor speeds never exceed 1: normalised commands? Expected rad/s.")
    if tilts.size and float(np.percentile(tilts, 90)) > 4 * np.pi:
        yield Check("tilt unit", "warn", f"Tilt reaches {np.max(tilts):.0f}: degrees? Expected rad.")


def _unmeasured(flight: Flight) -> Iterator[Check]:
    """Axes of the IMU without a reading: known to have none, or zero throughout, which no sensor in flight reads."""
    absent = unmeasured_axes(flight)
    if absent:
        yield Check("not measured", "warn", sentence(flight.name, absent))
    if flight.imu is None:
        return
    zero = [
        axis
        for axis, values in zip(AXES, np.hstack((flight.imu.specific_force_B, flight.imu.omega_B)).T, strict=True)
        if not values.any()
    ]
    if zero:
        yield Check(
            "not measured",
            "warn",
            f"The IMU reads exactly zero throughout on {', '.join(zero)} (force: accelerometer, torque: gyroscope): "
            f"not measured? Say so with --unmeasured {','.join(zero)}.",
        )


def _constant(flight: Flight) -> Iterator[Check]:
    columns: list[tuple[str, Array]] = []
    if flight.imu is not None:
        columns += [("gyroscope", flight.imu.omega_B), ("accelerometer", flight.imu.specific_force_B)]
    if flight.odometry is not None:
        columns += [("position", flight.odometry.position_E), ("attitude", flight.odometry.quat_EB[:, 1:])]
    if flight.actuators is not None and flight.actuators.rotor_speed.size:
        columns.append(("rotor speed", flight.actuators.rotor_speed))
    for name, values in columns:
        flat = [str(i) for i in range(values.shape[1]) if np.ptp(values[:, i]) == 0.0]
        if flat:
            yield Check("constant channel", "warn", f"{name}: component(s) {', '.join(flat)} never change.")
    if flight.commanded is not None:
        flat = [str(i) for i in range(6) if np.ptp(flight.commanded.wrench_B[:, i]) == 0.0]
        if len(flat) > 3:
            yield Check("constant channel", "warn", f"commanded wrench: components {', '.join(flat)} never change.")


def _stamps(flight: Flight) -> Iterator[Check]:
    by_message: dict[tuple[str, str], list[str]] = {}
    for role, series in flight.series().items():
        if role == "battery" or len(series.time) < 3:
            continue
        for name, message in _stamp_faults(series):
            by_message.setdefault((name, message), []).append(role)
    for (name, message), roles in by_message.items():  # topics of one recorder share their gaps
        yield Check(name, "warn", f"{', '.join(roles)}: {message}")


def _stamp_faults(series: Series) -> Iterator[tuple[str, str]]:
    if series.gaps:
        longest = max(series.gaps, key=lambda gap: gap.stop - gap.start)
        yield (
            "gaps",
            f"{len(series.gaps)} gap(s), the longest {longest.stop - longest.start:.3f} s at {longest.start:.2f} s; "
            "stretches are split there.",
        )
    spread = jitter(series.time)
    if spread > 0.3 * series.period:
        yield (
            "jitter",
            f"the period varies by {1e3 * spread:.2g} ms around {1e3 * series.period:.3g} ms: stamped on arrival? "
            "Record header stamps.",
        )


def _dropped(flight: Flight) -> Iterator[Check]:
    for role, series in flight.series().items():
        lost = sum(series.dropped.values())
        if lost > 0.01 * (lost + len(series.time)):
            listed = ", ".join(f"{count} {reason}" for reason, count in series.dropped.items())
            yield Check("left out", "warn", f"{role}: {lost} of {lost + len(series.time)} samples ({listed}).")


_CHECKS: tuple[Callable[[Flight], Iterator[Check]], ...] = (
    _roles,
    _specific_force,
    _up,
    _gyro,
    _velocity,
    _units,
    _unmeasured,
    _constant,
    _stamps,
    _dropped,
)
