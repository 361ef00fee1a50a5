"""What a vehicle can do: the wrenches that its allocation makes without a limit, and the nearest of them to another.

With the unknowns x = A^+ W of the allocation (`plant.allocation`), a wrench W (about the centre of mass) can be
reached if every arm that tilts has its thrust within a disc, or the sector of it that its range of tilt leaves,

    hypot(lat_i, ver_i) <= T_i,   tilt_min_i <= atan2(lat_i, ver_i) <= tilt_max_i,

and every rotor of an arm that does not tilt has 0 <= T_r <= c_f Omega_max^2. (The thrust of a rotor that idles is no
lower bound, and the direction of an arm that hardly pushes none either: the allocation holds its angle.) Components
that the geometry cannot make at all, such as the lateral force of a quadrotor, are passed on: the allocation does not
see them.

Of the wrench on each axis, no more than the authority: the largest that the arms make on that axis with all they have.
A vehicle whose rotors are not known is taken to make at most `THRUST_TO_WEIGHT` times its weight, on a lever of its
radius of gyration.

The nearest wrench minimises sum_i ((W_i - W_wanted_i) / authority_i)^2 over that set, by the alternating direction
method of multipliers (Boyd et al., Foundations and Trends in Machine Learning 3, 2011, section 5). It is found to
`NEAR` of the authority, and then pulled towards hover until it lies inside.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.vehicle import GRAVITY, Body, Vehicle
from wrenchgap.plant.wrench_model import about_origin

THRUST_TO_WEIGHT = 20.0
"""Of a vehicle whose rotors are not known: more than racing quadrotors have, so that no flight meets it."""
SHARE = 0.5
"""Of the authority that a correction by named effects, or by an observer, may take: the other half is the
controller's."""
SLACK = 1e-6
"""Share of a limit by which a wrench may be outside and still counts as reached: rounding, also of single precision."""
FAR = 10.0
"""Authorities to which a wanted wrench is cut on every axis before the nearest is looked for: beyond, it is no
demand."""
ROUNDS, PULLS = 100, 30
"""Rounds of the search for the nearest wrench, and halvings when it is pulled inside. Both are fixed, so that a period
takes a bounded time; `NEAR` is what they reach."""
NEAR = 1e-2
"""Share of the authority to which the nearest wrench is found."""
LIMITS = "c_f times the square of speed_max"
CHECK = "check mass [kg], c_f [N s^2], speed_max [rad/s], tilt_min_deg and tilt_max_deg in the model"
WEIGHT = 1.0
"""Penalty of the search, in limits. On 180 random demands on three of the shipped vehicles `ROUNDS` rounds came to
1e-3 of the authority of the best with 1, to 6e-4 with 3, 4e-2 with 0.3 and 6e-3 with 10."""


@dataclass(frozen=True, eq=False)
class Reach:
    """The set {W : rows @ (W / authority) within limits}; all limits are in shares of themselves.

    rows       (G, 6): first pairs (lateral, vertical) of the D arms that tilt, then one row for each other limit
    low, high  (G - 2 D,) limits of those
    middle, half  (D,) range of tilt [rad]; half >= pi: none
    weak       (D,) share of its limit below which an arm's direction does not count
    authority  (6,) [N, Nm]
    hover      (6,) a wrench well inside, towards which others are pulled
    solve      (6, 6) (I + rows^T rows)^-1 of the search
    """

    rows: Array
    low: Array
    high: Array
    middle: Array
    half: Array
    weak: Array
    authority: Array
    hover: Array
    solve: Array

    @property
    def correction_max(self) -> Array:
        """Largest correction (6,) by effects or an observer [N, Nm]."""
        return SHARE * self.authority

    def inside(self, wrench: Array) -> bool:
        """Whether the vehicle makes this wrench (6,) with no limit met; False for what is not finite."""
        return self._within(self.rows @ (wrench / self.authority))

    def _within(self, x: Array) -> bool:
        d = len(self.middle)
        pair, single = x[: 2 * d].reshape(d, 2), x[2 * d :]
        thrust = np.hypot(pair[:, 0], pair[:, 1])
        off = self._off(pair)
        return bool(
            np.all(thrust <= 1.0 + SLACK)
            and np.all((thrust <= self.weak) | (np.abs(off) <= self.half + SLACK))
            and np.all((single >= self.low - SLACK) & (single <= self.high + SLACK))
        )

    def _off(self, pair: Array) -> Array:
        """Angle (D,) by which the thrust of arms is off the middle of their range [rad]."""
        turned = np.arctan2(pair[:, 0], pair[:, 1]) - self.middle
        return np.asarray(turned - 2.0 * np.pi * np.floor(turned / (2.0 * np.pi) + 0.5))

    def _limited(self, x: Array) -> Array:
        """The nearest unknowns (G,) within the limits, each arm and rotor by itself."""
        d = len(self.middle)
        pair = x[: 2 * d].reshape(d, 2)
        off = self._off(pair)
        beyond = np.abs(off) > self.half
        edge = self.middle + np.sign(off) * self.half
        ray = np.stack((np.sin(edge), np.cos(edge)), axis=1)
        pair = np.where(beyond[:, None], np.maximum(np.sum(pair * ray, axis=1), 0.0)[:, None] * ray, pair)
        pair = pair / np.maximum(np.hypot(pair[:, 0], pair[:, 1]), 1.0)[:, None]
        return np.concatenate((pair.ravel(), np.clip(x[2 * d :], self.low, self.high)))

    def nearest(self, wrench: Array) -> tuple[Array, bool]:
        """The reachable wrench (6,) nearest to one of numbers that are no nan, and whether it is another."""
        if self.inside(wrench):
            return wrench, False
        wanted = np.clip(wrench / self.authority, -FAR, FAR)
        w, u = wanted, np.zeros(len(self.rows))
        for _ in range(ROUNDS):
            x = self.rows @ w
            z = self._limited(x + u)
            u = u + x - z
            w = self.solve @ (wanted + WEIGHT * (self.rows.T @ (z - u)))
        centre = self.hover / self.authority
        least, most = 0.0, 1.0
        if self._within(self.rows @ w):
            least = 1.0
        else:
            for _ in range(PULLS):
                middle = 0.5 * (least + most)
                if self._within(self.rows @ (centre + middle * (w - centre))):
                    least = middle
                else:
                    most = middle
        return np.asarray(self.authority * (centre + least * (w - centre))), True


