"""The lower rotor of a coaxial pair works in the upper one's wake."""

from functools import lru_cache

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Indices
from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, ThrustEffect
from wrenchgap.plant.vehicle import Vehicle


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
        if not (above(vehicle) >= 0).any():
            raise ModelError(f"{vehicle.name}: effect {self.name} needs two rotors on one arm, and no arm has them")
        return (Parameter("eta", "1", 0.0, 0.5, 0.1),)

    def apply(self, actuation: Actuation, theta: Array, context: Context) -> Array:
        """Thrusts (N, R), the lower ones reduced."""
        return np.asarray(actuation.thrust * np.where(above(context.vehicle) >= 0, 1.0 - theta[0], 1.0))


@lru_cache(maxsize=16)
def above(vehicle: Vehicle) -> Indices:
    """For every rotor the one next above it on its arm (R,), -1 where there is none."""
    _, rotors = vehicle.geometry()
    places = list(zip(rotors.arm, rotors.offset, strict=True))
    higher = [[(p, j) for j, (other, p) in enumerate(places) if other == own and p > height] for own, height in places]
    return np.array([min(rotors_above, default=(0.0, -1))[1] for rotors_above in higher])
