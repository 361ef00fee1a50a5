"""The lower rotor of a coaxial pair works in the upper one's wake."""

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
    family = "coaxial_loss"
    form = "a constant share of the lower rotor's thrust"
    needs_coaxial = True
    excited_by = "unequal speeds within a pair"
    confused_with = ("thrust_scale", "drag_torque", "coaxial_loss_of_wake")

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """The loss; only for a vehicle that has coaxial pairs."""
        _, rotors = vehicle.geometry()
        if not lower(rotors).any():
            raise ModelError(f"{vehicle.name}: effect {self.name} needs two rotors on one arm, and no arm has them")
        return (Parameter("eta", "1", 0.0, 0.5, 0.1),)

    def apply(self, actuation: Actuation, theta: Array, context: Context) -> Array:
        """Thrusts (N, R), the lower ones reduced."""
        _, rotors = context.vehicle.geometry()
        return np.asarray(actuation.thrust * np.where(lower(rotors), 1.0 - theta[0], 1.0))


def lower(rotors: Rotors) -> NDArray[np.bool_]:
    """Which rotors have another one above them on the same arm, (R,)."""
    return above(tuple(int(a) for a in rotors.arm), tuple(float(o) for o in rotors.offset)) >= 0


@lru_cache(maxsize=16)
def above(arm: tuple[int, ...], offset: tuple[float, ...]) -> NDArray[np.intp]:
    """For every rotor the one next above it on its arm (R,), -1 where there is none."""
    out = np.full(len(arm), -1)
    for i, (own, height) in enumerate(zip(arm, offset, strict=True)):
        higher = [(p, j) for j, (other, p) in enumerate(zip(arm, offset, strict=True)) if other == own and p > height]
        out[i] = min(higher, default=(0.0, -1))[1]
    return out
