"""Rotations: unit quaternions `quat_wxyz` and matrices, vectorised over leading axes.

Convention: `quat_EB` and `R_EB` take B components to E components, `v_E = R_EB @ v_B`. Quaternions are Hamilton's,
scalar first. Readers convert to this order; nothing inside uses another.

Of more than `BLOCK` rows, so many are worked on at a time: what is made on the way stays in the processor's cache.
"""

from collections.abc import Callable
from functools import wraps
from typing import TypeVar, cast

import numpy as np

from wrenchgap.flight.flight import Array

BLOCK = 4096

F = TypeVar("F", bound=Callable[..., Array])


def _by_blocks(function: F) -> F:
    """The function, which works on `BLOCK` rows of its arrays (N, K) at a time; on arrays of other shapes at once."""

    @wraps(function)
    def whole(*arrays: Array) -> Array:
        count = len(arrays[0])
        if count <= BLOCK or any(a.ndim != 2 or len(a) != count for a in arrays):
            return function(*arrays)
        return np.concatenate([function(*(a[k : k + BLOCK] for a in arrays)) for k in range(0, count, BLOCK)])

    return cast(F, whole)


def _length(vector: Array) -> Array:
    """Euclidean length, shape (..., K) to (..., 1); on short rows several times as fast as numpy's."""
    squares = vector * vector
    return np.asanyarray(np.sqrt(sum(squares[..., k : k + 1] for k in range(squares.shape[-1]))))


def normalise(quat_wxyz: Array) -> Array:
    """Unit quaternion(s), shape (..., 4); the sign is kept."""
    return np.asanyarray(quat_wxyz / _length(quat_wxyz))


def continuous(quat_wxyz: Array) -> Array:
    """The same rotations, shape (N, 4), with signs chosen so that neighbours never jump to the antipode."""
    flips = np.sum(quat_wxyz[1:] * quat_wxyz[:-1], axis=-1) < 0
    sign = np.concatenate(([1.0], np.where(np.cumsum(flips) % 2 == 1, -1.0, 1.0)))
    return np.asarray(quat_wxyz * sign[:, None])


def multiply(p_wxyz: Array, q_wxyz: Array) -> Array:
    """Hamilton product p q, shapes (..., 4): first rotate by q, then by p."""
    pw, px, py, pz = np.moveaxis(p_wxyz, -1, 0)
    qw, qx, qy, qz = np.moveaxis(q_wxyz, -1, 0)
    return np.stack(
        (
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
        ),
        axis=-1,
    )


def conjugate(quat_wxyz: Array) -> Array:
    """The inverse rotation of unit quaternion(s), shape (..., 4)."""
    return np.asanyarray(quat_wxyz * np.array([1.0, -1.0, -1.0, -1.0]))


def exp(rotation_vector: Array) -> Array:
    """Quaternion of a rotation vector [rad], shape (..., 3) to (..., 4)."""
    angle = _length(rotation_vector)
    half = 0.5 * angle
    sinc = 0.5 * np.sinc(half / np.pi)  # sin(half) / angle, finite at zero
    return np.concatenate((np.cos(half), sinc * rotation_vector), axis=-1)


@_by_blocks
def log(quat_wxyz: Array) -> Array:
    """Rotation vector [rad] of unit quaternion(s), shape (..., 4) to (..., 3); norm at most pi."""
    q = np.where(quat_wxyz[..., :1] < 0, -quat_wxyz, quat_wxyz)
    norm = _length(q[..., 1:])
    angle = 2.0 * np.arctan2(norm, q[..., :1])
    safe = np.where(norm > 1e-12, norm, 1.0)
    return np.asanyarray(np.where(norm > 1e-12, angle / safe, 2.0) * q[..., 1:])


@_by_blocks
def rotation_between(before_wxyz: Array, after_wxyz: Array) -> Array:
    """Rotation vector(s) [rad] from one attitude to another, log(p^-1 q), shapes (..., 4) to (..., 3)."""
    return log(multiply(conjugate(before_wxyz), after_wxyz))


