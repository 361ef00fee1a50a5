"""What a vehicle can do: the wrenches that its allocation makes without a limit, and the nearest of them to another.

With the unknowns x = A^+ W of the allocation (`plant.allocation`), a wrench W (about the centre of mass) can be
reached if every arm that tilts has its thrust within a disc, or the sector of it that its range of tilt leaves,

    hypot(lat_i, ver_i) <= T_i,   tilt_min_i <= atan2(lat_i, ver_i) <= tilt_max_i,

and every rotor of an arm that does not tilt has c_f Omega_min^2 <= T_r <= c_f Omega_max^2. (For an arm that tilts the
thrust of rotors that idle is no lower bound, since the set would not be convex, and the direction of an arm that hardly
pushes none either: the allocation holds its angle.) Components that the geometry cannot make at all, such as the
lateral force of a quadrotor, are passed on: the allocation does not see them. Components that it makes only together
with others (`Reach.coupled`) are no axes to correct; an export refuses them.

Of the wrench on each axis, no more than the authority: the largest that the arms make on that axis with all they have.
A vehicle whose rotors are not known is taken to make at most `THRUST_TO_WEIGHT` times its weight, on a lever of its
radius of gyration.

The nearest wrench minimises sum_i ((W_i - W_wanted_i) / authority_i)^2 over that set, by the alternating direction
method of multipliers (Boyd et al., Foundations and Trends in Machine Learning 3, 2011, section 5;
`compensate.kernels.nearest`). It is found to `NEAR` of the authority, and then pulled towards hover until it lies
inside. The penalty of the search is 1, in limits: on 180 random demands on three of the shipped vehicles its rounds
came to 1e-3 of the authority of the best, with 3 to 6e-4, with 0.3 to 4e-2 and with 10 to 6e-3.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from wrenchgap.compensate import kernels
from wrenchgap.compensate.tables import Observed, ReachRoom, ReachTable
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import WrenchModel, about_origin

THRUST_TO_WEIGHT = 20.0
"""Of a vehicle whose rotors are not known: more than racing quadrotors have, so that no flight meets it."""
SHARE = 0.5
"""Of the authority that a correction by named effects, or by an observer, may take: the other half is the
controller's."""
NEAR = 1e-2
"""Share of the authority to which the nearest wrench is found."""
LIMITS = "c_f times the squares of speed_min and speed_max"
CHECK = "check mass [kg], c_f [N s^2], speed_min and speed_max [rad/s], tilt_min_deg and tilt_max_deg in the model"


@dataclass(frozen=True, eq=False)
class Reach:
    """The set {W : rows @ (W / authority) within limits}; all limits are in shares of themselves.

    Of the table: rows (G, 6), first pairs (lateral, vertical) of the D arms that tilt, then one row for each other
    limit; low, high (G - 2 D,) limits of those; middle, half (D,) range of tilt [rad], half >= pi: none; weak (D,)
    share of its limit below which an arm's direction does not count; authority (6,) [N, Nm]; hover (6,) a wrench well
    inside, in authorities, towards which others are pulled; solve (6, 6) (I + rows^T rows)^-1 of the search. `coupled`
    names the axes that the rotors make only together with others.
    """

    table: ReachTable
    coupled: tuple[str, ...] = ()

    @property
    def authority(self) -> Array:
        """Largest wrench (6,) on each axis [N, Nm]."""
        return self.table.authority

    @property
    def correction_max(self) -> Array:
        """Largest correction (6,) by effects or an observer [N, Nm]."""
        return SHARE * self.authority

    def _room(self) -> ReachRoom:
        """Work arrays, new for every call: a reach is shared, and its functions release Python's lock."""
        limits = (np.zeros(len(self.table.rows)) for _ in range(3))
        return ReachRoom(*limits, *(np.zeros(len(AXES)) for _ in range(4)))

    def check_apart(self, axes: Sequence[str], name: str) -> None:
        """Raise ModelError for axes to be corrected that the vehicle of this name makes only together with others."""
        moved = [axis for axis in axes if axis in self.coupled]
        if moved:
            raise ModelError(
                f"{name} makes {', '.join(self.coupled)} only together with one another: a correction of "
                f"{', '.join(moved)} would move others; check position, spin and kappa of the rotors, or leave out "
                "what corrects it"
            )

    def inside(self, wrench: Array) -> bool:
        """Whether the vehicle makes this wrench (6,) with no limit met; False for what is not finite."""
        return bool(kernels.is_inside(self.table, self._room(), np.array(wrench, dtype=float)))

    def take_back(self, observed: Observed, wanted: Array, command: Array, correction: Array) -> None:
        """What an observer does behind a period in which its vehicle could not make what it was to (`kernels`)."""
        given = (np.array(values, dtype=float) for values in (wanted, command, correction))
        kernels.take_back(self.table, self._room(), observed, *given)
        kernels.stop_watching(observed)

    def nearest(self, wrench: Array) -> tuple[Array, bool]:
        """The reachable wrench (6,) nearest to one of numbers that are no nan, and whether it is another."""
        found = np.array(wrench, dtype=float)
        return found, bool(kernels.nearest(self.table, self._room(), found))


