"""The reference of a log as a trajectory."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import Array, ReferenceSeries
from wrenchgap.flight.stamps import interpolated
from wrenchgap.plant.trajectory.reference import Reference, Trajectory


@dataclass(frozen=True)
class Recorded(Trajectory):
    """The reference of a log, linear between its samples (attitude: constant rate), from its first sample on.

    What the log lacks is differentiated: velocity from position, rate from attitude, accelerations from those.
    `start` [s] shifts time zero to that time of the series; the first sample by default.
    """

    series: ReferenceSeries
    start: float | None = None

    @property
    def duration(self) -> float:  # type: ignore[override]
        """From the start to the last sample [s]."""
        return float(self.series.time[-1] - self._zero)

    @property
    def _zero(self) -> float:
        return float(self.series.time[0]) if self.start is None else self.start

    @cached_property
    def _columns(self) -> tuple[Array, ...]:
        s = self.series
        if len(s.time) < 3:
            raise LogError(f"{s.topic}: got {len(s.time)} reference samples, at least 3 are needed to fly along them")
        omega = _rate_of(s.time, s.quat_ED) if s.omega_D is None else s.omega_D
        velocity = _slope(s.time, s.position_E) if s.velocity_E is None else s.velocity_E
        acceleration = _slope(s.time, velocity) if s.acceleration_E is None else s.acceleration_E
        omega_dot = _slope(s.time, omega) if s.omega_dot_D is None else s.omega_dot_D
        return s.position_E, velocity, acceleration, omega, omega_dot

    def at(self, time: Array) -> Reference:
        """Interpolated; before the first and after the last sample their values are held."""
        knots, t = self.series.time, time + self._zero
        position, velocity, acceleration, omega, omega_dot = (interpolated(t, knots, c) for c in self._columns)
        quat = so3.interpolate(t, knots, self.series.quat_ED)
        return Reference(time, position, velocity, acceleration, quat, omega, omega_dot)


def _slope(time: Array, values: Array) -> Array:
    """Derivative (N, 3): the mean of the slopes on both sides, leaving out a side on which the value jumps.

    A jump (a slope 5 times beyond the 98th percentile) is a corner of the recorded reference, not an acceleration.
    """
    slopes = np.diff(values, axis=0) / np.diff(time)[:, None]
    size = np.linalg.norm(slopes, axis=-1)
    smooth = size <= 5.0 * np.quantile(size, 0.98)
    weight = np.concatenate(([0.0], smooth, [0.0]))
    padded = np.concatenate((np.zeros((1, 3)), slopes, np.zeros((1, 3)))) * weight[:, None]
    count = np.maximum(weight[:-1] + weight[1:], 1.0)
    return np.asarray((padded[:-1] + padded[1:]) / count[:, None])


def _rate_of(time: Array, quat: Array) -> Array:
    """Rate (N, 3) in the turning frame: the mean of the steps on both sides of each sample."""
    step = so3.log(so3.multiply(so3.conjugate(quat[:-1]), quat[1:])) / np.diff(time)[:, None]
    return np.concatenate((step[:1], 0.5 * (step[1:] + step[:-1]), step[-1:]))
