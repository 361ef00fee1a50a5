"""Compiled passes over the samples of a flight, for what a search evaluates thousands of times.

`plant.state.Posture.turn`, `plant.actuation`, `plant.wrench_model.WrenchModel.report`, `plant.effects.axial_inflow` and
`plant.effects.rotor_drag` call these for many samples; below that, and in a trace, they use their own numpy
expressions (docs/decisions/0026-compiled-kernels.md).
"""

import math
from typing import Any

import numpy as np
from numba import njit

from wrenchgap.flight.flight import Array, Indices


def is_batch(*arrays: Any, least: int = 64) -> bool:
    """Whether these are arrays of numbers with `least` samples: a closed loop has one, a trace no numbers."""
    return all(type(a) is np.ndarray and a.dtype == np.float64 and len(a) >= least for a in arrays)


def contiguous(*arrays: Array) -> tuple[Array, ...]:
    """The arrays in C order: a kernel is compiled once for each layout of its arrays."""
    return tuple(np.ascontiguousarray(a) for a in arrays)


@njit(cache=True, nogil=True)
def cosines_and_sines(angles: Array) -> Array:
    """Cosines, then sines (N, 2A) of angles (N, A) [rad], to the last digit but one.

    The remainder of a quarter turn by Cody and Waite, and the polynomials of fdlibm (k_sin.c, k_cos.c, Sun 1993). Up to
    1e4 rad the three parts of a quarter turn leave the remainder exact; beyond, the functions of the C library.
    """
    n, arms = angles.shape
    out = np.empty((n, 2 * arms))
    for k in range(n):
        for i in range(arms):
            x = angles[k, i]
            if not abs(x) <= 1e4:
                out[k, i], out[k, arms + i] = math.cos(x), math.sin(x)
                continue
            quarters = np.rint(x * 0.6366197723675814)
            r = (
                (x - quarters * 1.5707963267341256) - quarters * 6.077100506303966e-11
            ) - quarters * 2.02226624879595e-21
            z = r * r
            sin = -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10
            sin = 8.33333333332248946124e-03 + z * (
                -1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 + z * sin)
            )
            sin = r + r * z * (-1.66666666666666324348e-01 + z * sin)
            cos = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11)
            cos = -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * cos)
            cos = 1.0 - (0.5 * z - z * z * (4.16666666666666019037e-02 + z * cos))
            part = int(quarters) & 3
            if part & 1:
                sin, cos = cos, sin
            out[k, i] = -cos if part == 1 or part == 2 else cos
            out[k, arms + i] = -sin if part >= 2 else sin
    return out


@njit(cache=True, nogil=True)
def rotor_wrench(
    arm: Indices, thrust: Array, turn: Array, drag: Array, normal: Array, lateral: Array, place: Array
) -> Array:
    """Wrench (N, 6) about O of thrusts (N, R) on arms `arm` (R,) at `place` (A, 3), of which `turn` (N, 2A) are cosines
    and sines; `drag` (R,) is spin kappa; thrust directions are cos `normal` + sin `lateral` (A, 3).
    """  # noqa: D205
    n, rotors = thrust.shape
    arms, block = len(place), 64  # samples that are summed side by side
    out = np.empty((n, 6))
    pull, twist, into = np.empty((arms, block)), np.empty((arms, block)), np.empty((6, block))
    cosines, sines = np.empty(block), np.empty(block)
    for first in range(0, n, block):
        count = min(block, n - first)
        pull[:], twist[:], into[:] = 0.0, 0.0, 0.0
        for k in range(count):
            for r in range(rotors):
                pull[arm[r], k] += thrust[first + k, r]
                twist[arm[r], k] += drag[r] * thrust[first + k, r]
        for i in range(arms):
            a, b, c, d, e, f = normal[i, 0], normal[i, 1], normal[i, 2], lateral[i, 0], lateral[i, 1], lateral[i, 2]
            px, py, pz, pulls, twists = place[i, 0], place[i, 1], place[i, 2], pull[i], twist[i]
            for k in range(count):
                cosines[k], sines[k] = turn[first + k, i], turn[first + k, arms + i]
            for k in range(count):
                cos, sin, T, Q = cosines[k], sines[k], pulls[k], twists[k]
                x, y, z = cos * a + sin * d, cos * b + sin * e, cos * c + sin * f
                into[0, k] += T * x
                into[1, k] += T * y
                into[2, k] += T * z
                into[3, k] += T * (py * z - pz * y) - Q * x
                into[4, k] += T * (pz * x - px * z) - Q * y
                into[5, k] += T * (px * y - py * x) - Q * z
        out[first : first + count] = into[:, :count].T
    return out


