"""The allocation n(W): from a wrench to tilt angles and rotor speeds, and its saturation.

With lat_i = T_i sin(alpha_i) and ver_i = T_i cos(alpha_i), T_i the summed thrust of arm i, the actuation is linear:
W = A x. The nominal allocation is the pseudo-inverse x = A^+ W, after which

    T_i = hypot(lat_i, ver_i),   alpha_i = atan2(lat_i, ver_i),   Omega_r = sqrt(T_i / sum of the arm's c_f).

The rotors of one arm turn at equal speed. An arm that cannot tilt contributes one column per rotor, so fixed-rotor
vehicles are the special case without lateral columns. Source: Kamel et al., "The Voliro
omniorientational hexacopter", 2018.

Angles are unwrapped from sample to sample and held while an arm's thrust is below `hold_thrust`; turned by whole turns
into their range where that has the same direction; then limited in rate and range; rotor speeds are limited in range.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.flight.stamps import pieces
from wrenchgap.plant.state import Commands
from wrenchgap.plant.vehicle import GRAVITY, Arms, Rotors, Vehicle

HOLD_THRUST, HOLD_SHARE = 0.2, 0.05
"""Arm thrust [N], and share of an arm's thrust in hover, below which the tilt direction is meaningless and the angle
is held. The smaller counts: 0.2 N is more than an arm of a 30 g vehicle ever pushes."""

TURN = 2.0 * np.pi
ROUNDING = 1e-9
"""By which an angle [rad, turns] may be beyond an end of its range and still count as at it."""


@dataclass(frozen=True)
class Saturation:
    """How many of N samples were limited: by rotor speed, tilt rate, tilt range, or held for want of thrust."""

    rotor_speed: int = 0
    tilt_rate: int = 0
    tilt_range: int = 0
    held: int = 0


def _columns(arms: Arms, rotors: Rotors) -> tuple[Array, list[tuple[int, NDArray[np.intp]]]]:
    """Columns of A (6, K), and for each group of unknowns its arm and rotors.

    A tilting arm owns two columns, lateral then vertical, of its summed thrust; a fixed arm one per rotor.
    """
    columns: list[Array] = []
    groups: list[tuple[int, NDArray[np.intp]]] = []
    lateral = arms.lateral_B
    for i in range(len(arms)):
        members = np.flatnonzero(rotors.arm == i)
        if members.size == 0:
            continue
        directions = (lateral[i], arms.normal_B[i]) if arms.tilts[i] else (arms.normal_B[i],)
        for group in [members] if arms.tilts[i] else [members[k : k + 1] for k in range(len(members))]:
            share = rotors.c_f[group] / rotors.c_f[group].sum()
            drag = float(np.sum(share * rotors.spin[group] * rotors.kappa[group]))
            columns.extend(np.concatenate((d, np.cross(arms.position_B[i], d) - drag * d)) for d in directions)
            groups.append((i, group))
    return np.stack(columns, axis=1), groups


class Allocation:
    """n(W) and sat for one vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        arms, rotors = vehicle.geometry()
        self.matrix, self.groups = _columns(arms, rotors)
        self.inverse: Array = np.asarray(np.linalg.pinv(self.matrix, rcond=1e-9), dtype=np.float64)
        self.hold_thrust = min(HOLD_THRUST, HOLD_SHARE * vehicle.body.mass * GRAVITY / len(arms))
        self.rank = int(np.linalg.matrix_rank(self.matrix, tol=1e-9))

    def achievable(self, wrench_B: Array) -> Array:
        """The part of wrenches (N, 6) that this geometry can make at all, before saturation."""
        return np.asarray(wrench_B @ (self.matrix @ self.inverse).T)

    def allocate(
        self, wrench_B: Array, *, previous_tilt: Array | None = None, dt: float | None = None
    ) -> tuple[Commands, Saturation]:
        """Commands that make the wrenches (N, 6) about O, and how often they had to be limited.

        Samples are `dt` [s] apart; `previous_tilt` (A,) [rad] is the angle one `dt` before the first. Without `dt`
        no rate limit is applied. The returned `wrench_B` is the request, before saturation.
        """
        arms, rotors = self.vehicle.geometry()
        count = len(wrench_B)
        tilt: Array = np.zeros((count, len(arms)))
        weak = np.zeros((count, len(arms)), dtype=bool)
        limited, saturated = np.empty((count, len(rotors))), 0
        for piece in pieces(count):
            thrust_over_cf = self._thrusts(wrench_B[piece], tilt[piece], weak[piece])
            speed = np.sqrt(np.maximum(thrust_over_cf, 0.0))
            limited[piece] = np.clip(speed, rotors.speed_min, rotors.speed_max)
            over = (limited[piece] != speed) | (thrust_over_cf < 0)
            saturated += int(over.any(axis=1).sum())
        if not arms.tilts.any():
            return Commands(wrench_B, tilt, limited), Saturation(rotor_speed=saturated)
        tilt = _hold(tilt, weak, previous_tilt)
        before = tilt[:0] if previous_tilt is None else previous_tilt[None]
        path = np.vstack((before, tilt)) if len(before) else tilt
        if not np.all(np.abs(np.diff(path, axis=0)) < np.pi):  # else unwrapped as they are
            tilt = np.unwrap(path, axis=0)[len(before) :]
        if not np.all((tilt >= arms.tilt_min) & (tilt <= arms.tilt_max)):
            tilt = _turned_into_range(tilt, arms.tilt_min, arms.tilt_max, previous_tilt)
        tilt, rate_limited = _limit_rate(tilt, arms.tilt_rate_max, previous_tilt, dt)
        in_range = np.clip(tilt, arms.tilt_min, arms.tilt_max)
        return Commands(wrench_B, in_range, limited), Saturation(
            rotor_speed=saturated,
            tilt_rate=rate_limited,
            tilt_range=int((in_range != tilt).any(axis=1).sum()),
            held=int(weak.any(axis=1).sum()),
        )

    def _thrusts(self, wrench_B: Array, tilt: Array, weak: NDArray[np.bool_]) -> Array:
        """Thrust over c_f (N, R) for wrenches (N, 6); writes the angles meant, and where thrust is too weak for one."""
        arms, rotors = self.vehicle.geometry()
        unknowns = wrench_B @ self.inverse.T
        thrust_over_cf = np.zeros((len(wrench_B), len(rotors)))
        column = 0
        for arm, group in self.groups:
            if arms.tilts[arm]:
                lat, ver = unknowns[:, column], unknowns[:, column + 1]
                column += 2
                thrust = np.hypot(lat, ver)
                tilt[:, arm] = np.arctan2(lat, ver)
                weak[:, arm] = thrust < self.hold_thrust
            else:
                thrust = unknowns[:, column]
                column += 1
            thrust_over_cf[:, group] = (thrust / rotors.c_f[group].sum())[:, None]
        return thrust_over_cf