@lru_cache(maxsize=8)
def reach_of(vehicle: Vehicle) -> Reach:
    """The reach of a vehicle, made once. Raises ModelError for one that cannot hover."""
    if not vehicle.has_rotors:
        authority = THRUST_TO_WEIGHT * vehicle.body.mass * GRAVITY * np.array([1.0] * 3 + [_gyration(vehicle.body)] * 3)
        return _reach(np.zeros((0, 6)), [], np.zeros(0), authority, vehicle)
    arms, rotors = vehicle.geometry()
    allocation = Allocation(vehicle)
    moved = about_origin(vehicle.body, np.eye(6)).T  # (6, 6): W about O of W about the centre of mass
    columns = np.linalg.solve(moved, allocation.matrix)
    per_wrench = allocation.inverse @ moved
    discs, singles, limits, weak = [], [], [], []
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
            limits.append(thrust)
        column += 1 + bool(arms.tilts[arm])
    # Axes that cannot be made at all: a component there is passed on, up to the largest of the others of its kind.
    for part in (slice(0, 3), slice(3, 6)):
        none = reached[part] <= 1e-9 * reached[part].max()
        reached[part] = np.where(none, reached[part].max(), reached[part])
    rows = np.array([row for _, pair in discs for row in pair] + singles).reshape(-1, 6)
    return _reach(rows, [arm for arm, _ in discs], np.array(weak), reached, vehicle)


def _gyration(body: Body) -> float:
    """Radius of gyration [m] about the axis of the largest moment of inertia."""
    return math.sqrt(float(np.linalg.eigvalsh(body.inertia)[-1]) / body.mass)


def _reach(rows: Array, tilting: list[int], weak: Array, authority: Array, vehicle: Vehicle) -> Reach:
    """Rows of the unknowns per wrench, in their limits, and the authority's own limits behind them."""
    scaled = np.vstack((rows * authority, np.eye(6)))
    fixed = len(rows) - 2 * len(tilting)
    low, high = np.concatenate((np.zeros(fixed), -np.ones(6))), np.ones(fixed + 6)
    middle = half = np.zeros(0)
    if tilting:
        arms, _ = vehicle.geometry()
        least, most = arms.tilt_min[tilting], arms.tilt_max[tilting]
        all_round = most - least >= 2.0 * np.pi
        middle = np.where(all_round, 0.0, 0.5 * (least + most))
        half = np.where(all_round, np.pi, 0.5 * (most - least))
    made = Reach(
        rows=scaled,
        low=low,
        high=high,
        middle=middle,
        half=half,
        weak=weak,
        authority=authority,
        hover=np.zeros(len(AXES)),
        solve=np.asarray(np.linalg.inv(np.eye(6) + WEIGHT * scaled.T @ scaled), dtype=float),
    )
    hover = np.zeros(len(AXES))
    hover[2] = vehicle.body.mass * GRAVITY
    if not made.inside(hover):
        raise ModelError(
            f"{vehicle.name}: cannot hover within its own limits: it weighs {hover[2]:.3g} N, and {LIMITS} give "
            f"at most {authority[2]:.3g} N along z; {CHECK}"
        )
    return replace(made, hover=hover)