@njit(cache=True, nogil=True)
def hub_velocity(velocity: Array, omega: Array, hub: Array) -> Array:
    """V + omega x p (N, R, 3) of velocities and body rates (N, 3) and hubs (N, R, 3)."""
    out = np.empty(hub.shape)
    for k in range(hub.shape[0]):
        a, b, c = omega[k, 0], omega[k, 1], omega[k, 2]
        for r in range(hub.shape[1]):
            x, y, z = hub[k, r, 0], hub[k, r, 1], hub[k, r, 2]
            out[k, r, 0] = velocity[k, 0] + (b * z - c * y)
            out[k, r, 1] = velocity[k, 1] + (c * x - a * z)
            out[k, r, 2] = velocity[k, 2] + (a * y - b * x)
    return out


@njit(cache=True, nogil=True)
def rotor_drag(coefficient: float, speed: Array, velocity: Array, omega: Array, hub: Array, normal: Array) -> Array:
    """Wrench (N, 6) about O of forces -coefficient |speed| times the velocity of the hubs (N, R, 3), `velocity` and
    `omega` (N, 3) being those of O, across their `normal` (N, R, 3).
    """  # noqa: D205
    out = np.zeros((len(speed), 6))
    for k in range(len(speed)):
        a, b, c = omega[k, 0], omega[k, 1], omega[k, 2]
        for r in range(speed.shape[1]):
            x, y, z = hub[k, r, 0], hub[k, r, 1], hub[k, r, 2]
            u, v, w = velocity[k, 0] + b * z - c * y, velocity[k, 1] + c * x - a * z, velocity[k, 2] + a * y - b * x
            n, o, p = normal[k, r, 0], normal[k, r, 1], normal[k, r, 2]
            along, gain = u * n + v * o + w * p, -coefficient * abs(speed[k, r])
            fx, fy, fz = gain * (u - along * n), gain * (v - along * o), gain * (w - along * p)
            out[k, 0] += fx
            out[k, 1] += fy
            out[k, 2] += fz
            out[k, 3] += y * fz - z * fy
            out[k, 4] += z * fx - x * fz
            out[k, 5] += x * fy - y * fx
    return out


@njit(cache=True, nogil=True)
def _cross(a, b):  # type: ignore[no-untyped-def]
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, nogil=True)
def _times(M, v):  # type: ignore[no-untyped-def]
    return (
        M[0, 0] * v[0] + M[0, 1] * v[1] + M[0, 2] * v[2],
        M[1, 0] * v[0] + M[1, 1] * v[1] + M[1, 2] * v[2],
        M[2, 0] * v[0] + M[2, 1] * v[1] + M[2, 2] * v[2],
    )


@njit(cache=True, nogil=True)
def reported_wrench(wrench: Array, omega: Array, numbers: Array) -> Array:
    """Measured wrench (N, 6): `measured_wrench` of a believed body after `forward_dynamics` of the true one.

    `numbers` (35,) holds mass, centre of mass, inertia and its inverse of the true body, then mass, centre of mass and
    inertia of the believed one.
    """
    mass, com, inertia, inverse = numbers[0], numbers[1:4], numbers[4:13].reshape(3, 3), numbers[13:22].reshape(3, 3)
    believed_mass, believed_com, believed_inertia = numbers[22], numbers[23:26], numbers[26:35].reshape(3, 3)
    out = np.empty((len(wrench), 6))
    c, d = (com[0], com[1], com[2]), (believed_com[0], believed_com[1], believed_com[2])
    for k in range(len(wrench)):
        force = (wrench[k, 0], wrench[k, 1], wrench[k, 2])
        w = (omega[k, 0], omega[k, 1], omega[k, 2])
        arm = _cross(c, force)
        gyro = _cross(w, _times(inertia, w))
        moment = (wrench[k, 3] - arm[0] - gyro[0], wrench[k, 4] - arm[1] - gyro[1], wrench[k, 5] - arm[2] - gyro[2])
        omega_dot = _times(inverse, moment)
        euler, centripetal = _cross(omega_dot, c), _cross(w, _cross(w, c))
        euler_d, centripetal_d = _cross(omega_dot, d), _cross(w, _cross(w, d))
        torque, gyro_d = _times(believed_inertia, omega_dot), _cross(w, _times(believed_inertia, w))
        for a in range(3):
            specific = force[a] / mass - euler[a] - centripetal[a]
            out[k, a] = believed_mass * (specific + euler_d[a] + centripetal_d[a])
            out[k, 3 + a] = torque[a] + gyro_d[a]
    return out
