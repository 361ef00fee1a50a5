"""The paper's controller and a closed-form allocation, written out once more for the independent engine.

Control law of Zhang et al., RA-L 2020, and the pseudo-inverse allocation of six tilting arms:

    F_B = R_EB^T m [a_D - 2 zeta_p w_p (v - v_D) - w_p^2 (p - p_D) + g e_z]
    M_B = J [R_BD domega_D - omega x (R_BD omega_D) - 2 zeta_a w_a e_omega - w_a^2 e_R - i] + omega x J omega
    e_R = 1/2 (R_ED^T R_EB - R_EB^T R_ED)^vee,   i = k_i w_a^2 int e_R dt
"""

from __future__ import annotations

import numpy as np

from benchmarks.hidden_effects.airframe import ARM_LENGTH, AZIMUTH, C_F, GRAVITY, INERTIA, KAPPA, MASS, SPEED_MAX, TWIST
from wrenchgap.flight.flight import Array

POSITION_GAINS = (0.707, 3.5)  # damping ratio, natural frequency [rad/s]
ATTITUDE_DAMPING = np.array([1.3, 1.3, 0.74])
ATTITUDE_FREQUENCY = 3.5  # rad/s
INTEGRAL_LIMIT = 0.5  # rad s, on int e_R dt


def cross(a: Array, b: Array) -> Array:
    """Vector product of two 3-vectors, without numpy's overhead."""
    ax, ay, az = a
    bx, by, bz = b
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))


class Autopilot:
    """Wrench and actuator commands from state and reference; holds the integral and the last tilt commands."""

    def __init__(self, integral: float, dt: float) -> None:
        self.integral, self.dt = integral, dt
        self.error_sum = np.zeros(3)
        self.tilt = np.zeros(len(AZIMUTH))
        self._J = np.array(INERTIA)
        s, c, L = np.sin(AZIMUTH), np.cos(AZIMUTH), ARM_LENGTH
        zero, one = np.zeros(6), np.ones(6)
        self._lateral = np.stack((s / 3, -c / 3, zero, zero, zero, -one / (6 * L)), 1)
        self._vertical = np.stack((zero, zero, one / 6, s / (3 * L), -c / (3 * L), zero), 1)

    def wrench(self, p: Array, R: Array, v: Array, omega: Array, reference: tuple[Array, ...]) -> Array:
        """Desired wrench (6,) in B. `p`, `v` in E, `omega` in B; reference: p, v, a (E), R_ED, omega_D, omega_dot_D."""
        p_D, v_D, a_D, R_D, omega_D, omega_dot_D = reference
        zeta, w = POSITION_GAINS
        a = a_D - 2 * zeta * w * (v - v_D) - w * w * (p - p_D)
        a[2] += GRAVITY
        force = MASS * (R.T @ a)
        R_BD = R.T @ R_D
        e_R = 0.5 * np.array((R_BD[1, 2] - R_BD[2, 1], R_BD[2, 0] - R_BD[0, 2], R_BD[0, 1] - R_BD[1, 0]))
        rate_D = R_BD @ omega_D
        self.error_sum = np.clip(self.error_sum + self.dt * e_R, -INTEGRAL_LIMIT, INTEGRAL_LIMIT)
        w2 = ATTITUDE_FREQUENCY**2
        alpha = (
            R_BD @ omega_dot_D
            - cross(omega, rate_D)
            - 2 * ATTITUDE_DAMPING * ATTITUDE_FREQUENCY * (omega - rate_D)
            - w2 * e_R
            - self.integral * w2 * self.error_sum
        )
        torque = self._J * alpha + cross(omega, self._J * omega)
        return np.concatenate((force, torque))

    def allocate(self, wrench: Array, pair_split: Array | None = None) -> tuple[Array, Array]:
        """Tilt (6,) [rad], unwrapped, and rotor speed (12,) [rad/s] that make `wrench`.

        `pair_split` (6,) d gives each arm's upper rotor (1 + d) and its lower (1 - d) of half the pair's thrust; the
        drag torque that this leaves, sum s kappa d T n, is made up for by the rest of the wrench (two iterations).
        """
        lateral, vertical = self._lateral @ wrench, self._vertical @ wrench
        split = np.zeros(6)
        if pair_split is not None:
            split = pair_split
            for _ in range(2):
                twist = TWIST[0::2] * KAPPA * split
                s, c = np.sin(AZIMUTH), np.cos(AZIMUTH)
                drag = np.array((twist * lateral @ s, -(twist * lateral) @ c, twist @ vertical))
                rest = np.concatenate((wrench[:3], wrench[3:] - drag))
                lateral, vertical = self._lateral @ rest, self._vertical @ rest
        thrust = np.hypot(lateral, vertical)
        wanted = np.arctan2(lateral, vertical)
        step = np.remainder(wanted - self.tilt + np.pi, 2 * np.pi) - np.pi
        self.tilt = np.where(thrust > 0.2, self.tilt + step, self.tilt)
        squared = np.empty(12)
        squared[0::2] = thrust * (1 + split)
        squared[1::2] = thrust * (1 - split)
        return self.tilt, np.minimum(np.sqrt(squared / (2 * C_F)), SPEED_MAX)
