"""Rotors in the wake of the neighbouring arms."""

from __future__ import annotations

import numpy as np

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
        thrust = np.zeros((len(actuation.thrust), len(arms)))
        for arm, made in zip(rotors.arm, actuation.thrust.T, strict=True):
            thrust[:, arm] += made
        strength = loss * np.sqrt(np.maximum(thrust, 0.0) / (context.vehicle.body.mass * GRAVITY / len(arms)))
        factor = np.ones_like(actuation.thrust)
        for j in range(len(arms)):
            source = np.flatnonzero(rotors.arm == j)
            if source.size == 0:
                continue
            reach = width * rotors.radius[source[0]]
            others = np.flatnonzero(rotors.arm != j)
            n = actuation.arm_normal_B[:, j]
            d = actuation.hub_B[:, others] - arms.position_B[j]
            along = -np.matmul(d, n[:, :, None])[..., 0]
            rho_squared = (d * d).sum(axis=-1) - along**2
            factor[:, others] -= np.where(along > 0, strength[:, j, None] * np.exp(-rho_squared / reach**2), 0.0)
        return np.asarray(actuation.thrust * np.maximum(factor, 0.0))
