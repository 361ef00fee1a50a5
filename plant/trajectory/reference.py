"""Parts of reference trajectories: samples, smooth profiles, attitudes with consistent rates."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Self

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.state import Index, Motion, State, rows
from wrenchgap.plant.vehicle import GRAVITY
from wrenchgap.plant.wrench_model import cross

Profile = tuple[Array, Array, Array]
"""A value and its first and second derivative with respect to time, all of one shape."""

Rotation = tuple[Array, Array, Array]
"""Attitude (N, 4), rate (N, 3) and its derivative (N, 3), both in the turned frame."""

E_Z = np.array([0.0, 0.0, 1.0])
JUMP_M, JUMP_RAD = 0.01, 0.02
"""By how much positions and velocities [m, m/s], and attitudes [rad], may be off from sample to sample."""


@dataclass(frozen=True)
class Reference:
    """N samples of a reference: `time` (N,), `position_E`, `velocity_E`, `acceleration_E` (N, 3) of O; `quat_ED`
    (N, 4), `omega_D` and `omega_dot_D` (N, 3).
    """  # noqa: D205

    time: Array
    position_E: Array
    velocity_E: Array
    acceleration_E: Array
    quat_ED: Array
    omega_D: Array
    omega_dot_D: Array

    def take(self, index: Index) -> Self:
        """Some of the samples, in the order of `index`."""
        return rows(self, index)

    def followed(self, voltage: float | None = None) -> tuple[State, Motion]:
        """State and motion of a vehicle that follows it exactly, with a battery at this voltage [V]."""
        volts = None if voltage is None else np.full(len(self.time), voltage)
        state = State(self.time, self.position_E, self.quat_ED, self.velocity_E, self.omega_D, volts)
        felt = so3.rotate_inverse(self.quat_ED, self.acceleration_E + GRAVITY * E_Z)
        return state, Motion(self.omega_D, self.omega_dot_D, felt)

    def sample(self, index: int) -> Self:
        """One sample, still with the sample axis (N = 1)."""
        return self.take(slice(index, index + 1))


def check_sampled(reference: Reference, name: str) -> None:
    """Raise UsageError where samples of a reference do not say how it moves between them.

    Positions, velocities and attitudes must follow from the derivatives at both ends of each period h: by the
    corrected trapezoidal rule, x_1 - x_0 = h (v_0 + v_1) / 2 - h^2 (a_1 - a_0) / 12 + O(h^5), and by the trapezoidal
    one, v_1 - v_0 = h (a_0 + a_1) / 2 + O(h^3), where what is left may be a quarter of the largest h a. Rates may jump:
    those of a vehicle that leans into its thrust do with the jerk.
    """
    if len(reference.time) < 2:
        return
    h = np.diff(reference.time)[:, None]
    v, a, omega = reference.velocity_E, reference.acceleration_E, reference.omega_D
    turned = so3.log(so3.multiply(so3.conjugate(reference.quat_ED[:-1]), reference.quat_ED[1:]))
    moved = np.diff(reference.position_E, axis=0) + h**2 / 12.0 * np.diff(a, axis=0)
    parts = (
        (moved, v, JUMP_M),
        (np.diff(v, axis=0), a, JUMP_M + 0.25 * h.max() * np.abs(a).max()),
        (turned, omega, JUMP_RAD + 0.25 * h.max() * np.abs(omega).max()),
    )
    left = [np.linalg.norm(x - 0.5 * h * (rate[:-1] + rate[1:]), axis=1) / most for x, rate, most in parts]
    worst = np.max(left, axis=0)
    if not worst.max() <= 1.0:
        when = reference.time[int(np.argmax(np.nan_to_num(worst, nan=np.inf)))]
        raise UsageError(
            f"{name}: jumps, or moves too fast to be sampled at {1.0 / h.min():.0f} Hz, at {when:.2f} s; expected a "
            "motion that a vehicle can follow; take a slower one, or fly it with `wrenchgap simulate`"
        )


class Trajectory(ABC):
    """A reference as a function of time on [0, `duration`] [s]."""

    duration: float

    @abstractmethod
    def at(self, time: Array) -> Reference:
        """The reference at `time` (N,) [s]."""


def quintic(time: Array, start: float, length: float) -> Profile:
    """From 0 at `start` to 1 at `start + length` [s] with zero rate and acceleration at both ends."""
    s = np.clip((time - start) / length, 0.0, 1.0)
    value = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    rate = 30.0 * s**2 * (1.0 - s) ** 2 / length
    acceleration = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / length**2
    return value, rate, acceleration


def bump(time: Array, start: float, stop: float, ramp: float) -> Profile:
    """From 0 to 1 within `ramp` [s] after `start`, and back within `ramp` before `stop`."""
    up, down = quintic(time, start, ramp), quintic(time, stop - ramp, ramp)
    return up[0] - down[0], up[1] - down[1], up[2] - down[2]


def scaled(profile: Profile, by: Array | float) -> Profile:
    """A profile times a constant, or a profile (N,) along a vector (3,)."""
    value, rate, change = (np.multiply.outer(part, by) for part in profile)
    return value, rate, change


def product(w: Profile, e: Profile) -> Profile:
    """The product of two profiles."""
    return w[0] * e[0], w[0] * e[1] + w[1] * e[0], w[0] * e[2] + 2.0 * w[1] * e[1] + w[2] * e[0]


def ramped_phase(time: Array, rate: float, ramp: float, duration: float) -> Profile:
    """A phase [rad] whose rate grows from 0 to `rate` within `ramp` [s], and dies the same way before `duration`.

    The rate follows the quintic; its integral over a ramp of length T is T (5/2 s^4 - 3 s^5 + s^6).
    """

    def ramp_from(start: float) -> Profile:
        s = np.clip((time - start) / ramp, 0.0, 1.0)
        integral = ramp * s**4 * (2.5 - 3.0 * s + s**2) + np.maximum(time - start - ramp, 0.0)
        value, slope, _ = quintic(time, start, ramp)
        return integral, value, slope

    up, down = ramp_from(0.0), ramp_from(duration - ramp)
    phase, speed, change = (rate * (a - b) for a, b in zip(up, down, strict=True))
    return phase, speed, change


def sine(phase: Profile, multiple: float) -> Profile:
    """sin(multiple * phase) with its derivatives by the chain rule."""
    p, dp, ddp = phase
    s, c = np.sin(multiple * p), np.cos(multiple * p)
    return s, multiple * c * dp, multiple * c * ddp - multiple**2 * s * dp**2


def cosine(phase: Profile, multiple: float) -> Profile:
    """cos(multiple * phase) with its derivatives by the chain rule."""
    p, dp, ddp = phase
    s, c = np.sin(multiple * p), np.cos(multiple * p)
    return c, -multiple * s * dp, -multiple * s * ddp - multiple**2 * c * dp**2


def euler_attitude(angles: Array, rates: Array, accelerations: Array) -> Rotation:
    """quat_ED, omega_D, omega_dot_D of R_ED = Rz(yaw) Ry(pitch) Rx(roll) from (roll, pitch, yaw) profiles (N, 3).

    omega_D = roll' e_x + Rx^T (pitch' e_y + Ry^T yaw' e_z), and its derivative term by term.
    """
    (sr, sp, _), (cr, cp, _) = np.sin(angles).T, np.cos(angles).T
    dr, dp, dy = rates.T
    ddr, ddp, ddy = accelerations.T
    omega = np.stack((dr - dy * sp, dp * cr + dy * cp * sr, -dp * sr + dy * cp * cr), axis=-1)
    omega_dot = np.stack(
        (
            ddr - ddy * sp - dy * dp * cp,
            ddp * cr - dp * dr * sr + ddy * cp * sr - dy * dp * sp * sr + dy * dr * cp * cr,
            -ddp * sr - dp * dr * cr + ddy * cp * cr - dy * dp * sp * cr - dy * dr * cp * sr,
        ),
        axis=-1,
    )
    axes = np.eye(3)
    roll, pitch, yaw = (so3.exp(angles[:, [k]] * axes[k]) for k in range(3))
    return so3.multiply(yaw, so3.multiply(pitch, roll)), omega, omega_dot


def composed(first: Rotation, second: Rotation) -> Rotation:
    """R_1 R_2 with its rate and the derivative of that, both in the frame of the product."""
    quat_1, omega_1, omega_dot_1 = first
    quat_2, omega_2, omega_dot_2 = second
    carried = so3.rotate_inverse(quat_2, omega_1)
    omega_dot = so3.rotate_inverse(quat_2, omega_dot_1) - cross(omega_2, carried) + omega_dot_2
    return so3.multiply(quat_1, quat_2), carried + omega_2, omega_dot


def attitude_of_thrust(force_E: Array, yaw: Array) -> Array:
    """quat_ED (N, 4) whose z axis points along `force_E` (N, 3): shortest tilt from upright after a turn by `yaw`.

    quat = tilt(e_z -> f) yaw(psi); undefined only for a force straight down.
    """
    x, y, z = (force_E / np.linalg.norm(force_E, axis=-1, keepdims=True)).T
    tilt = so3.normalise(np.stack((1.0 + z, -y, x, np.zeros_like(x)), axis=-1))
    return so3.multiply(tilt, so3.exp(yaw[:, None] * E_Z))


def yaw_of(quat_ED: Array) -> Array:
    """The yaw psi (N,) [rad] of the decomposition in `attitude_of_thrust`."""
    return np.asanyarray(2.0 * np.arctan2(quat_ED[:, 3], quat_ED[:, 0]))
