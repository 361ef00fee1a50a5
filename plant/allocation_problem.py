"""The allocation of a vehicle as flown, as a problem with limits: what groups of rotors make, and how much they have.

A group is what is asked for as one: a rotor, or all rotors of an arm that tilts (`plant.allocation`). With the thrust
x_g along its direction at rest and y_g across it, about the centre of mass as flown,

    W = offset + sum_g (wrench_g,0 x_g + wrench_g,1 y_g),    low_g <= x_g <= high_g, y_g = 0     arms that do not tilt
                                                             hypot(x_g, y_g) <= high_g           arms that do

the straight line of least squares through what the model makes of `FLOWN.samples` commands about hover (statistical
linearisation: Gelb, "Applied optimal estimation", 1974, chapter 6): of effects that are linear in these thrusts, their
own law; of wakes, which an arm meets only when it tilts, what they are on average in flight. Commands are those of the
nominal allocation for forces and torques of chance, and as much again that nominally makes no wrench. Limits are those
of the rotors' speeds, in thrusts of the nominal rotor, c_f Omega^2.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array, Mask
from wrenchgap.plant.allocation import allocation_of
from wrenchgap.plant.effectiveness import RANK, linear_matrix, makeable, spread
from wrenchgap.plant.model import Model
from wrenchgap.plant.targets.quantities import acting_effects, still_wrench
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel, about_com


@dataclass(frozen=True)
class FlownCommands:
    """Commands about hover of which the straight line is the best: what careful flights ask for."""

    samples: int = 300
    """Ten for each of the unknowns of twelve rotors on six arms that tilt, or more."""
    force: float = 0.3
    """Largest force from hover, of the weight."""
    torque: float = 0.05
    """Largest torque, of what all thrusts together make."""
    beside: float = 0.1
    """Standard deviation of what makes no wrench, of the mean thrust of a group."""


FLOWN = FlownCommands()


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
    tilts: Mask
    group: NDArray[np.int64]
    share: Array

    @property
    def flat(self) -> Array:
        """`wrench` as (6, 2 G): along and across of each group in turn."""
        return self.wrench.reshape(6, -1)

    @property
    def authority(self) -> Array:
        """Largest force and torque (6,) on each axis that all thrusts together could make [N, Nm]."""
        return np.asarray(np.hypot(self.wrench[:, :, 0], self.wrench[:, :, 1]) @ self.high)


def allocation_problem(model: Model, *, nominal: bool = False) -> AllocationProblem:
    """The problem of a model with its effects, or of its `nominal` vehicle.

    Effects of the air, of the battery and at a limit are left out. Raises ModelError for a model without rotors.
    """
    vehicle = model.vehicle
    arms, rotors = vehicle.geometry()
    groups, linear = allocation_of(vehicle).groups, linear_matrix(model, [])
    arm = np.array([a for a, _ in groups], dtype=np.int64)
    tilts, count = arms.tilts[arm], len(groups)
    wrench = np.zeros((6, count, 2))
    wrench[:, :, 0], wrench[:, tilts, 1] = linear[:, :count], linear[:, count:]
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
    hover = np.array([0.0, 0.0, vehicle.body.mass * GRAVITY, 0.0, 0.0, 0.0])
    limits = (low, high, arm, tilts, group.astype(np.int64), of)
    known = AllocationProblem(vehicle, wrench, np.zeros(6), hover, makeable(linear), *limits)
    effects = [] if nominal else acting_effects(model)
    return _as_flown(known, effects) if effects else known


def demands(nominal: AllocationProblem, count: int, rng: np.random.Generator) -> Array:
    """Wrenches (count, 6) about hover, of chance, as a careful flight asks for them (`FLOWN.force`, `FLOWN.torque`)."""
    size = np.concatenate((np.full(3, FLOWN.force * nominal.hover[2]), FLOWN.torque * nominal.authority[3:]))
    return np.asarray(nominal.hover + rng.uniform(-1.0, 1.0, (count, 6)) * size)


def made_by_model(problem: AllocationProblem, effects: list[ModelEffect], thrust: Array, tilt: Array) -> Array:
    """Wrenches (N, 6) about the centre of mass as flown that a model makes of thrusts (N, R) [N] and tilts (N, A)."""
    _, rotors = problem.vehicle.geometry()
    acting = WrenchModel(problem.vehicle, tuple(effects))
    speed = np.sqrt(np.maximum(thrust, 0.0) / rotors.c_f)
    rows = [still_wrench(acting, s[None], t)[0] for s, t in zip(speed, tilt, strict=True)]
    return about_com(acting.body, np.array(rows))


def _as_flown(nominal: AllocationProblem, effects: list[ModelEffect], seed: int = 0) -> AllocationProblem:
    """The problem with the straight line through what the effects make of commands about hover."""
    p, rng = nominal, np.random.default_rng(seed)
    arms, _ = p.vehicle.geometry()
    used = np.stack((np.ones_like(p.tilts), p.tilts), axis=1).ravel()
    inverse = np.linalg.pinv(p.directions.T @ p.flat, rcond=RANK) @ p.directions.T
    mean = inverse @ p.hover
    beside = np.eye(len(used)) - inverse @ p.flat
    chance = rng.normal(size=(FLOWN.samples, len(used))) * used * FLOWN.beside * p.hover[2] / len(p.high)
    off = ((demands(p, FLOWN.samples, rng) - p.hover) @ inverse.T + chance @ beside.T) * used
    asked = (mean + off * _within(p, mean, off)[:, None]).reshape(FLOWN.samples, -1, 2)
    thrust = np.where(p.tilts, np.hypot(asked[:, :, 0], asked[:, :, 1]), asked[:, :, 0])
    tilt = np.zeros((FLOWN.samples, len(arms)))
    tilt[:, p.arm[p.tilts]] = np.arctan2(asked[:, p.tilts, 1], asked[:, p.tilts, 0])
    made = made_by_model(p, effects, p.share * thrust[:, p.group], tilt)
    known = np.column_stack((np.ones(FLOWN.samples), asked.reshape(FLOWN.samples, -1)[:, used]))
    law = np.linalg.lstsq(known, made, rcond=None)[0]
    flat = np.zeros_like(p.flat)
    flat[:, used] = law[1:].T
    mass = WrenchModel(p.vehicle, tuple(effects)).body.mass
    hover = np.array([0.0, 0.0, mass * GRAVITY, 0.0, 0.0, 0.0])
    return replace(p, wrench=flat.reshape(p.wrench.shape), offset=law[0], hover=hover)


def _within(p: AllocationProblem, mean: Array, off: Array) -> Array:
    """Share (N,) of its way from the mean at which each command is within the thrusts of arms that do not tilt."""
    room = np.where(off > 0.0, np.repeat(p.high, 2) - mean, np.repeat(p.low, 2) - mean) / np.where(off == 0.0, 1.0, off)
    fixed = np.repeat(~p.tilts, 2) & (off != 0.0)
    return np.asarray(np.clip(np.where(fixed, room, 1.0).min(axis=1), 0.0, 1.0))
