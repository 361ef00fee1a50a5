"""Rotors that blow at parts of the airframe."""

from __future__ import annotations

import numpy as np

from flight.errors import ModelError
from plant.effects.effect import Actuation, Array, Context, Parameter, ThrustEffect, Vehicle

_PLACES = np.array([0.0, 0.2, 0.4, 0.6, 0.8])
"""Points along each boom, as fractions of its length, at which the wake is looked at."""


class DownwashBlockage(ThrustEffect):
    """A rotor whose wake meets the hull or another arm's boom loses thrust.

        T_i <- T_i (1 - k mean_s exp(-(rho_is / R)^2))      s on hull and other booms, downstream

    rho_is is the distance of point s from the axis of the rotor's wake, which leaves along -n_i; R one rotor radius.
    Source: form of reference effects.md, "downwash blockage by the body"; a Gaussian jet (momentum theory's far wake).
    """

    name = "downwash_blockage"
    excited_by = "sustained high tilt, at which a wake sweeps over a neighbour's boom"
    confused_with = ("rotor_interference", "thrust_scale", "com_offset")

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Loss when everything is in the wake's axis."""
        arms, _ = vehicle.geometry()
        if not arms.tilts.any():
            raise ModelError(f"{vehicle.name}: effect downwash_blockage needs arms that tilt, and none does")
        return (Parameter("loss", "1", 0.0, 3.0, 0.5),)

    def apply(self, actuation: Actuation, theta: Array, context: Context) -> Array:
        """Thrusts (N, R), reduced where a wake meets the airframe."""
        if theta[0] == 0.0:
            return actuation.thrust
        arms, rotors = context.vehicle.geometry()
        share = np.zeros((len(actuation.thrust), len(arms)))
        for i in range(len(arms)):
            on = np.flatnonzero(rotors.arm == i)
            if on.size == 0:
                continue
            others = np.delete(arms.position_B, i, axis=0)
            points = (_PLACES[:, None, None] * others).reshape(-1, 3)
            apart = points - arms.position_B[i]
            along = -(actuation.arm_normal_B[:, i] @ apart.T)
            squared = (apart**2).sum(axis=1) - along**2
            radius = rotors.radius[on[0]]
            met = np.where(along > 0.01 * radius, np.exp(-squared / radius**2), 0.0)
            share[:, i] = met.mean(axis=1)
        return np.asarray(actuation.thrust * np.maximum(1.0 - theta[0] * share[:, rotors.arm], 0.0))
