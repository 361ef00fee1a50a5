"""Errors of a flight against its reference, and its deviation from a recorded flight."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import Array, OdometrySeries
from wrenchgap.flight.stamps import interpolated
from wrenchgap.plant.controller import attitude_error
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory import Reference


@dataclass(frozen=True)
class TrackingErrors:
    """Errors of N samples at `time` (N,) [s]: `attitude` (N, 3) is e_R, `position` (N,) the distance [m]."""

    time: Array
    attitude: Array
    position: Array


def tracking_errors(time: Array, position_E: Array, quat_EB: Array, reference: Reference) -> TrackingErrors:
    """Errors of N samples against N samples of a reference; e_R of `plant.controller`."""
    e = attitude_error(quat_EB, reference.quat_ED)
    return TrackingErrors(time, e, np.linalg.norm(position_E - reference.position_E, axis=-1))


@dataclass(frozen=True)
class Tracking:
    """Tracking error of a flight of `duration` [s].

    attitude_*   (3,) of |e_R| per axis, the sine of the error angle (see `plant.controller`)
    position_*   of the distance from the reference [m]
    """

    attitude_mean: Array
    attitude_median: Array
    attitude_rms: Array
    position_mean: float
    position_median: float
    position_rms: float
    position_max: float
    duration: float

    @classmethod
    def of(cls, errors: TrackingErrors) -> Self:
        """Averages over all samples."""
        e, distance = np.abs(errors.attitude), errors.position
        return cls(
            attitude_mean=e.mean(axis=0),
            attitude_median=np.median(e, axis=0),
            attitude_rms=np.sqrt(np.mean(e**2, axis=0)),
            position_mean=float(distance.mean()),
            position_median=float(np.median(distance)),
            position_rms=float(np.sqrt(np.mean(distance**2))),
            position_max=float(distance.max()),
            duration=float(errors.time[-1] - errors.time[0]),
        )


@dataclass(frozen=True)
class Deviation:
    """Deviation of a flight of `duration_s` from recorded poses: angle between the attitudes, and distance."""

    attitude_deg_max: float
    attitude_deg_rms: float
    position_m_max: float
    position_m_rms: float
    duration_s: float


def deviation(state: State, odometry: OdometrySeries, dt: float) -> Deviation:
    """From the odometry's samples within a flight whose states (N) are `dt` [s] apart, linear in between."""
    recorded = during(odometry, state.time)
    stamps = recorded.time
    position = interpolated(stamps, state.time, state.position_E)
    quat = so3.interpolate(stamps, state.time, state.quat_EB)
    angle = np.degrees(np.linalg.norm(so3.log(so3.multiply(so3.conjugate(recorded.quat_EB), quat)), axis=-1))
    distance = np.linalg.norm(position - recorded.position_E, axis=-1)
    return Deviation(
        attitude_deg_max=float(angle.max()),
        attitude_deg_rms=float(np.sqrt(np.mean(angle**2))),
        position_m_max=float(distance.max()),
        position_m_rms=float(np.sqrt(np.mean(distance**2))),
        duration_s=len(state.time) * dt,
    )


def during(odometry: OdometrySeries, time: Array) -> OdometrySeries:
    """The poses of an odometry from the first to the last of `time` (N,). Raises LogError where there are none."""
    inside = (odometry.time >= time[0] - 1e-6) & (odometry.time <= time[-1] + 1e-6)
    if not inside.any():
        raise LogError(
            f"{odometry.topic}: no pose from {time[0]:.3f} to {time[-1]:.3f} s, which is all that was flown; expected "
            "a flight whose commands, sensors and reference agree, and some poses of it; see `wrenchgap inspect`"
        )
    return OdometrySeries(odometry.topic, odometry.time[inside], odometry.position_E[inside], odometry.quat_EB[inside])
