"""Rotors that blow at parts of the airframe."""

import numpy as np

from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, ThrustEffect, Vehicle, tilting_arms
from wrenchgap.plant.state import Posture

_PLACES = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
"""Midpoints of five equal parts of a boom, as fractions of its length, at which the wake is looked at."""


class DownwashBlockage(ThrustEffect):
    """A rotor whose wake blows at the booms of other arms (hull included: booms begin at O) loses thrust.

        T_i <- T_i (1 - k / R int exp(-(rho_i / R)^2) ds)       along the other booms, where they are downstream

    rho_i is the distance from the axis of the rotor's wake, which leaves along -n_i; R the rotor's radius. A boom of
    width w in a far wake of twice the induced velocity, T = 2 rho pi R^2 v_i^2, feels C_D w / (pi R^2) of T per length,
    so k = C_D w / (pi R), about 0.07 for 2 cm. Source: momentum theory, Leishman, "Principles of Helicopter
    Aerodynamics", 2006, ch. 2; the Gaussian profile is our assumption.
    """

    name = "downwash_blockage"
    needs_tilt = True
    accuracy = 0.1
    excited_by = "sustained high tilt, at which a wake sweeps over a neighbour's boom"
    confused_with = ("rotor_interference", "thrust_scale", "com_offset")

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """k, the share of thrust lost to one rotor radius of boom on the axis of the wake."""
        tilting_arms(vehicle, self.name)
        return (Parameter("loss", "1", 0.0, 1.0, 0.1),)

    def apply(self, actuation: Actuation, theta: Array, context: Context) -> Array:
        """Thrusts (N, R), reduced where a wake meets the airframe."""
        if theta[0] == 0.0:
            return actuation.thrust
        _, rotors = context.vehicle.geometry()
        share = actuation.posture.cached(self.name, lambda: _share(actuation.posture))
        return np.asarray(actuation.thrust * np.maximum(1.0 - theta[0] * share[:, rotors.arm], 0.0))


def _share(posture: Posture) -> Array:
    """(N, A): the integral along the booms over R, for the rotors of each arm."""
    arms, rotors = posture.vehicle.geometry()
    share = np.zeros(posture.tilt.shape, like=posture.tilt)
    for i in range(len(arms)):
        on = np.flatnonzero(rotors.arm == i)
        if on.size == 0:
            continue
        others = np.delete(arms.position_B, i, axis=0)
        points = (_PLACES[:, None, None] * others).reshape(-1, 3)
        length = np.tile(np.linalg.norm(others, axis=1) / len(_PLACES), len(_PLACES))
        apart = points - arms.position_B[i]
        along = -(posture.arm_normal_B[:, i] @ apart.T)
        squared = (apart**2).sum(axis=1) - along**2
        radius = rotors.radius[on[0]]
        met = np.where(along > 0.01 * radius, np.exp(-squared / radius**2), 0.0)
        share[:, i] = met @ length / radius
    return share
