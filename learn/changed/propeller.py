"""A damaged propeller loses drag torque too, and more of it than thrust.

Of propellers alike but for their diameter D, T = C_T rho n^2 D^4 and Q = C_Q rho n^2 D^5: a cut tip takes more of Q
than of T. A motor at a given voltage then speeds up, which gives back the same share of both: at
V = K Omega + (R / K) Q and s = (R / K) Q / (K Omega), a diameter smaller by e changes T by -4 e + 10 e s / (1 + 2 s)
and Q by e less. The ratio of the two losses is 1.25 with a governed speed (s = 0), 1.5 at s = 0.3 and 2.5 at s = 1, a
small brushed motor of which half the power is heat; of surfaces that only got rough or dirty it may be anything near
one. A change of a rotor is therefore any sum, both losses, of

    thrust and drag torque by the same share
    thrust by a share, drag torque by `MOST` times that

Source: McCormick, "Aerodynamics, Aeronautics, and Flight Mechanics", 2nd ed., ch. 6 (coefficients of propellers), and
the equation of a direct-current motor.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import Vehicle

NAME = "rotor_thrust"
MOST = 2.5
"""Largest ratio of the share of drag torque that a damaged propeller loses to that of thrust."""


def without_drag_torque(model: Model) -> Model:
    """The model with rotors that only lift: what it makes of the same commands lacks their drag torques."""
    _, rotors = model.vehicle.geometry()
    return replace(model, vehicle=replace(model.vehicle, rotors=replace(rotors, kappa=np.zeros_like(rotors.kappa))))


def damaged(line: Column, torque: Array) -> Column:
    """The change of a rotor's thrust (R parameters) with the second kind of loss beside it (2 R)."""

    def twice(values: Array) -> Array:
        return np.concatenate((values, values))

    return replace(
        line,
        jacobian=np.concatenate((line.jacobian, line.jacobian + (MOST - 1.0) * torque), axis=2),
        origin=twice(line.origin),
        theta=twice(line.theta),
        low=twice(line.low),
        high=twice(line.high),
        scale=twice(line.scale),
        sparse=np.concatenate((line.sparse, line.sparse)),
    )


def read(vehicle: Vehicle, name: str, size: int) -> Array:
    """From the `size` unknowns of a change to the parameters (P, size) of its effect; both losses take thrust."""
    count = len(find(name).parameters(vehicle))
    return np.tile(np.eye(count), (1, size // count))
