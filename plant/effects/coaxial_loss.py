"""The lower rotor of a coaxial pair works in the upper one's wake."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import ModelError
from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, ThrustEffect
from wrenchgap.plant.vehicle import Rotors, Vehicle


class CoaxialLoss(ThrustEffect):
    """The lower rotor loses a share eta of its thrust: T_l = (1 - eta) c_f Omega_l^2.

    Constant eta; at equal pair speeds it is an exact alias of a global thrust scale, save for the drag torques.
    Source: momentum theory of coaxial rotors, Leishman, "Principles of Helicopter Aerodynamics", 2nd ed., 2.15.
    """

    name = "coaxial_loss"
    needs_coaxial = True
    excited_by = "unequal speeds within a pair"
    confused_with = ("thrust_scale", "drag_torque")

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """The loss; only for a vehicle that has coaxial pairs."""
        _, rotors = vehicle.geometry()
        if not _lower(rotors).any():
            raise ModelError(f"{vehicle.name}: effect coaxial_loss needs two rotors on one arm, and no arm has them")
        return (Parameter("eta", "1", 0.0, 0.5, 0.1),)

    def apply(self, actuation: Actuation, theta: Array, context: Context) -> Array:
        """Thrusts (N, R), the lower ones reduced."""
        _, rotors = context.vehicle.geometry()
        return np.asarray(actuation.thrust * np.where(_lower(rotors), 1.0 - theta[0], 1.0))


def _lower(rotors: Rotors) -> NDArray[np.bool_]:
    """Which rotors have another one above them on the same arm, (R,)."""
    return _lower_of(tuple(int(a) for a in rotors.arm), tuple(float(o) for o in rotors.offset))


@lru_cache(maxsize=16)
def _lower_of(arm: tuple[int, ...], offset: tuple[float, ...]) -> NDArray[np.bool_]:
    pairs = list(zip(arm, offset, strict=True))
    return np.array([any(a == b and o < p for b, p in pairs) for a, o in pairs])
