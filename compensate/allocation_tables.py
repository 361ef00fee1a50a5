"""What the corrected allocation works on: its constants, room to work in, what it remembers and what it answers.

As in `compensate.tables` every array says its shape. Sizes: WG_RANK K directions of wrenches that the vehicle makes,
WG_GROUPS G groups of rotors that are asked for as one, WG_ROTORS, WG_ARMS.
"""

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchgap.compensate.tables import Count, Number, Six
from wrenchgap.flight.flight import Array

Rank = Annotated[Array, "WG_RANK"]
Groups = Annotated[Array, "WG_GROUPS"]
Unknowns = Annotated[Array, "WG_GROUPS", 2]
Places = Annotated[NDArray[np.int64], "WG_GROUPS"]
PerGroup = Annotated[Array, "WG_RANK", "WG_GROUPS"]
Thrusts = Annotated[Array, "WG_ROTORS"]
Owners = Annotated[NDArray[np.int64], "WG_ROTORS"]
Tilts = Annotated[Array, "WG_ARMS"]


class AllocationTable(NamedTuple):
    """Constants, of unknowns u_g with |u_g| <= 1: thrust along = centre + half u_g0, across = half u_g1 [N].

    demand (K, 6), bias (6,)   b = demand (W - bias): what u has to make
    along, across (K, G)       b = sum_g along_g u_g0 + across_g u_g1; rows are orthonormal
    made_along, made_across (6, G), made_bias (6,)   W = made_bias + sum of these times the thrusts [N]
    hover (G, 2)               u of hover
    centre, half, low, high (G,)   thrusts of groups [N]; weak (G,) [N] below which an arm keeps its angle
    tilting, arm (G,)          whether the arm of a group tilts, and which it is
    tilt_min, tilt_max (A,)    [rad]
    owner, share (R,)          group of a rotor, its share of the thrust; least, most (R,) its limits [N]
    far (6,)                   demands are cut to this [N, Nm]
    rounds                     of the search for the largest margin; 0: pseudo-inverse
    calm                       largest |u_g| of the pseudo-inverse up to which it is taken as it is
    """

    demand: Annotated[Array, "WG_RANK", 6]
    bias: Six
    along: PerGroup
    across: PerGroup
    made_along: Annotated[Array, 6, "WG_GROUPS"]
    made_across: Annotated[Array, 6, "WG_GROUPS"]
    made_bias: Six
    hover: Unknowns
    centre: Groups
    half: Groups
    low: Groups
    high: Groups
    weak: Groups
    tilting: Places
    arm: Places
    tilt_min: Tilts
    tilt_max: Tilts
    owner: Owners
    share: Thrusts
    least: Thrusts
    most: Thrusts
    far: Six
    rounds: int
    calm: float


class AllocationRoom(NamedTuple):
    """Room to work in; nothing of it outlives a call."""

    b: Rank
    y: Rank
    factor: Annotated[Array, "WG_RANK", "WG_RANK"]
    weight: Groups
    free: Groups
    wanted: Six
    u: Unknowns
    best: Unknowns
    less: Unknowns
    whole: Unknowns


class AllocationMemory(NamedTuple):
    """What is remembered: the command of before, and what it made."""

    last_thrust: Thrusts
    last_tilt: Tilts
    last_made: Six


class AllocationCommand(NamedTuple):
    """The answer: thrusts of rotors [N], tilts of arms [rad], the wrench that they make by the model [N, Nm].

    margin is the smallest distance of a group from its limits, as a share of half its range (of its thrust where the
    arm tilts); status one of `allocation_kernels`.
    """

    thrust: Thrusts
    tilt: Tilts
    made: Six
    margin: Number
    status: Count
