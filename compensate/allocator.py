"""The corrected allocation of a vehicle as flown: thrusts and tilts for a demand, and the margin that its choice keeps.

`allocation_kernels` says how thrusts are chosen. `Allocator` steps it in Python; `replay.export.allocation` writes it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wrenchgap.compensate import allocation_kernels as kernels
from wrenchgap.compensate.allocation_tables import AllocationCommand, AllocationMemory, AllocationRoom, AllocationTable
from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.allocation import allocation_of
from wrenchgap.plant.allocation_problem import AllocationProblem, allocation_problem, demands, made_by_model
from wrenchgap.plant.effectiveness import RANK
from wrenchgap.plant.model import Model
from wrenchgap.plant.targets.quantities import acting_effects
from wrenchgap.plant.vehicle import GRAVITY


@dataclass(frozen=True)
class AllocatorSettings:
    """What the allocation decides by."""

    rounds: int = 10
    """Of the search for the largest margin: on 600 random demands of octorotors and hexarotors its largest share of a
    range was at most 4 % above the best (0 rounds, the pseudo-inverse: 69 %; 30: 1.3 %)."""
    calm: float = 0.5
    """Largest share of a range up to which the pseudo-inverse is taken: on arms that tilt the largest margin costs
    angle, 27 deg in place of 20 deg rms for forces of 0.3 of the weight, which meets more of the wakes."""
    far: float = 10.0
    """Times all thrusts at their largest: beyond that a demand is none."""
    rounding: float = 1e-6
    """[N, Nm]: what is below is no harm."""
    demands: int = 400
    """Of the comparison of margins: their mean is known to a percentage point."""


SETTINGS = AllocatorSettings()


@dataclass(frozen=True, eq=False)
class Allocated:
    """Thrusts (R,) [N] of the nominal rotors, c_f Omega^2, tilts (A,) [rad], the wrench `made` (6,) about the centre of
    mass by the model; `margin` and `status` as `allocation_tables.AllocationCommand` has them.
    """  # noqa: D205

    thrust: Array
    tilt: Array
    made: Array
    margin: float
    status: int


class Allocator:
    """Steps the corrected allocation; remembers the command of before. `rounds` 0 is the pseudo-inverse.

    `calm` 0 takes the largest margin everywhere.
    """

    def __init__(self, problem: AllocationProblem, rounds: int = SETTINGS.rounds, calm: float = SETTINGS.calm) -> None:
        self.problem, self.table = problem, table_of(problem, rounds, calm)
        self._room, self._memory, self._out = rooms(self.table)
        self.reset()

    def reset(self, tilt: Array | None = None) -> None:
        """Forget the command of before: hover takes its place, with arms at rest or at `tilt` (A,) [rad]."""
        kernels.hovering(self.table, self._room, self._memory, self._out)
        if tilt is not None:
            self._memory.last_tilt[:] = tilt

    def step(self, wrench_B: Array) -> Allocated:
        """The command for a wrench (6,) about the centre of mass [N, Nm]."""
        kernels.answered(self.table, self._room, self._memory, np.array(wrench_B, dtype=float), self._out)
        out = self._out
        return Allocated(out.thrust.copy(), out.tilt.copy(), out.made.copy(), float(out.margin[0]), int(out.status[0]))

    def largest(self, wrench_B: Array) -> float:
        """The largest share of its range that a rotor or arm needs for a wrench (6,); beyond one it cannot be made."""
        self._room.wanted[:] = wrench_B
        return float(kernels.searched(self.table, self._room))


@dataclass(frozen=True, eq=False)
class Margins:
    """Smallest margins of rotors, shares of half their ranges, over N demands that the vehicle can make.

    `best` (N,) with the largest margin, `plain` (N,) with the pseudo-inverse: below zero it cannot make the demand.
    `spare` is the dimension of the null space: how many unknowns are free once a demand is made.
    """

    best: Array
    plain: Array
    spare: int


@dataclass(frozen=True, eq=False)
class Left:
    """What the model makes beyond a demand, rms (2,) of force [N] and torque [Nm] over careful demands.

    `nominal` with the nominal allocation, `corrected` with the corrected one.
    """

    nominal: Array
    corrected: Array

    @property
    def worse(self) -> bool:
        """Whether the corrected allocation does harm by the model itself."""
        return bool((self.corrected > self.nominal + SETTINGS.rounding).any())


def left_by_model(model: Model, problem: AllocationProblem, count: int = 100, seed: int = 1) -> Left:
    """What is left of demands that were not in the fit of the problem (`plant.allocation_problem.demands`)."""
    effects, nominal = acting_effects(model), allocation_problem(model, nominal=True)
    wanted = demands(nominal, count, np.random.default_rng(seed))

    def off(allocator: Allocator) -> Array:
        out = [allocator.step(one) for one in wanted]
        given = np.array([one.thrust for one in out]), np.array([one.tilt for one in out])
        apart = made_by_model(nominal, effects, *given) - wanted
        return np.asarray(np.sqrt(np.mean(np.sum(apart.reshape(count, 2, 3) ** 2, axis=2), axis=0)))

    return Left(off(Allocator(nominal, rounds=0)), off(Allocator(problem)))


def margins(problem: AllocationProblem, count: int = SETTINGS.demands, seed: int = 0) -> Margins:
    """Margins of demands that lie evenly between hover and the end of the vehicle's reach, in directions of chance.

    Directions are even in shares of what all thrusts together make on each axis.
    """
    rng, search = np.random.default_rng(seed), Allocator(problem)
    authority, flat = problem.authority, problem.flat
    makes = problem.directions @ problem.directions.T
    spare = int(np.any(flat != 0.0, axis=0).sum()) - len(search.table.demand)
    inverse = np.linalg.pinv(problem.directions.T @ flat, rcond=RANK) @ problem.directions.T
    best, plain = np.zeros(count), np.zeros(count)
    for n in range(count):
        way = makes @ (rng.normal(size=6) * authority)
        inside, outside = 0.0, 1.0
        way = way / np.linalg.norm(way / np.where(authority > 0.0, authority, 1.0))
        for _ in range(20):
            middle = 0.5 * (inside + outside)
            inside, outside = (
                (middle, outside) if search.largest(problem.hover + middle * way) <= 1.0 else (inside, middle)
            )
        wanted = problem.hover + rng.uniform(0.0, inside) * way
        best[n] = 1.0 - search.largest(wanted)
        thrusts = (inverse @ (wanted - problem.offset)).reshape(-1, 2)
        off = np.hypot(thrusts[:, 0] - search.table.centre, thrusts[:, 1])
        plain[n] = 1.0 - float(np.max(off / search.table.half))
    return Margins(best, plain, spare)


def table_of(problem: AllocationProblem, rounds: int = SETTINGS.rounds, calm: float = SETTINGS.calm) -> AllocationTable:
    """Constants of the allocation; raises ModelError for a vehicle that cannot hover within its limits as flown."""
    p = problem
    arms, rotors = p.vehicle.geometry()
    centre = np.where(p.tilts, 0.0, 0.5 * (p.low + p.high))
    half = np.where(p.tilts, p.high, 0.5 * (p.high - p.low))
    left, sizes, right = np.linalg.svd(p.directions.T @ (p.flat * np.repeat(half, 2)), full_matrices=False)
    kept = sizes > RANK * sizes[0]
    right = right[kept].reshape(-1, len(half), 2)
    table = AllocationTable(
        demand=(left[:, kept] / sizes[kept]).T @ p.directions.T,
        bias=p.offset + p.wrench[:, :, 0] @ centre,
        along=np.ascontiguousarray(right[:, :, 0]),
        across=np.ascontiguousarray(right[:, :, 1]),
        made_along=np.ascontiguousarray(p.wrench[:, :, 0]),
        made_across=np.ascontiguousarray(p.wrench[:, :, 1]),
        made_bias=p.offset,
        hover=np.zeros((len(half), 2)),
        centre=centre,
        half=half,
        low=p.low,
        high=p.high,
        weak=np.minimum(allocation_of(p.vehicle).hold_thrust, p.high),
        tilting=p.tilts.astype(np.int64),
        arm=p.arm,
        tilt_min=arms.tilt_min,
        tilt_max=arms.tilt_max,
        owner=p.group,
        share=p.share,
        least=rotors.c_f * rotors.speed_min**2,
        most=rotors.c_f * rotors.speed_max**2,
        far=SETTINGS.far * p.authority,
        rounds=rounds,
        calm=calm,
    )
    room = rooms(table)[0]
    room.wanted[:] = p.hover
    needed = float(kernels.searched(table, room))
    if not needed <= 1.0:
        raise ModelError(
            f"{p.vehicle.name}: cannot hover within its own limits as flown: a rotor would need {100 * needed:.0f} % "
            f"of what it has, for {p.hover[2] / GRAVITY:.3g} kg; check mass, c_f, speed_max and the fitted effects"
        )
    return table._replace(hover=room.best.copy())


def rooms(table: AllocationTable) -> tuple[AllocationRoom, AllocationMemory, AllocationCommand]:
    """Room to work in, memory, and room for the answer."""
    rank, groups, rotors, arms = len(table.demand), len(table.half), len(table.share), len(table.tilt_min)
    b, y, factor = np.zeros(rank), np.zeros(rank), np.zeros((rank, rank))
    u, best, less, whole = (np.zeros((groups, 2)) for _ in range(4))
    room = AllocationRoom(b, y, factor, np.zeros(groups), np.zeros(groups), np.zeros(6), u, best, less, whole)
    memory = AllocationMemory(np.zeros(rotors), np.zeros(arms), np.zeros(6))
    out = AllocationCommand(np.zeros(rotors), np.zeros(arms), np.zeros(6), np.zeros(1), np.zeros(1, dtype=np.int64))
    return room, memory, out
