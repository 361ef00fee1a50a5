"""Compiled passes over the samples of a flight, for what a search evaluates thousands of times.

`plant.actuation` and `plant.wrench_model.WrenchModel.report` call these for many samples; below that, and in a trace,
they use their own numpy expressions (docs/decisions/0026-compiled-kernels.md).
"""

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
def rotor_wrench(
    arm: Indices, thrust: Array, turn: Array, drag: Array, normal: Array, lateral: Array, place: Array
) -> Array:
    """Wrench (N, 6) about O of thrusts (N, R) on arms `arm` (R,) at `place` (A, 3), of which `turn` (N, 2A) are cosines
    and sines; `drag` (R,) is spin kappa; thrust directions are cos `normal` + sin `lateral` (A, 3).
    """  # noqa: D205
    n, arms = len(thrust), len(place)
    out = np.zeros((n, 6))
    pull, twist = np.empty(arms), np.empty(arms)
    for k in range(n):
        pull[:], twist[:] = 0.0, 0.0
        for r in range(thrust.shape[1]):
            pull[arm[r]] += thrust[k, r]
            twist[arm[r]] += drag[r] * thrust[k, r]
        for i in range(arms):
            cos, sin, T, Q = turn[k, i], turn[k, arms + i], pull[i], twist[i]
            x = cos * normal[i, 0] + sin * lateral[i, 0]
            y = cos * normal[i, 1] + sin * lateral[i, 1]
            z = cos * normal[i, 2] + sin * lateral[i, 2]
            px, py, pz = place[i]
            out[k, 0] += T * x
            out[k, 1] += T * y
            out[k, 2] += T * z
            out[k, 3] += T * (py * z - pz * y) - Q * x
            out[k, 4] += T * (pz * x - px * z) - Q * y
            out[k, 5] += T * (px * y - py * x) - Q * z
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
