"""Rotors in the wake of the neighbouring arms."""

from functools import lru_cache

import numpy as np

from wrenchgap.flight.flight import Indices
from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, ThrustEffect, tilting_arms
from wrenchgap.plant.state import Posture
from wrenchgap.plant.vehicle import GRAVITY, Vehicle


class RotorInterference(ThrustEffect):
    """A rotor that sits in the wake of another arm's rotors loses thrust.

        T_i <- T_i (1 - sum_j k sqrt(T_j / T_h) exp(-(rho_ij / R_w)^2)),    j over the other arms, i downstream of j

    T_j is the summed thrust of arm j and T_h its share of the hover thrust; rho_ij is the distance of hub i from the
    axis of j's wake, which leaves arm j along -n_j. R_w is given in rotor radii.
    Source: sqrt(T) is the induced velocity of momentum theory (Leishman, "Principles of Helicopter Aerodynamics", 2006,
    ch. 2); the Gaussian profile is our assumption.
    """

    name = "rotor_interference"
    needs_tilt = True
    accuracy = 0.1
    excited_by = "sustained high tilt in several azimuths; sets in above about 60 deg"
    confused_with = ("com_offset", "rotor_thrust", "downwash_blockage")

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Loss k on the axis, and wake width R_w in rotor radii."""
        tilting_arms(vehicle, self.name)
        return (
            Parameter("loss", "1", 0.0, 0.6, 0.2, start=0.1),
            Parameter("width", "rotor radii", 0.3, 3.0, 0.8, start=1.2, alone=False),
        )

    def apply(self, actuation: Actuation, theta: Array, context: Context) -> Array:
        """Thrusts (N, R), reduced where a hub lies in a wake."""
        loss, width = float(theta[0]), float(theta[1])
        if loss == 0.0 or width <= 0.0:
            return actuation.thrust
        arms, rotors = context.vehicle.geometry()
        per_arm = actuation.thrust @ (rotors.arm[:, None] == np.arange(len(arms)))
        strength = loss * np.sqrt(np.maximum(per_arm, 0.0) * len(arms) / (context.vehicle.body.mass * GRAVITY)).T
        apart = actuation.posture.cached(self.name, lambda: _apart(actuation.posture))
        sources, reach = _sources(context.vehicle)
        reach = width * reach[:, :, None]
        lost = np.empty(actuation.thrust.shape[::-1], like=actuation.thrust)
        for rows in _pieces(actuation.thrust):
            far = apart[:, :, rows] / -(reach**2)
            share = np.exp(far)
            share *= far > -9.0  # nothing beyond three times the width
            share *= strength[sources, rows]
            share.sum(axis=0, out=lost[:, rows])
        return np.asarray(actuation.thrust * np.maximum(1.0 - lost.T, 0.0))


def _pieces(rows: Array, most: int = 1024) -> list[slice]:
    """The rows in pieces, so that what is worked out for all pairs at once stays in the processor's cache."""
    return [slice(k, k + most) for k in range(0, len(rows), most)]


@lru_cache(maxsize=64)
def _sources(vehicle: Vehicle) -> tuple[Indices, Array]:
    """For every rotor the other arms that have rotors (S, R), and the radii of the rotors there (S, R) [m]."""
    arms, rotors = vehicle.geometry()
    carrying = np.array([j for j in range(len(arms)) if np.any(rotors.arm == j)])
    radius = np.array([rotors.radius[np.argmax(rotors.arm == j)] for j in range(len(arms))])
    sources = np.array([carrying[carrying != i] for i in rotors.arm]).reshape(len(rotors), -1).T
    return sources, radius[sources]


def _apart(posture: Posture) -> Array:
    """Squared distances (S, R, N) [m^2] of the hubs from the axes of the wakes of `_sources`; inf upstream of those.

    With d = p_i + h_i n_i - p_j from arm j to a hub: downstream -d.n_j, distance squared |d|^2 - (d.n_j)^2.
    """
    arms, rotors = posture.vehicle.geometry()
    j, _ = _sources(posture.vehicle)
    i = np.broadcast_to(rotors.arm, j.shape)
    h = rotors.offset[None, :, None]
    squared = ((arms.position_B[i] - arms.position_B[j]) ** 2).sum(axis=-1)[:, :, None] + h**2
    out = np.empty((*j.shape, len(posture.tilt)), like=posture.tilt)
    for rows in _pieces(posture.tilt):
        n = posture.arm_normal_B[rows].transpose(1, 2, 0).copy()
        heights = arms.position_B @ n  # (j, i, N): p_i . n_j
        heights -= np.einsum("jjn->jn", heights)[:, None]
        cosines = np.einsum("ikn,jkn->ijn", n, n)
        along = cosines[i, j]
        along *= -h
        along -= heights[j, i]
        apart = heights[i, j]
        apart *= -2.0 * h
        apart += squared
        apart -= along**2
        apart[along <= 0] = np.inf
        out[:, :, rows] = apart
    return out
