"""Rotors in the wake of the neighbouring arms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flight.errors import ModelError
from plant.effects.effect import Actuation, Array, Context, Parameter, ThrustEffect
from plant.vehicle import GRAVITY, Vehicle


class RotorInterference(ThrustEffect):
    """A rotor that sits in the wake of another arm's rotors loses thrust.

        T_i <- T_i (1 - sum_j k sqrt(T_j / T_h) exp(-(rho_ij / R_w)^2)),    j over the other arms, i downstream of j

    T_j is the summed thrust of arm j and T_h its share of the hover thrust; rho_ij is the distance of hub i from the
    axis of j's wake, which leaves arm j along -n_j. R_w is given in rotor radii.
    Source: reference effects.md, "wake of neighbouring arms" (sqrt(T) is the induced velocity of momentum theory).
    """

    name = "rotor_interference"
    excited_by = "sustained high tilt in several azimuths; sets in above about 60 deg"
    confused_with = ("com_offset", "rotor_thrust", "downwash_blockage")

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Loss k on the axis, and wake width R_w in rotor radii."""
        arms, _ = vehicle.geometry()
        if not arms.tilts.any():
            raise ModelError(f"{vehicle.name}: effect rotor_interference needs arms that tilt, and none does")
        return (
            Parameter("loss", "1", 0.0, 0.6, 0.2, start=0.1),
            Parameter("width", "rotor radii", 0.3, 3.0, 0.8, start=1.2),
        )

    def apply(self, actuation: Actuation, theta: Array, context: Context) -> Array:
        """Thrusts (N, R), reduced where a hub lies in a wake."""
        loss, width = float(theta[0]), float(theta[1])
        if loss == 0.0 or width <= 0.0:
            return actuation.thrust
        arms, rotors = context.vehicle.geometry()
        per_arm = actuation.thrust @ (rotors.arm[:, None] == np.arange(len(arms)))
        strength = np.sqrt(np.maximum(per_arm, 0.0) * len(arms) / (context.vehicle.body.mass * GRAVITY))
        lost = np.zeros_like(actuation.thrust)
        for j in range(len(arms)):
            source = np.flatnonzero(rotors.arm == j)
            if source.size == 0:
                continue
            others = np.flatnonzero(rotors.arm != j)
            along, rho_squared = _place_in_wake(actuation, j, others)
            reach = width * rotors.radius[source[0]]
            inside = (along > 0) & (rho_squared < (3.0 * reach) ** 2)
            share = np.zeros_like(along)
            share[inside] = np.exp(-rho_squared[inside] / reach**2)
            lost[:, others] += loss * strength[:, j, None] * share
        return np.asarray(actuation.thrust * np.maximum(1.0 - lost, 0.0))


def _place_in_wake(actuation: Actuation, j: int, hubs: NDArray[np.intp]) -> tuple[Array, Array]:
    """How far downstream of arm j (N, H) and how far squared from its wake's axis (N, H) the hubs sit.

    With d = p_i + h_i n_i - p_j from arm j to a hub: downstream -d.n_j, distance squared |d|^2 - (d.n_j)^2.
    """
    arms, rotors = actuation.vehicle.geometry()
    on, h = rotors.arm[hubs], rotors.offset[hubs]
    apart = arms.position_B[on] - arms.position_B[j]
    n_j, n = actuation.arm_normal_B[:, j], actuation.arm_normal_B
    cosines = np.matmul(n, n_j[:, :, None])[..., 0]
    along = -(n_j @ apart.T + h * cosines[:, on])
    lever = np.einsum("nai,ai->na", n, arms.position_B) - n @ arms.position_B[j]
    squared = (apart**2).sum(axis=1) + h**2 + 2.0 * h * lever[:, on]
    return along, squared - along**2
