"""Which axes a log did not measure: what stands there is not a reading and is never used as one.

An axis is named as in a wrench, and stands for the sensor's axis behind it:

    force_x, force_y, force_z       the accelerometer's x, y, z
    torque_x, torque_y, torque_z    the gyroscope's x, y, z

It is not measured where the user says so, where the log has no number throughout (NaN), or where the first element of
the covariance in every sensor_msgs/Imu is -1: "If you have no estimate for one of the data elements (...), please set
element 0 of the associated covariance matrix to -1" (message definition of sensor_msgs/Imu). Which axes of the
*measured wrench* depend on it is a matter of the vehicle: `learn.data.measurement`.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from enum import StrEnum

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import AXES, Flight
from wrenchgap.flight.formats import Table
from wrenchgap.flight.roles import Source
from wrenchgap.flight.row_kernels import empty


class Why(StrEnum):
    """Why an axis counts as not measured."""

    DECLARED = "declared"
    NAN = "not a number throughout"
    COVARIANCE = "covariance -1 in the log"
    ZERO = "zero throughout"


COVARIANCES = {
    "linear_acceleration_covariance": AXES[:3],
    "angular_velocity_covariance": AXES[3:],
}
"""Fields of sensor_msgs/Imu, and the axes that they speak for."""


def axis_names(names: Iterable[str]) -> tuple[str, ...]:
    """The names in the order of `AXES`, each once; raises UsageError for others, and where nothing would be left."""
    given = list(names)
    wrong = [name for name in given if name not in AXES]
    if wrong:
        raise UsageError(f"--unmeasured: {wrong[0]!r} is no axis; expected names out of {', '.join(AXES)}")
    if len(set(given)) == len(AXES):
        raise UsageError("--unmeasured: got all six axes, and nothing would be left to compare; name five at most")
    return tuple(axis for axis in AXES if axis in given)


def not_estimated(table: Table, source: Source) -> dict[str, Why]:
    """The axes of which every message of an IMU says, by a covariance of -1, that it has no reading."""
    prefix = f"{source.field}." if source.field else ""
    said = {name: table.columns.get(prefix + name) for name in COVARIANCES}
    none = [name for name, first in said.items() if first is not None and first.size and np.all(first == -1.0)]
    return {axis: Why.COVARIANCE for name in none for axis in COVARIANCES[name]}


def unmeasured_axes(flight: Flight) -> dict[str, Why]:
    """The axes that a flight did not measure, in the order of `AXES`, each with the reason."""
    found = {axis: Why(why) for axis, why in flight.unmeasured.items()}
    if flight.imu is not None:
        absent = *empty(flight.imu.specific_force_B), *empty(flight.imu.omega_B)
        found = {axis: Why.NAN for axis, none in zip(AXES, absent, strict=True) if none} | found
    return {axis: found[axis] for axis in AXES if axis in found}


def zero_axes(flight: Flight) -> dict[str, Why]:
    """The axes that read exactly zero throughout, which no sensor in flight does."""
    if flight.imu is None:
        return {}
    readings = zip(AXES, (*flight.imu.specific_force_B.T, *flight.imu.omega_B.T), strict=True)
    return {axis: Why.ZERO for axis, values in readings if not values.any()}


def without_axes(flight: Flight, axes: Mapping[str, Why]) -> Flight:
    """The flight with these axes not measured: its IMU has NaN there."""
    if not axes:
        return flight
    said = {axis: str(why) for axis, why in {**unmeasured_axes(flight), **axes, **flight.unmeasured}.items()}
    imu = flight.imu
    if imu is not None:
        force, omega = imu.specific_force_B.copy(), imu.omega_B.copy()
        for column in map(AXES.index, said):
            (force if column < 3 else omega)[:, column % 3] = np.nan
        imu = replace(imu, omega_B=omega, specific_force_B=force)
    return replace(flight, imu=imu, unmeasured={axis: said[axis] for axis in AXES if axis in said})


def sentence(name: str, axes: Mapping[str, Why], left_out: Iterable[str] | None = None) -> str:
    """One line: which axes of flight `name` are not measured and why, and what is `left_out` for it."""
    by_reason: dict[str, list[str]] = {}
    for axis, why in axes.items():
        by_reason.setdefault(str(why), []).append(axis)
    listed = "; ".join(f"{', '.join(named)} ({why})" for why, named in by_reason.items())
    more = [axis for axis in left_out or () if axis not in axes]
    with_them = f"; and what depends on them: {', '.join(more)}" if more else ""
    return f"{name}: not measured, and left out everywhere: {listed}{with_them}."
