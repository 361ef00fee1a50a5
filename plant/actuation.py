"""The actuation model h(u): from tilt angles and rotor speeds to the wrench about the body origin.

    T = c_f Omega |Omega|
    F = sum_r T_r n_r
    M = sum_r (p_r x n_r - spin_r kappa_r n_r) T_r

Source: reference vehicle.md; Bodie et al., "An omnidirectional aerial manipulation platform", RSS 2019.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plant.state import Actuation, Commands
from plant.vehicle import Arms, Vehicle

Array = NDArray[np.float64]


def lateral_B(arms: Arms) -> Array:
    """Where thrust goes as an arm tilts: a x n_0, (A, 3)."""
    return np.cross(arms.axis_B, arms.normal_B)


def arm_normals(arms: Arms, tilt: Array) -> Array:
    """Unit thrust directions n(alpha) = cos(alpha) n_0 + sin(alpha) a x n_0, for tilt (N, A) [rad]: (N, A, 3)."""
    return np.asarray(np.cos(tilt)[..., None] * arms.normal_B + np.sin(tilt)[..., None] * lateral_B(arms))


def actuation(vehicle: Vehicle, commands: Commands) -> Actuation:
    """What the rotors nominally do at these commands."""
    arms, rotors = vehicle.geometry()
    assert commands.tilt is not None
    assert commands.rotor_speed is not None
    normal = arm_normals(arms, commands.tilt)[:, rotors.arm]
    hub = arms.position_B[rotors.arm] + rotors.offset[:, None] * normal
    speed = commands.rotor_speed
    return Actuation(commands.tilt, speed, normal, hub, rotors.c_f * speed * np.abs(speed))


def rotor_wrench(vehicle: Vehicle, actuation: Actuation) -> Array:
    """Wrench (N, 6) about O, in B, that these thrusts make."""
    _, rotors = vehicle.geometry()
    n, p = actuation.normal_B, actuation.hub_B
    force = np.einsum("nr,nri->ni", actuation.thrust, n)
    drag = np.einsum("nr,nri->ni", -rotors.spin * rotors.kappa * actuation.thrust, n)
    thrust_B = actuation.thrust[..., None] * n
    px, py, pz = p[..., 0], p[..., 1], p[..., 2]
    fx, fy, fz = thrust_B[..., 0], thrust_B[..., 1], thrust_B[..., 2]
    lever = np.stack(
        ((py * fz - pz * fy).sum(-1), (pz * fx - px * fz).sum(-1), (px * fy - py * fx).sum(-1)),
        axis=-1,
    )
    return np.concatenate((force, lever + drag), axis=-1)


def nominal_wrench(vehicle: Vehicle, commands: Commands) -> Array:
    """h(u), (N, 6) about O: what the commands make if the model is right."""
    return rotor_wrench(vehicle, actuation(vehicle, commands))
