"""The allocation of a vehicle as flown, as a problem with limits: what groups of rotors make, and how much they have.

A group is what is asked for as one: a rotor, or all rotors of an arm that tilts (`plant.allocation`). With the thrust
x_g along its direction at rest and y_g across it, about the centre of mass as flown,

    W = offset + sum_g (wrench_g,0 x_g + wrench_g,1 y_g),    low_g <= x_g <= high_g, y_g = 0     arms that do not tilt
                                                             hypot(x_g, y_g) <= high_g           arms that do

linear about hover (`plant.effectiveness`); `offset` is what curved thrust laws and constant wrenches leave. Limits are
those of the rotors' speeds, in thrusts of the nominal rotor, c_f Omega^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.allocation import allocation_of
from wrenchgap.plant.effectiveness import linear_matrix, makeable, spread
from wrenchgap.plant.model import Model
from wrenchgap.plant.targets.quantities import acting_effects, hover_speeds, still_wrench
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import WrenchModel, about_com


@dataclass(frozen=True, eq=False)
class AllocationProblem:
    """Of G groups and R rotors; see the module.

    Attributes
    ----------
    wrench : (6, G, 2)
        Force and torque per newton along and across [1, m]; zero across where an arm does not tilt.
    offset, hover : (6,)
        Wrench without thrusts by the linear law, and the one that carries the weight [N, Nm].
    directions : (6, K)
        Unit directions in which the vehicle nominally makes a wrench: what of a demand is looked at.
    low, high : (G,)
        Thrusts that all rotors of a group can share [N].
    arm : (G,)
        Of each group; `tilts` (G,) says whether it does.
    group, share : (R,)
        Group of each rotor, and its share of the group's thrust.
    """

    vehicle: Vehicle
    wrench: Array
    offset: Array
    hover: Array
    directions: Array
    low: Array
    high: Array
    arm: NDArray[np.int64]
    tilts: NDArray[np.bool_]
    group: NDArray[np.int64]
    share: Array


def allocation_problem(model: Model, *, nominal: bool = False) -> AllocationProblem:
    """The problem of a model with its effects, or of its `nominal` vehicle.

    Effects of the air, of the battery and at a limit are left out. Raises ModelError for a model without rotors.
    """
    vehicle = model.vehicle
    arms, rotors = vehicle.geometry()
    effects = [] if nominal else acting_effects(model)
    acting, groups = WrenchModel(vehicle, tuple(effects)), allocation_of(vehicle).groups
    linear, speeds = linear_matrix(model, effects), hover_speeds(vehicle)
    arm = np.array([a for a, _ in groups], dtype=np.int64)
    tilts, count = arms.tilts[arm], len(groups)
    wrench = np.zeros((6, count, 2))
    wrench[:, :, 0], wrench[:, tilts, 1] = linear[:, :count], linear[:, count:]
    thrust = rotors.c_f * speeds**2
    resting = np.array([thrust[members].sum() for _, members in groups])
    made = about_com(acting.body, still_wrench(acting, speeds[None]))[0]
    share = spread(vehicle)[: len(rotors), :count]
    group, of = share.argmax(axis=1), share.max(axis=1)
    full, idle = rotors.c_f * rotors.speed_max**2 / of, rotors.c_f * rotors.speed_min**2 / of
    high = np.array([full[members].min() for _, members in groups])
    low = np.array([idle[members].max() for _, members in groups])
    if not (low < high).all():
        g = int(np.flatnonzero(low >= high)[0])
        raise ModelError(
            f"{vehicle.name}: rotors of {vehicle.arm_name(int(arm[g]))} have no thrust that all of them can share; "
            "check speed_min and speed_max"
        )
    hover = np.array([0.0, 0.0, acting.body.mass * GRAVITY, 0.0, 0.0, 0.0])
    return AllocationProblem(
        vehicle,
        wrench,
        made - linear[:, :count] @ resting,
        hover,
        makeable(linear_matrix(model, [])),
        low,
        high,
        arm,
        tilts,
        group.astype(np.int64),
        of,
    )