@lru_cache(maxsize=8)
def allocation_of(vehicle: Vehicle) -> Allocation:
    """The allocation of a vehicle, made once: all stretches of a flight ask for the same."""
    return Allocation(vehicle)


def _hold(tilt: Array, weak: NDArray[np.bool_], previous: Array | None) -> Array:
    """Repeat the last angle wherever thrust is too weak to define one."""
    if not weak.any():
        return tilt
    start = np.zeros(tilt.shape[1]) if previous is None else previous
    padded = np.vstack((start, tilt))
    index = np.where(np.vstack((np.zeros(weak.shape[1], dtype=bool), weak)), 0, np.arange(len(padded))[:, None])
    return np.asarray(np.take_along_axis(padded, np.maximum.accumulate(index, axis=0), axis=0)[1:])


def _turned_into_range(tilt: Array, least: Array, most: Array, previous: Array | None) -> Array:
    """Angles (N, A) that point the same way, each next to the one before and by whole turns within its range.

    Where no such angle is in range, the one next to the angle before is returned, beyond the range. Without this an
    arm whose range is wider than half a turn would stand at a stop although the same direction lies within.
    """
    out, last = np.empty_like(tilt), np.zeros(tilt.shape[1]) if previous is None else previous
    for k, wanted in enumerate(tilt):
        near = wanted + TURN * np.floor((last - wanted) / TURN + 0.5)
        other = near + TURN * (_whole_turns(least - near) - _whole_turns(near - most))
        inside = (other >= least - ROUNDING) & (other <= most + ROUNDING)
        out[k] = np.where(inside, other, near)
        last = np.clip(out[k], least, most)
    return out


def _whole_turns(beyond: Array) -> Array:
    """How many whole turns bring an angle back over an end of its range that it is `beyond` by [rad]; 0 within."""
    return np.ceil(np.maximum(beyond, 0.0) / TURN - ROUNDING)


def _limit_rate(tilt: Array, rate_max: Array, previous: Array | None, dt: float | None) -> tuple[Array, int]:
    """Angles that follow `tilt` no faster than `rate_max`, and the number of samples that were limited."""
    if dt is None:
        return tilt, 0
    step = rate_max * dt
    start = tilt[0] if previous is None else previous
    if np.all(np.abs(np.diff(tilt, axis=0, prepend=start[None])) <= step):
        return tilt, 0
    out = np.empty_like(tilt)
    limited = 0
    last = start
    for k, wanted in enumerate(tilt):
        change = wanted - last
        bounded = np.clip(change, -step, step)
        limited += bool(np.any(bounded != change))
        last = last + bounded
        out[k] = last
    return out, limited
