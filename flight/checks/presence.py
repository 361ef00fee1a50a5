"""Which roles are played, units that sizes alone betray, axes and channels without a reading."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.remedies import option
from wrenchgap.flight.flight import AXES, Array, Flight
from wrenchgap.flight.row_kernels import varying
from wrenchgap.flight.stamps import thinned
from wrenchgap.flight.unmeasured import sentence, unmeasured_axes


def roles(flight: Flight) -> Iterator[Check]:
    """What is played, and what cannot be done without the rest."""
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


def vehicles(found: Sequence[tuple[str, str]]) -> tuple[Check, ...]:
    """Whether the log is of one vehicle, or nobody said of which."""
    if not found:
        return ()
    listed = ", ".join(topic for _, topic in found)
    part, topic = found[0]
    words = f"The log may be of {len(found)} vehicles: {listed} could each be the {part}; say which, the rest follows"
    return (Check("vehicles", "bad", words, f"--topic {part}={topic}"),)


def units(flight: Flight, rows: int = 20_000) -> Iterator[Check]:
    """Rotor speeds and tilt angles, by their sizes in so many rows, evenly spread over the flight."""
    if flight.actuators is None or flight.actuators.unit != "rad/s":
        return
    some = thinned(len(flight.actuators.time), rows)
    speeds, tilts = np.abs(flight.actuators.rotor_speed[some]), np.abs(flight.actuators.tilt[some])
    if speeds.size and float(np.median(speeds)) > 3500.0:
        yield Check(
            "rotor-speed-unit",
            "warn",
            f"Median rotor speed is {np.median(speeds):.0f}: rpm? Expected rad/s (rpm / 9.549).",
            option(flight, "rpm", "rotor_speed"),
        )
    if speeds.size and float(np.max(speeds)) <= 1.0 and 0.0 < np.max(np.abs(flight.actuators.rotor_speed)) <= 1.0:
        yield Check("rotor-speed-unit", "warn", "Rotor speeds never exceed 1: normalised commands? Expected rad/s.")
    if tilts.size and float(np.percentile(tilts, 90)) > 4 * np.pi:
        words = f"Tilt reaches {np.max(tilts):.0f}: degrees, expected rad"
        yield Check("tilt-unit", "bad", words, option(flight, "deg", "tilt"))


def unmeasured(flight: Flight) -> Iterator[Check]:
    """Axes of the IMU without a reading: known to have none, or zero throughout, which no sensor in flight reads."""
    absent = unmeasured_axes(flight)
    if absent:
        yield Check("not-measured", "warn", sentence(flight.name, absent))
    if flight.imu is None:
        return
    zero = [
        axis
        for axis, values in zip(AXES, (*flight.imu.specific_force_B.T, *flight.imu.omega_B.T), strict=True)
        if not values.any()
    ]
    if zero:
        yield Check(
            "not-measured",
            "warn",
            f"The IMU reads exactly zero throughout on {', '.join(zero)} (force: accelerometer, torque: gyroscope): "
            f"not measured? Say so with --unmeasured {','.join(zero)}.",
            f"--unmeasured {','.join(zero)}" if len(zero) < len(AXES) else "--topic imu=none",
        )


def _still(values: Array) -> NDArray[np.bool_]:
    """Columns (C,) of numbers (N, C) that never change."""
    return np.asarray(~varying(values) & ~np.isnan(values[0]))


def constant(flight: Flight) -> Iterator[Check]:
    """Channels that never change; an IMU of which nothing does is none."""
    columns: list[tuple[str, Array]] = []
    if flight.imu is not None:
        columns += [("gyroscope", flight.imu.omega_B), ("accelerometer", flight.imu.specific_force_B)]
    if flight.odometry is not None:
        columns += [("position", flight.odometry.position_E), ("attitude", flight.odometry.quat_EB[:, 1:])]
    if flight.actuators is not None and flight.actuators.rotor_speed.size:
        columns.append(("rotor speed", flight.actuators.rotor_speed))
    if flight.imu is not None and not any(varying(v).any() for _, v in columns[:2]):
        mend = "--topic imu=none" if flight.odometry is not None else None
        yield Check("constant-channel", "bad", "The IMU never changes at all: it is stuck, or no IMU", mend)
        columns = columns[2:]
    for name, values in columns:
        flat = [str(i) for i in np.flatnonzero(_still(values))]
        if flat:
            yield Check("constant-channel", "warn", f"{name}: component(s) {', '.join(flat)} never change.")
    if flight.commanded is not None:
        flat = [str(i) for i in np.flatnonzero(_still(flight.commanded.wrench_B))]
        if len(flat) > 3:
            yield Check("constant-channel", "warn", f"commanded wrench: components {', '.join(flat)} never change.")
