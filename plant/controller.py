"""The paper's flight controller: a geometric PD law with acceleration feedforward and an attitude integral.

    F_des_B = R_EB^T m [a_D - 2 zeta_p w_p (v - v_D) - w_p^2 (p - p_D) + g e_z]
    M_des_B = J [R_EB^T R_ED omega_dot_D - omega x (R_EB^T R_ED omega_D) - 2 zeta_a w_a e_omega - w_a^2 e_R - i]
              + omega x J omega
    e_R     = 1/2 (R_ED^T R_EB - R_EB^T R_ED)^vee            R_EB = R_ED exp(theta^)  =>  e_R ~ +theta
    e_omega = omega - R_EB^T R_ED omega_D
    i       = k_i w_a^2 q,   q = int e_R dt, clamped

Source: Zhang et al., RA-L 2020, eqs. (attitude_control) and (position_control), with the error signs above
(the paper's coordinate transformations, taken literally, give their negatives, which is positive feedback). `m` and `J`
are those that the controller assumes; the wrench is about its assumed centre of mass. The position loop acts on O, as
if the centre of mass were there.

With exact tracking of the wrench the errors obey x'' + 2 zeta w x' + w^2 x = 0 (attitude: for small angles).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.flight.row_kernels import clamped_sum
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory.reference import Reference, attitude_of_thrust, yaw_of
from wrenchgap.plant.vehicle import GRAVITY, Body, Vehicle
from wrenchgap.plant.wrench_model import cross


@dataclass(frozen=True)
class ControllerGains:
    """Gains of the controller; the defaults are those of the paper, for its vehicle. `default_gains` suits any other.

    zeta_position, omega_position   damping ratio and natural frequency [rad/s] of the position loop
    zeta_attitude, omega_attitude   the same about body x, y, z (3,)
    integral                        k_i [1/s]; 0 switches the integral off
    integral_limit                  bound of |q| per axis [rad s]
    transport                       weight of the term omega x (R_EB^T R_ED omega_D): 1 makes the law exact; 0 for
                                    controllers that leave it out, as the one that flew the multibody logs does
    rate_hz                         how often the law is evaluated [Hz]
    """

    zeta_position: float = 0.707
    omega_position: float = 3.5
    zeta_attitude: tuple[float, float, float] = (1.3, 1.3, 0.74)
    omega_attitude: tuple[float, float, float] = (3.5, 3.5, 3.5)
    integral: float = 0.3
    integral_limit: float = 0.3
    transport: float = 1.0
    rate_hz: float = 200.0

    def __post_init__(self) -> None:
        for name in ("omega_position", "integral_limit", "rate_hz"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ModelError(f"controller.{name}: got {getattr(self, name)}, expected a positive number")
        for name in ("zeta_position", "integral", "transport"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise ModelError(
                    f"controller.{name}: got {getattr(self, name)}, expected a number that is not negative"
                )
        for name in ("zeta_attitude", "omega_attitude"):
            values = np.asarray(getattr(self, name), dtype=float)
            if values.shape != (3,) or not np.all(np.isfinite(values) & (values > 0)):
                raise ModelError(f"controller.{name}: got {getattr(self, name)}, expected three positive numbers")


def default_gains(
    vehicle: Vehicle,
    gains: Mapping[str, Any] | None = None,
    bandwidth_ratio: float = 5.0,
    max_bandwidth_period: float = 0.25,
) -> ControllerGains:
    """Gains for any vehicle from its mass m and inertia J; those in `gains`, by name, stay as they are.

    `bandwidth_ratio` is n, attitude over position bandwidth. `max_bandwidth_period` is the largest attitude bandwidth
    times control period: the law is then evaluated some 25 times in a natural period.

    Attitude: one radian of error asks for the torque of the weight at one radius of gyration r_k = sqrt(J_k / m),

        J_k w_k^2 = m g r_k   =>   w_k = sqrt(g / r_k),

    since the rotors lie at about that distance and carry about that weight. Angular accelerations then go with
    1 / length: Froude scaling, Mahony, Kumar, Corke, "Multirotor aerial vehicles", IEEE Robotics & Automation Magazine
    19 (3), 2012, "Size, weight, and power constraints and scaling laws". Yaw of a vehicle that pushes along z comes
    from drag torque: at most kappa m g is commanded. No bandwidth exceeds `max_bandwidth_period` over the control
    period.

    Position: w_p = w_a / n, the slower of roll and pitch. A vehicle that turns in order to move has, for small errors,
    s^4 + 2 z_a w_a s^3 + w_a^2 s^2 + 2 z_p w_p w_a^2 s + w_p^2 w_a^2, stable for n > z_a / z_p + z_p / z_a
    (Routh-Hurwitz). Our choices: n = 5, two and a half times that bound, and z_a = 0.8 about every axis.
    """
    given = dict(gains or {})
    base = ControllerGains(**{"zeta_attitude": (0.8, 0.8, 0.8), **given})
    radius = np.sqrt(np.diag(vehicle.body.inertia) / vehicle.body.mass)
    lever = radius.copy()
    if vehicle.rotors is not None and pushes_along_z_only(vehicle):
        lever[2] = min(lever[2], max(float(np.mean(np.abs(vehicle.rotors.kappa))), 1e-3 * lever[2]))
    omega = np.minimum(np.sqrt(GRAVITY * lever) / radius, max_bandwidth_period * base.rate_hz)
    x, y, z = given.get("omega_attitude", omega.tolist())
    slow = given.get("omega_position", min(x, y) / bandwidth_ratio)
    return replace(base, omega_attitude=(x, y, z), omega_position=slow)


def attitude_error(quat_EB: Array, quat_ED: Array) -> Array:
    """e_R (..., 3) of attitudes (..., 4): the sine of the error angle times its axis, in B.

    With the quaternion (w, u) of R_ED^T R_EB, (R - R^T)^vee / 2 = 2 w u.
    """
    q = so3.multiply(so3.conjugate(quat_ED), quat_EB)
    return np.asanyarray(2.0 * q[..., :1] * q[..., 1:])


def pushes_along_z_only(vehicle: Vehicle) -> bool:
    """Whether no rotor can push away from body z: the attitude must then serve the force.

    A vehicle of which only the wrench is known (no arms) is taken to be fully actuated.
    """
    if vehicle.arms is None or bool(np.any(vehicle.arms.tilts)):
        return False
    return bool(np.allclose(vehicle.arms.normal_B, [0.0, 0.0, 1.0], atol=1e-9))


def control_law(
    gains: ControllerGains, body: Body, state: State, reference: Reference, integral: Array, along_z: bool = False
) -> tuple[Array, Array]:
    """The control law for N independent samples.

    Parameters
    ----------
    integral : (N, 3)
        q [rad s].
    along_z
        Whether the vehicle can push along body z only: the desired attitude then points that axis along F_des, with the
        yaw of the reference, and the force is the projection on it.

    Returns
    -------
    wrench_B : (N, 6)
        Desired, about the assumed centre of mass [N, Nm].
    error : (N, 3)
        e_R.
    """
    acceleration_E = (
        reference.acceleration_E
        - 2.0 * gains.zeta_position * gains.omega_position * (state.velocity_E - reference.velocity_E)
        - gains.omega_position**2 * (state.position_E - reference.position_E)
    )
    force_E = np.asanyarray(body.mass * (acceleration_E + np.array([0.0, 0.0, GRAVITY])))
    force_B = so3.rotate_inverse(state.quat_EB, force_E)
    quat_ED = reference.quat_ED
    if along_z:
        quat_ED = attitude_of_thrust(force_E, yaw_of(quat_ED))
        force_B = force_B * np.array([0.0, 0.0, 1.0])
    error = attitude_error(state.quat_EB, quat_ED)
    quat_BD = so3.multiply(so3.conjugate(state.quat_EB), quat_ED)
    omega, omega_ref = state.omega_B, so3.rotate(quat_BD, reference.omega_D)
    zeta, frequency = np.asarray(gains.zeta_attitude), np.asarray(gains.omega_attitude)
    omega_dot = (
        so3.rotate(quat_BD, reference.omega_dot_D)
        - gains.transport * cross(omega, omega_ref)
        - 2.0 * zeta * frequency * (omega - omega_ref)
        - frequency**2 * (error + gains.integral * integral)
    )
    J = body.inertia  # symmetric, so row vectors times J are J times column vectors
    torque_B = omega_dot @ J + cross(omega, omega @ J)
    return np.concatenate((force_B, torque_B), axis=-1), error


def next_integral(gains: ControllerGains, integral: Array, error: Array, dt: float) -> Array:
    """The integral q (..., 3) [rad s] a period of `dt` [s] after it was `integral`, with the error e_R (..., 3)."""
    return np.clip(integral + dt * error, -gains.integral_limit, gains.integral_limit)


def integral_series(gains: ControllerGains, error: Array, dt: float, start: Array | None = None) -> Array:
    """The integral q (N, 3) that the law had at each of N consecutive samples `dt` apart: `next_integral`, one by one.

    `error` (N, 3) is e_R, `start` (3,) the value at the first sample.
    """
    limits = np.array(np.broadcast_to(np.asarray(gains.integral_limit, dtype=float), 3))
    before = np.zeros(3) if start is None else np.array(start, dtype=float)
    return np.asarray(clamped_sum(np.ascontiguousarray(dt * error), before, limits))