def matrix(quat_wxyz: Array) -> Array:
    """Rotation matrix R_EB of quat_EB, shape (..., 4) to (..., 3, 3)."""
    w, x, y, z = quat_wxyz[..., 0], quat_wxyz[..., 1], quat_wxyz[..., 2], quat_wxyz[..., 3]
    R = np.empty((*quat_wxyz.shape[:-1], 3, 3))
    R[..., 0, 0] = 1 - 2 * (y * y + z * z)
    R[..., 0, 1] = 2 * (x * y - w * z)
    R[..., 0, 2] = 2 * (x * z + w * y)
    R[..., 1, 0] = 2 * (x * y + w * z)
    R[..., 1, 1] = 1 - 2 * (x * x + z * z)
    R[..., 1, 2] = 2 * (y * z - w * x)
    R[..., 2, 0] = 2 * (x * z - w * y)
    R[..., 2, 1] = 2 * (y * z + w * x)
    R[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return R


def from_matrix(R: Array) -> Array:
    """Unit quaternion(s) of rotation matrices, shape (..., 3, 3) to (..., 4), scalar part not negative.

    Shepperd's method: divides by the largest of the four candidates, so no loss near 180 deg.
    """
    trace, diagonal = np.trace(R, axis1=-2, axis2=-1), np.diagonal(R, axis1=-2, axis2=-1)
    choice = np.argmax(np.concatenate((trace[..., None], diagonal), axis=-1), axis=-1)
    yz, xz, xy = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    sxy, sxz, syz = R[..., 0, 1] + R[..., 1, 0], R[..., 0, 2] + R[..., 2, 0], R[..., 1, 2] + R[..., 2, 1]
    x, y, z = (1 + 2 * diagonal[..., k] - trace for k in range(3))
    rows = (1 + trace, yz, xz, xy), (yz, x, sxy, sxz), (xz, sxy, y, syz), (xy, sxz, syz, z)
    forms = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    q = normalise(np.take_along_axis(forms, choice[..., None, None], axis=-2)[..., 0, :])
    return np.asarray(np.where(q[..., :1] < 0, -q, q))


@_by_blocks
def rotate(quat_wxyz: Array, vector: Array) -> Array:
    """v_E = R_EB v_B for quat_EB, shapes (..., 4) and (..., 3)."""
    w, u = quat_wxyz[..., :1], quat_wxyz[..., 1:]
    t = 2.0 * np.cross(u, vector)
    return np.asanyarray(vector + w * t + np.cross(u, t))


def rotate_inverse(quat_wxyz: Array, vector: Array) -> Array:
    """v_B = R_EB^T v_E for quat_EB, shapes (..., 4) and (..., 3)."""
    return rotate(conjugate(quat_wxyz), vector)


def interpolate(time: Array, knots: Array, quat_wxyz: Array) -> Array:
    """Constant-rate (slerp) interpolation of attitudes at `knots` (K,), quat (K, 4), to `time` (N,); of one, it."""
    if len(knots) == 1:
        return np.tile(quat_wxyz, (len(time), 1))
    if len(time) > BLOCK:
        blocks = (time[k : k + BLOCK] for k in range(0, len(time), BLOCK))
        return np.concatenate([interpolate(some, knots, quat_wxyz) for some in blocks])
    index = np.clip(np.searchsorted(knots, time, side="right") - 1, 0, len(knots) - 2)
    fraction = np.clip((time - knots[index]) / (knots[index + 1] - knots[index]), 0.0, 1.0)
    start = quat_wxyz[index]
    return multiply(start, exp(fraction[:, None] * rotation_between(start, quat_wxyz[index + 1])))


def vee(S: Array) -> Array:
    """Vector a of the skew part of a matrix, whose product with any b is a x b, shape (..., 3, 3) to (..., 3)."""
    skew = S[..., 2, 1] - S[..., 1, 2], S[..., 0, 2] - S[..., 2, 0], S[..., 1, 0] - S[..., 0, 1]
    return np.asarray(0.5 * np.stack(skew, axis=-1))


def tilt_angle(quat_wxyz: Array) -> Array:
    """Angle [rad] between body z and inertial z, shape (..., 4) to (...)."""
    return np.arccos(np.clip(matrix(quat_wxyz)[..., 2, 2], -1.0, 1.0))
