"""From the frames of aviation to ours: forward-right-down to forward-left-up, north-east-down to east-north-up.

With R from FRD to NED, our R_EB = P R D, where P = [[0, 1, 0], [1, 0, 0], [0, 0, -1]] swaps north and east and turns
down to up, and D = diag(1, -1, -1) turns right to left and down to up. Both are half turns: D about x, P about the
axis between x and y. So are their quaternions, (0, 1, 0, 0) and (0, 1, 1, 0) / sqrt(2), and the product is closed:

    q_EB = (w + z, x + y, x - y, w - z) / sqrt(2)
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array


def flu(vectors_frd: NDArray[Any]) -> Array:
    """Vectors (N, 3) or (3,) in forward-right-down as forward-left-up."""
    return np.asarray(vectors_frd, dtype=float) * [1.0, -1.0, -1.0]


def enu(vectors_ned: NDArray[Any]) -> Array:
    """Vectors (N, 3) or (3,) in north-east-down as east-north-up."""
    return np.asarray(np.asarray(vectors_ned, dtype=float)[..., [1, 0, 2]] * [1.0, 1.0, -1.0])


def quat_flu_to_enu(quat_frd_to_ned: NDArray[Any]) -> Array:
    """Quaternions (N, 4), scalar first, of FRD to NED as those of FLU to ENU."""
    w, x, y, z = np.moveaxis(np.asarray(quat_frd_to_ned, dtype=float), -1, 0)
    return np.asarray(np.stack((w + z, x + y, x - y, w - z), axis=-1) / np.sqrt(2.0))


def quat_of_euler(roll: NDArray[Any], pitch: NDArray[Any], yaw: NDArray[Any]) -> Array:
    """Quaternions (N, 4) of FRD to NED from roll, pitch and yaw [rad], turned in the order yaw, pitch, roll."""
    halves = (0.5 * np.asarray(angle, dtype=float) for angle in (roll, pitch, yaw))
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(half), np.sin(half)) for half in halves)
    w, x = cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy
    return np.stack((w, x, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy), axis=-1)
