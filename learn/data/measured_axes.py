"""Which axes of the measured wrench hold a measurement, where a sensor did not measure all of its own.

    F_meas = m [f_imu + domega x d + omega x (omega x d)],   d = c - r       centre of mass less place of the IMU
    M_meas = J domega + omega x J omega

So the accelerometer's x takes out F_x and nothing else: no torque reads a specific force. The gyroscope's x takes out
M_x; M_y and M_z where omega_x enters them, by a product of inertia or by (J_x - J_z) omega_x omega_z and its like; and
the forces that it reaches over the lever arm d. Nobody has to work that out: two motions that differ only in what was
not measured are put through `measured_wrench` itself, and an axis that comes out the same was measured.

This mask decides. `Record.noise` is not a number on the other axes, `Record.measured` neither, and everything else
asks those (`Record.measured_axes`, `Dataset.measured_axes`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import AXES, Array
from wrenchgap.flight.stamps import pieces
from wrenchgap.plant.state import Motion
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import cross, measured_wrench

Mask = NDArray[np.bool_]


def measured_axes(vehicle: Vehicle, unmeasured: Sequence[str], rounding: float = 1e-9) -> Mask:
    """The axes (6,) of the measured wrench that depend on no sensor axis in `unmeasured` (`flight.unmeasured`).

    A change of an axis, relative to its size, is `rounding` up to this.
    """
    if not unmeasured:
        return np.ones(6, dtype=bool)
    rng = np.random.default_rng(0)
    force, omega, omega_dot = (rng.uniform(1.0, 2.0, (8, 3)) for _ in range(3))
    plain = _wrench(vehicle, force, omega, omega_dot)
    gone = np.isin(AXES, list(unmeasured))
    moved = _wrench(
        vehicle,
        np.where(gone[:3], 3.0 * force, force),
        np.where(gone[3:], 3.0 * omega, omega),
        np.where(gone[3:], -2.0 * omega_dot, omega_dot),
    )
    size = np.maximum(np.abs(plain), np.abs(moved)).max(axis=0)
    return np.asarray((np.abs(moved - plain).max(axis=0) <= rounding * size) & ~gone)


def _wrench(vehicle: Vehicle, force: Array, omega: Array, omega_dot: Array) -> Array:
    """Measured wrench (N, 6) of readings (N, 3) each, as `learn.data.measurement.prepare` makes it."""
    r = vehicle.imu_position_B
    return measured_wrench(vehicle.body, Motion(omega, omega_dot, felt_at_origin(force, omega, omega_dot, r)))


def felt_at_origin(force: Array, omega: Array, omega_dot: Array, imu_position_B: Array) -> Array:
    """Specific force (N, 3) at O of an IMU that is at `imu_position_B` (3,): f - domega x r - omega x (omega x r)."""
    r, out = imu_position_B, np.empty(np.shape(force))
    for k in pieces(len(force)):
        out[k] = force[k] - cross(omega_dot[k], r) - cross(omega[k], cross(omega[k], r))
    return out


def names_of(mask: Mask) -> tuple[str, ...]:
    """Names of the axes that a mask (6,) leaves out."""
    return tuple(axis for axis, known in zip(AXES, mask, strict=True) if not known)
