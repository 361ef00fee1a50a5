"""Rotations: unit quaternions `quat_wxyz` and matrices, vectorised over leading axes.

Convention: `quat_EB` and `R_EB` take B components to E components, `v_E = R_EB @ v_B`. Quaternions are Hamilton's,
scalar first. Readers convert to this order; nothing inside uses another.

From `MANY` rows on the work is done in one compiled pass (`_..._rows`, at the end) where numpy makes several arrays of
each. Every sum is taken in the same order, so that results are equal but for the last digit of an arctangent.
"""

import numpy as np
from numba import njit

from wrenchgap.flight import row_kernels
from wrenchgap.flight.flight import Array

MANY = 4096
"""Rows below which a handful of numpy calls is soon done."""


def _many(*arrays: Array) -> tuple[Array, ...] | None:
    """Rows (N, K) side by side in memory, where one compiled pass over them pays; else None."""
    plain = all(type(a) is np.ndarray and a.ndim == 2 and a.dtype == float for a in arrays)
    if not plain or min(map(len, arrays)) < MANY or len({len(a) for a in arrays}) > 1:
        return None
    return tuple(np.ascontiguousarray(a) for a in arrays)


def normalise(quat_wxyz: Array) -> Array:
    """Unit quaternion(s), shape (..., 4); the sign is kept."""
    if _many(quat_wxyz):
        return np.asarray(quat_wxyz / row_kernels.lengths(quat_wxyz)[:, None])
    return np.asanyarray(quat_wxyz / np.linalg.norm(quat_wxyz, axis=-1, keepdims=True))


def continuous(quat_wxyz: Array) -> Array:
    """The same rotations, shape (N, 4), with signs chosen so that neighbours never jump to the antipode."""
    if rows := _many(quat_wxyz):
        return np.asarray(_continuous_rows(*rows))
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
    angle = np.linalg.norm(rotation_vector, axis=-1, keepdims=True)
    half = 0.5 * angle
    sinc = 0.5 * np.sinc(half / np.pi)  # sin(half) / angle, finite at zero
    return np.concatenate((np.cos(half), sinc * rotation_vector), axis=-1)


def log(quat_wxyz: Array) -> Array:
    """Rotation vector [rad] of unit quaternion(s), shape (..., 4) to (..., 3); norm at most pi."""
    if rows := _many(quat_wxyz):
        return np.asarray(_log_rows(*rows))
    q = np.where(quat_wxyz[..., :1] < 0, -quat_wxyz, quat_wxyz)
    norm = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(norm, q[..., :1])
    safe = np.where(norm > 1e-12, norm, 1.0)
    return np.asanyarray(np.where(norm > 1e-12, angle / safe, 2.0) * q[..., 1:])


def rotation_between(before_wxyz: Array, after_wxyz: Array) -> Array:
    """Rotation vector(s) [rad] from one attitude to another, log(p^-1 q), shapes (..., 4) to (..., 3)."""
    if rows := _many(before_wxyz, after_wxyz):
        return np.asarray(_turned_rows(*rows))
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


def rotate(quat_wxyz: Array, vector: Array) -> Array:
    """v_E = R_EB v_B for quat_EB, shapes (..., 4) and (..., 3)."""
    if rows := _many(quat_wxyz, vector):
        return np.asarray(_rotate_rows(rows[0], rows[1], 1.0))
    w, u = quat_wxyz[..., :1], quat_wxyz[..., 1:]
    t = 2.0 * np.cross(u, vector)
    return np.asanyarray(vector + w * t + np.cross(u, t))


def rotate_inverse(quat_wxyz: Array, vector: Array) -> Array:
    """v_B = R_EB^T v_E for quat_EB, shapes (..., 4) and (..., 3)."""
    if rows := _many(quat_wxyz, vector):
        return np.asarray(_rotate_rows(rows[0], rows[1], -1.0))
    return rotate(conjugate(quat_wxyz), vector)


def interpolate(time: Array, knots: Array, quat_wxyz: Array) -> Array:
    """Constant-rate (slerp) interpolation of attitudes at `knots` (K,), quat (K, 4), to `time` (N,); of one, it."""
    if len(knots) == 1:
        return np.tile(quat_wxyz, (len(time), 1))
    if len(time) >= MANY and len(knots) > 1 and (rows := _many(quat_wxyz)):
        return np.asarray(_interpolate_rows(np.ascontiguousarray(time), np.ascontiguousarray(knots), *rows))
    index = np.clip(np.searchsorted(knots, time, side="right") - 1, 0, len(knots) - 2)
    fraction = np.clip((time - knots[index]) / (knots[index + 1] - knots[index]), 0.0, 1.0)
    start = quat_wxyz[index]
    return multiply(start, exp(fraction[:, None] * rotation_between(start, quat_wxyz[index + 1])))


def hat(vector: Array) -> Array:
    """Cross-product matrix, hat(a) @ b = a x b, shape (..., 3) to (..., 3, 3)."""
    x, y, z = np.moveaxis(vector, -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack(row, axis=-1) for row in ((o, -z, y), (z, o, -x), (-y, x, o))], axis=-2)


