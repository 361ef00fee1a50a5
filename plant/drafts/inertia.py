"""Inertia of a multirotor of which only mass and geometry are known.

    J = SHARE m mean_r (|d_r|^2 I - d_r d_r^T),      d_r from the rotors' mean to hub r

as if that share of the mass sat at the rotors (motors, propellers, outer arms) and the rest at their mean. Measured
moments about the vertical that were published give SHARE = J_zz / (m mean d^2) of 0.51 (Crazyflie 2: Foerster, ETH
2015), 0.60 (3DR Iris) and 0.33 (Holybro X500, both PX4's Gazebo models), 0.58 (AscTec Hummingbird) and 0.42 (the
omnidirectional hexarotor, both RotorS): 0.49 on average with a standard deviation of 0.11.
"""

from __future__ import annotations

import numpy as np

from wrenchgap.flight.flight import Array

SHARE, UNCERTAINTY = 0.5, 0.3
"""Share of the mass at the rotors; relative standard deviation of what comes out."""
LEAST = 0.05
"""Smallest moment, relative to the largest: where all rotors are in one line, arms and hull still are not."""


def inertia_of_mass(mass: float, hubs_B: Array) -> Array:
    """Moments (3,) [kg m^2] about B's axes of a mass [kg] with rotors at `hubs_B` (R, 3) [m]."""
    away = hubs_B - hubs_B.mean(axis=0)
    square = (away**2).mean(axis=0)
    moments = SHARE * mass * np.array([square[1] + square[2], square[0] + square[2], square[0] + square[1]])
    return np.asarray(np.maximum(moments, LEAST * moments.max()))
