"""Motion of one rigid body, followed at a point O that need not be its centre of mass.

State: position p_E and velocity v_E of O, attitude quat_EB, rate omega_B. With mass m, inertia J about the centre of
mass C, c = com_B from O to C, wrench (F, M_O) about O in B, gravity g_E:

    centre of mass   a_C = F/m + g            M_O - c x F = J domega + omega x J omega      (gravity has no arm about C)
    O                a_O = a_C - domega x c - omega x (omega x c)

so the angular acceleration comes first and nothing is coupled back:

    domega = J^-1 [M_O - c x F - omega x J omega]
    dv_E   = R_EB f_O + g_E,     f_O = F/m - domega x c - omega x (omega x c)      (f_O: an accelerometer at O)
    dquat  = 1/2 quat (0, omega),     dp_E = v_E

Source: Newton and Euler; e.g. Featherstone, Rigid Body Dynamics Algorithms, ch. 2. This is the one-body form of
`plant.wrench_model.forward_dynamics`, written on plain floats because it runs tens of thousands of times.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.plant.state import State
from wrenchgap.plant.vehicle import GRAVITY, Body

Floats = tuple[float, ...]
"""p_E (3), quat_EB (4), v_E (3), omega_B (3): 13 numbers."""


@dataclass(frozen=True)
class RigidBody:
    """A body in uniform gravity [m/s^2], pointing down E's z axis."""

    body: Body
    gravity: float = GRAVITY

    @cached_property
    def _numbers(self) -> tuple[list[float], list[float], list[float]]:
        """Centre of mass, and the upper triangles of the inertia and of its inverse."""
        upper = np.triu_indices(3)
        inertia = self.body.inertia
        return self.body.com_B.tolist(), inertia[upper].tolist(), np.linalg.inv(inertia)[upper].tolist()

    def derivative(self, wrench_B: Array) -> Callable[[Floats], Floats]:
        """Time derivative of the 13 numbers under a wrench (6,) about O that stays constant in B."""
        fx, fy, fz, mx, my, mz = wrench_B.tolist()
        (cx, cy, cz), (j00, j01, j02, j11, j12, j22), (k00, k01, k02, k11, k12, k22) = self._numbers
        ax, ay, az = fx / self.body.mass, fy / self.body.mass, fz / self.body.mass
        tx, ty, tz = mx - (cy * fz - cz * fy), my - (cz * fx - cx * fz), mz - (cx * fy - cy * fx)
        gravity, offset = self.gravity, bool(cx or cy or cz)

        def rates(y: Floats) -> Floats:
            _, _, _, w, x, y_, z, vx, vy, vz, p, q, r = y
            lx, ly, lz = j00 * p + j01 * q + j02 * r, j01 * p + j11 * q + j12 * r, j02 * p + j12 * q + j22 * r
            ex, ey, ez = tx - (q * lz - r * ly), ty - (r * lx - p * lz), tz - (p * ly - q * lx)
            dp = k00 * ex + k01 * ey + k02 * ez
            dq = k01 * ex + k11 * ey + k12 * ez
            dr = k02 * ex + k12 * ey + k22 * ez
            sx, sy, sz = ax, ay, az
            if offset:
                ux, uy, uz = q * cz - r * cy, r * cx - p * cz, p * cy - q * cx  # omega x c
                sx -= dq * cz - dr * cy + q * uz - r * uy
                sy -= dr * cx - dp * cz + r * ux - p * uz
                sz -= dp * cy - dq * cx + p * uy - q * ux
            # R_EB s = s + 2/|q|^2 [w (u x s) + u x (u x s)] with u = (x, y, z). Inside a step |q| is not quite one;
            # without the division the result would depend on the choice of E.
            n = 2.0 / (w * w + x * x + y_ * y_ + z * z)
            bx, by, bz = n * (y_ * sz - z * sy), n * (z * sx - x * sz), n * (x * sy - y_ * sx)
            return (
                vx,
                vy,
                vz,
                0.5 * (-x * p - y_ * q - z * r),
                0.5 * (w * p + y_ * r - z * q),
                0.5 * (w * q + z * p - x * r),
                0.5 * (w * r + x * q - y_ * p),
                sx + w * bx + y_ * bz - z * by,
                sy + w * by + z * bx - x * bz,
                sz + w * bz + x * by - y_ * bx - gravity,
                dp,
                dq,
                dr,
            )

        return rates

    def step(self, y: Floats, wrench_B: Array, dt: float) -> Floats:
        """The state after `dt` [s] under a wrench (6,) about O, held in B; the quaternion has unit norm again."""
        new = rk4(self.derivative(wrench_B), y, dt)
        w, x, y_, z = new[3:7]
        scale = 1.0 / float((w * w + x * x + y_ * y_ + z * z) ** 0.5)
        return (*new[:3], w * scale, x * scale, y_ * scale, z * scale, *new[7:])


def rk4(derivative: Callable[[Floats], Floats], y: Floats, h: float) -> Floats:
    """One step of length `h` for y' = derivative(y) by the classical Runge-Kutta method of fourth order.

        k1 = f(y), k2 = f(y + h/2 k1), k3 = f(y + h/2 k2), k4 = f(y + h k3);   y <- y + h/6 (k1 + 2 k2 + 2 k3 + k4)

    Tuples of floats, not arrays: for a dozen numbers this is several times faster. A quaternion among them is brought
    back to unit norm after each step; its drift is of the order of the method's own error, so that the order is kept
    (tests/plant/test_rigid_body.py measures it).
    """
    half, sixth = 0.5 * h, h / 6.0
    k1 = derivative(y)
    k2 = derivative(tuple([a + half * b for a, b in zip(y, k1, strict=True)]))
    k3 = derivative(tuple([a + half * b for a, b in zip(y, k2, strict=True)]))
    k4 = derivative(tuple([a + h * b for a, b in zip(y, k3, strict=True)]))
    return tuple([a + sixth * (b + 2.0 * (c + d) + e) for a, b, c, d, e in zip(y, k1, k2, k3, k4, strict=True)])


def pack(state: State) -> Floats:
    """The 13 numbers of a state with one sample."""
    return tuple(
        np.concatenate((state.position_E[0], state.quat_EB[0], state.velocity_E[0], state.omega_B[0])).tolist()
    )


def unpack(time: float, y: Floats, voltage: Array | None = None) -> State:
    """The state with one sample that the 13 numbers describe."""
    row = np.array(y)[None, :]
    return State(np.array([time]), row[:, :3], row[:, 3:7], row[:, 7:10], row[:, 10:], voltage)
