"""`WrenchModel.report` in one compiled pass over the samples: a search asks for it thousands of times.

`plant.wrench_model.forward_dynamics` and `measured_wrench` are the plain forms, which a test compares with
(docs/decisions/0026-compiled-kernels.md).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from wrenchgap.flight.flight import Array
from wrenchgap.plant.effects.effect import SensorEffect
from wrenchgap.plant.state import State
from wrenchgap.plant.vehicle import Body
from wrenchgap.plant.wrench_model import WrenchModel


def report(model: WrenchModel, wrench_B: Array, state: State, body: Body | None = None) -> Array:
    """The measured wrench (N, 6) that a model predicts when the wrench about O is `wrench_B` (N, 6):
    `WrenchModel.report` but for rounding. Models with effects on sensors go that way.
    """  # noqa: D205
    if any(isinstance(item.effect, SensorEffect) for item in model.effects):
        return model.report(wrench_B, state, body)
    numbers = model.dynamics
    if body is not None:
        numbers = np.concatenate((numbers[:22], [body.mass], body.com_B, body.inertia.ravel()))
    return np.asarray(_report(np.ascontiguousarray(wrench_B), np.ascontiguousarray(state.omega_B), numbers))


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
def _report(wrench: Array, omega: Array, numbers: Array) -> Array:
    """`measured_wrench` of the believed body, of the motion that `forward_dynamics` gives the true one; of both mass,
    centre of mass and inertia are in `numbers`, and the inverse of the true inertia between them.
    """  # noqa: D205
    mass, com, inertia, inverse = numbers[0], numbers[1:4], numbers[4:13].reshape(3, 3), numbers[13:22].reshape(3, 3)
    believed_mass, believed_com, believed_inertia = numbers[22], numbers[23:26], numbers[26:35].reshape(3, 3)
    out = np.empty((len(wrench), 6))
    c, d = (com[0], com[1], com[2]), (believed_com[0], believed_com[1], believed_com[2])
    for k in range(len(wrench)):
        force = (wrench[k, 0], wrench[k, 1], wrench[k, 2])
        w = (omega[k, 0], omega[k, 1], omega[k, 2])
        arm = _cross(c, force)
        gyro = _cross(w, _times(inertia, w))
        left = (wrench[k, 3] - arm[0] - gyro[0], wrench[k, 4] - arm[1] - gyro[1], wrench[k, 5] - arm[2] - gyro[2])
        turned = _times(inverse, left)
        euler, centripetal = _cross(turned, c), _cross(w, _cross(w, c))
        euler_d, centripetal_d = _cross(turned, d), _cross(w, _cross(w, d))
        moment, gyro_d = _times(believed_inertia, turned), _cross(w, _times(believed_inertia, w))
        for a in range(3):
            felt = force[a] / mass - euler[a] - centripetal[a]
            out[k, a] = believed_mass * (felt + euler_d[a] + centripetal_d[a])
            out[k, 3 + a] = moment[a] + gyro_d[a]
    return out