@lru_cache(maxsize=8)
def reach_of(vehicle: Vehicle) -> Reach:
    """The reach of a vehicle, computed once. Raises ModelError for one that cannot hover."""
    if not vehicle.has_rotors:
        body = vehicle.body
        gyration = math.sqrt(float(np.linalg.eigvalsh(body.inertia)[-1]) / body.mass)  # about the largest moment's axis
        authority = THRUST_TO_WEIGHT * body.mass * GRAVITY * np.array([1.0] * 3 + [gyration] * 3)
        return _reach(np.zeros((0, 6)), [], np.zeros(0), np.zeros(0), authority, vehicle)
    arms, rotors = vehicle.geometry()
    allocation = Allocation(vehicle)
    moved = about_origin(vehicle.body, np.eye(6)).T  # (6, 6): W about O of W about the centre of mass
    columns = np.linalg.solve(moved, allocation.matrix)
    per_wrench = allocation.inverse @ moved
    discs, singles, idle, weak = [], [], [], []
    reached, column = np.zeros(6), 0
    for arm, group in allocation.groups:
        thrust = float(np.sum(rotors.c_f[group] * rotors.speed_max[group] ** 2))
        if arms.tilts[arm]:
            reached += thrust * np.hypot(columns[:, column], columns[:, column + 1])
            discs.append((arm, per_wrench[column : column + 2] / thrust))
            weak.append(allocation.hold_thrust / thrust)
        else:
            reached += thrust * np.abs(columns[:, column])
            singles.append(per_wrench[column] / thrust)
            idle.append(float(np.sum(rotors.c_f[group] * rotors.speed_min[group] ** 2)) / thrust)
        column += 1 + bool(arms.tilts[arm])
    # Axes that cannot be made at all: a component there is passed on, up to the largest of the others of its kind.
    for part in (slice(0, 3), slice(3, 6)):
        none = reached[part] <= 1e-9 * reached[part].max()
        reached[part] = np.where(none, reached[part].max(), reached[part])
    rows = np.array([row for _, pair in discs for row in pair] + singles).reshape(-1, 6)
    whole = (columns @ per_wrench) * reached / reached[:, None]  # the wrench of a demand on each axis, in authorities
    tolerance = 1e-6  # of the authority
    others, any_wrench = (np.abs(part).max(axis=0) > tolerance for part in (whole - np.eye(6), whole))
    coupled = tuple(axis for axis, own in zip(AXES, any_wrench & others, strict=True) if own)
    found = _reach(rows, [arm for arm, _ in discs], np.array(weak), np.array(idle), reached, vehicle)
    return replace(found, coupled=coupled)


def _reach(rows: Array, tilting: list[int], weak: Array, idle: Array, authority: Array, vehicle: Vehicle) -> Reach:
    """Rows of the unknowns per wrench, in their limits, and the authority's own limits behind them."""
    scaled = np.vstack((rows * authority, np.eye(6)))
    low, high = np.concatenate((idle, -np.ones(6))), np.ones(len(idle) + 6)
    middle = half = np.zeros(0)
    if tilting:
        arms, _ = vehicle.geometry()
        least, most = arms.tilt_min[tilting], arms.tilt_max[tilting]
        all_round = most - least >= 2.0 * np.pi
        middle = np.where(all_round, 0.0, 0.5 * (least + most))
        half = np.where(all_round, np.pi, 0.5 * (most - least))
    hover = np.zeros(len(AXES))
    hover[2] = vehicle.body.mass * GRAVITY
    solve = np.asarray(np.linalg.inv(np.eye(6) + scaled.T @ scaled), dtype=float)
    reach = Reach(ReachTable(scaled, low, high, middle, half, weak, authority, hover / authority, solve))
    if not reach.inside(hover):
        raise ModelError(
            f"{vehicle.name}: cannot hover within its own limits: it weighs {hover[2]:.3g} N, and {LIMITS} give "
            f"{_least(vehicle):.3g} to {authority[2]:.3g} N along z; {CHECK}"
        )
    return reach


def _least(vehicle: Vehicle) -> float:
    """Thrust along z [N] when all rotors of arms that do not tilt idle."""
    if not vehicle.has_rotors:
        return 0.0
    arms, rotors = vehicle.geometry()
    fixed = ~arms.tilts[rotors.arm]
    return float(np.sum((rotors.c_f * rotors.speed_min**2 * arms.normal_B[rotors.arm, 2])[fixed]))


def no_reach() -> Reach:
    """Of a vehicle that is not known: every wrench is inside."""
    none, ones = np.zeros(0), np.ones(len(AXES))
    return Reach(ReachTable(np.zeros((0, 6)), none, none, none, none, none, ones, 0.0 * ones, np.eye(6)))


def check_hover(model: WrenchModel, least: float = 0.2) -> None:
    """Raise UsageError where a hover command lifts less than the share `least` of the weight.

    No vehicle flies so: rotors have twice the weight in thrust, rarely five times. A correction by such effects would
    multiply every command, or turn its sign.
    """
    vehicle, still = model.vehicle, np.zeros((1, 3))
    effects = tuple(one for one in model.effects if not one.effect.needs_voltage)
    weight = vehicle.body.mass * GRAVITY
    hover = np.array([[0.0, 0.0, weight, 0.0, 0.0, 0.0]])
    high = np.array([[0.0, 0.0, 1000.0]])  # out of ground effect
    level = State(np.zeros(1), high, np.array([[1.0, 0.0, 0.0, 0.0]]), still, still)
    commands = Commands(hover)
    if vehicle.has_rotors:
        commands = Allocation(vehicle).allocate(about_origin(vehicle.body, hover))[0]
    share = float(WrenchModel(vehicle, effects).wrench(commands, level)[0, 2]) / weight
    if not share > least:
        raise UsageError(
            f"compensate: with its effects {vehicle.name} makes {share:.2g} of its weight when told to hover, and "
            "could not fly: correct thrust_scale, rotor_thrust and the like, or remove them"
        )