def vee(S: Array) -> Array:
    """Inverse of `hat`; takes the skew part, shape (..., 3, 3) to (..., 3)."""
    skew = S[..., 2, 1] - S[..., 1, 2], S[..., 0, 2] - S[..., 2, 0], S[..., 1, 0] - S[..., 0, 1]
    return np.asarray(0.5 * np.stack(skew, axis=-1))


def tilt_angle(quat_wxyz: Array) -> Array:
    """Angle [rad] between body z and inertial z, shape (..., 4) to (...)."""
    return np.arccos(np.clip(matrix(quat_wxyz)[..., 2, 2], -1.0, 1.0))


@njit(cache=True, nogil=True)
def _continuous_rows(quat: Array) -> Array:
    """As `so3.continuous`: (N, 4) to (N, 4)."""
    out = np.empty_like(quat)
    sign = 1.0
    for i in range(len(quat)):
        if i > 0:
            along = quat[i, 0] * quat[i - 1, 0] + quat[i, 1] * quat[i - 1, 1]
            along = along + quat[i, 2] * quat[i - 1, 2] + quat[i, 3] * quat[i - 1, 3]
            if along < 0.0:
                sign = -sign
        for k in range(4):
            out[i, k] = quat[i, k] * sign
    return out


@njit(cache=True, nogil=True)
def _rotate_rows(quat: Array, vector: Array, inverse: float) -> Array:
    """As `so3.rotate` for `inverse` 1, `so3.rotate_inverse` for -1: (N, 4) and (N, 3) to (N, 3)."""
    out = np.empty((len(vector), 3))
    for i in range(len(vector)):
        w, a, b, c = quat[i, 0], inverse * quat[i, 1], inverse * quat[i, 2], inverse * quat[i, 3]
        x, y, z = vector[i, 0], vector[i, 1], vector[i, 2]
        s, t, u = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
        out[i, 0] = x + w * s + (b * u - c * t)
        out[i, 1] = y + w * t + (c * s - a * u)
        out[i, 2] = z + w * u + (a * t - b * s)
    return out


@njit(cache=True, nogil=True)
def _log(w: float, x: float, y: float, z: float, out: Array) -> None:
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    norm = np.sqrt(x * x + y * y + z * z)
    factor = 2.0 * np.arctan2(norm, w) / norm if norm > 1e-12 else 2.0
    out[0], out[1], out[2] = factor * x, factor * y, factor * z


@njit(cache=True, nogil=True)
def _log_rows(quat: Array) -> Array:
    """As `so3.log`: (N, 4) to (N, 3)."""
    out = np.empty((len(quat), 3))
    for i in range(len(quat)):
        _log(quat[i, 0], quat[i, 1], quat[i, 2], quat[i, 3], out[i])
    return out


@njit(cache=True, nogil=True)
def _relative(p: Array, q: Array, out: Array) -> None:
    """log(p^-1 q)."""
    a, b, c, d = p[0], -p[1], -p[2], -p[3]
    w, x, y, z = q[0], q[1], q[2], q[3]
    _log(
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
        out,
    )


@njit(cache=True, nogil=True)
def _interpolate_rows(time: Array, knots: Array, quat: Array) -> Array:
    """As `so3.interpolate`: (N,), (K,) increasing, (K, 4) to (N, 4)."""
    out, step, j, last = np.empty((len(time), 4)), np.empty(3), 0, len(knots) - 2
    for i in range(len(time)):
        t = time[i]
        if j > 0 and t < knots[j]:
            j = max(np.searchsorted(knots, t, side="right") - 1, 0)
        while j < last and knots[j + 1] <= t:
            j += 1
        share = min(max((t - knots[j]) / (knots[j + 1] - knots[j]), 0.0), 1.0)
        _relative(quat[j], quat[j + 1], step)
        a, b, c = share * step[0], share * step[1], share * step[2]
        half = 0.5 * np.sqrt(a * a + b * b + c * c)
        scale = 0.5 * np.sin(half) / half if half > 0.0 else 0.5
        w, x, y, z = np.cos(half), scale * a, scale * b, scale * c
        p, q, r, s = quat[j, 0], quat[j, 1], quat[j, 2], quat[j, 3]
        out[i, 0] = p * w - q * x - r * y - s * z
        out[i, 1] = p * x + q * w + r * z - s * y
        out[i, 2] = p * y - q * z + r * w + s * x
        out[i, 3] = p * z + q * y - r * x + s * w
    return out


@njit(cache=True, nogil=True)
def _turned_rows(before: Array, after: Array) -> Array:
    """As `rotation_between`, log(p^-1 q) of the rows p of `before` and q of `after`: (N, 4) and (N, 4) to (N, 3)."""
    out = np.empty((len(before), 3))
    for i in range(len(before)):
        _relative(before[i], after[i], out[i])
    return out
