"""The gains of the attitude controller that flew, from the log: what it asked for, regressed on what it saw.

The law of `plant.controller` is linear in its gains once the torque of the rigid body is taken off,

    J^-1 (M_des - omega x J omega) = -2 zeta w e_omega - w^2 e_R - w^2 k_i q + a_k R_BD domega_D + b

axis by axis, with e_R and e_omega from the logged attitude and reference, q the integral of e_R, clamped where the
model clamps it, and least squares for the coefficients. The controller computes M_des from measured values, so that
sensor noise is in regressors and result alike and does not bias them; one filter (`learn.data.measurement`) is on
both, since they are not of the same instants to a fraction of a period. What is not of this form leaves a residual.
Gains count where e_R and e_omega explain at least 97 % of the variance that the other regressors leave, on
every axis, and both coefficients are positive: a vehicle that follows without error shows none.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array, Flight, Samples
from wrenchgap.flight.stamps import interpolated
from wrenchgap.learn.data.measurement import CUTOFF_HZ, low_pass
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.plant import controller
from wrenchgap.plant.controller import ControllerGains
from wrenchgap.plant.model import Model
from wrenchgap.plant.wrench_model import cross


@dataclass(frozen=True)
class FoundGains:
    """Attitude gains (3,), natural frequencies in rad/s, and the least share of an axis that they explain."""

    zeta: Array
    omega: Array
    explained: float

    def into(self, gains: ControllerGains) -> ControllerGains:
        """`gains` with these of the attitude."""
        zeta, omega = ((float(v[0]), float(v[1]), float(v[2])) for v in (self.zeta, self.omega))
        return replace(gains, zeta_attitude=zeta, omega_attitude=omega)


def attitude_gains(
    flights: Sequence[OpenFlight], model: Model, enough: float = 0.97, fewest: int = 200
) -> FoundGains | None:
    """The gains that flew; None where the logs lack command or attitude reference, or do not have this form.

    `enough` is the least share that they explain of what feed-forward, integral and constant leave of the commanded
    angular acceleration, from `fewest` samples on. A vehicle that turns in order to move follows no logged attitude,
    and is not asked.
    """
    if controller.pushes_along_z_only(model.vehicle):
        return None
    parts = [_regression(s, f.flight, model) for f in flights for s in f.flown]
    known = [p for p in parts if p is not None]
    if len(known) < len(parts) or sum(len(y) for _, y in known) < fewest:
        return None
    X, y = np.concatenate([x for x, _ in known]), np.concatenate([v for _, v in known])
    slope, explained = np.empty((3, 2)), np.empty(3)
    for k in range(3):
        slope[k], left = _fitted(X[:, k], y[:, k])
        _, without = _fitted(X[:, k, 2:], y[:, k])
        explained[k] = 1.0 - left / max(without, 1e-300)
    if explained.min() < enough or slope.min() <= 0.0:
        return None
    omega = np.sqrt(slope[:, 1])
    return FoundGains(slope[:, 0] / (2.0 * omega), omega, float(explained.min()))


def _fitted(X: Array, y: Array) -> tuple[Array, float]:
    """The first two coefficients of least squares, and the variance of what is left."""
    found, *_ = np.linalg.lstsq(X, y, rcond=None)
    return np.asarray(found[:2]), float(np.var(y - X @ found))


def origin(model: Model) -> str:
    """Where the gains of a model come from: "model", or "typical" where they are those of any vehicle of its size."""
    found, usual = model.controller, controller.default_gains(model.vehicle, {"rate_hz": model.controller.rate_hz})
    same = (found.omega_attitude, found.zeta_attitude) == (usual.omega_attitude, usual.zeta_attitude)
    return "typical" if same else "model"


def _regression(samples: Samples, flight: Flight, model: Model) -> tuple[Array, Array] | None:
    """Regressors (N, 3, 5) and angular accelerations (N, 3) that were asked for."""
    asked = samples.wrench_cmd_B if samples.wrench_des_B is None else samples.wrench_des_B
    reference = flight.reference
    if asked is None or reference is None or samples.quat_EB is None or reference.omega_D is None:
        return None
    inside = (samples.time >= reference.time[0]) & (samples.time <= reference.time[-1])
    time, omega = samples.time[inside], samples.omega_B[inside]
    J = model.vehicle.body.inertia
    y = np.asarray(np.linalg.solve(J, (asked[inside, 3:] - cross(omega, omega @ J)).T).T)
    quat_EB, quat_ED = samples.quat_EB[inside], so3.interpolate(time, reference.time, reference.quat_ED)
    quat_BD = so3.multiply(so3.conjugate(quat_EB), quat_ED)
    e = controller.attitude_error(quat_EB, quat_ED)
    turning, growing = interpolated(time, reference.time, reference.omega_D), np.zeros_like(omega)
    if reference.omega_dot_D is not None:
        growing = interpolated(time, reference.time, reference.omega_dot_D)
    e_omega = omega - so3.rotate(quat_BD, turning)
    ahead = so3.rotate(quat_BD, growing)
    integral = controller.integral_series(model.controller, e, samples.dt)
    X = np.stack((-e_omega, -e, -integral, ahead, np.ones_like(e)), axis=2)
    return low_pass(X, samples.dt, CUTOFF_HZ), low_pass(y, samples.dt, CUTOFF_HZ)
