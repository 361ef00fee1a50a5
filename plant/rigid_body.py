"""Motion of one rigid body, followed at a point O that need not be its centre of mass.

State: position p_E and velocity v_E of O, attitude quat_EB, rate omega_B. With mass m, inertia J about the centre of
mass C, c = com_B from O to C, wrench (F, M_O) about O in B, gravity g_E:

    centre of mass   a_C = F/m + g            M_O - c x F = J domega + omega x J omega      (gravity has no arm about C)
    O                a_O = a_C - domega x c - omega x (omega x c)

so the angular acceleration comes first and nothing is coupled back:

    domega = J^-1 [M_O - c x F - omega x J omega]
    dv_E   = R_EB f_O + g_E,     f_O = F/m - domega x c - omega x (omega x c)      (f_O: an accelerometer at O)
    dquat  = 1/2 quat (0, omega),     dp_E = v_E

Source: Newton and Euler; e.g. Featherstone, Rigid Body Dynamics Algorithms, ch. 2.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array
from wrenchgap.plant.state import State
from wrenchgap.plant.vehicle import GRAVITY, Body
from wrenchgap.plant.wrench_model import forward_dynamics

NUMBERS = 13
"""Of a state y (13,): p_E [m], quat_EB (w, x, y, z), v_E [m/s], omega_B [rad/s]."""


@dataclass(frozen=True)
class RigidBody:
    """A body in uniform gravity [m/s^2], pointing down E's z axis."""

    body: Body
    gravity: float = GRAVITY

    def derivative(self, y: Array, wrench_B: Array) -> Array:
        """Time derivative (..., 13) of y (..., 13) under a wrench (..., 6) about O."""
        quat, omega = y[..., 3:7], y[..., 10:13]
        motion = forward_dynamics(self.body, np.atleast_2d(wrench_B), np.atleast_2d(omega))
        specific_force, omega_dot = (a.reshape(omega.shape) for a in (motion.specific_force_B, motion.omega_dot_B))
        # Inside a step |quat| is not quite one; without the division the result would depend on the choice of E.
        acceleration = so3.rotate(so3.normalise(quat), specific_force) - self.gravity * np.array([0.0, 0.0, 1.0])
        turning = 0.5 * so3.multiply(quat, np.concatenate((np.zeros_like(omega[..., :1]), omega), axis=-1))
        return np.concatenate((y[..., 7:10], turning, acceleration, omega_dot), axis=-1)

    def step(self, y: Array, wrench_B: Array, dt: float) -> Array:
        """The state (..., 13) after `dt` [s] under a wrench (..., 6) about O, held in B; of unit quaternion."""
        new = rk4(lambda at: self.derivative(at, wrench_B), y, dt)
        return np.concatenate((new[..., :3], so3.normalise(new[..., 3:7]), new[..., 7:]), axis=-1)


def rk4(derivative: Callable[[Array], Array], y: Array, h: float) -> Array:
    """One step of length `h` for y' = derivative(y) by the classical Runge-Kutta method of fourth order.

        k1 = f(y), k2 = f(y + h/2 k1), k3 = f(y + h/2 k2), k4 = f(y + h k3);   y <- y + h/6 (k1 + 2 k2 + 2 k3 + k4)

    A quaternion in y is brought back to unit norm after each step; its drift is of the order of the method's own error,
    so that the order is kept (tests/plant/test_rigid_body.py measures it).
    """
    k1 = derivative(y)
    k2 = derivative(y + 0.5 * h * k1)
    k3 = derivative(y + 0.5 * h * k2)
    k4 = derivative(y + h * k3)
    return np.asanyarray(y + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4))


def pack(state: State) -> Array:
    """The 13 numbers of a state with one sample."""
    return np.concatenate((state.position_E[0], state.quat_EB[0], state.velocity_E[0], state.omega_B[0]))


def unpack(time: Array, y: Array, voltage: Array | None = None) -> State:
    """The states that N stamps (N,) and rows (N, 13) are; `voltage` (N,) or None."""
    return State(time, y[:, :3], y[:, 3:7], y[:, 7:10], y[:, 10:13], voltage)
