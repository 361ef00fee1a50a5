"""The allocation n(W): from a wrench to tilt angles and rotor speeds, and its saturation.

With lat_i = T_i sin(alpha_i) and ver_i = T_i cos(alpha_i), T_i the summed thrust of arm i, the actuation is linear:
W = A x. The nominal allocation is the pseudo-inverse x = A^+ W, after which

    T_i = hypot(lat_i, ver_i),   alpha_i = atan2(lat_i, ver_i),   Omega_r = sqrt(T_i / sum of the arm's c_f).

The rotors of one arm turn at equal speed. An arm that cannot tilt contributes one column per rotor, so fixed-rotor
vehicles are the special case without lateral columns. Source: Kamel et al., "The Voliro
omniorientational hexacopter", 2018.

Each angle is held while its arm's thrust is below `hold_thrust`, else taken next to the angle that was sent before, and
turned by whole turns into its range where that has the same direction; then limited in rate and range. Without the
turns an arm whose range is wider than half a turn would stand at a stop although the same direction lies within.
Rotor speeds are limited in range.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from wrenchgap.flight.flight import Array, Indices, Mask
from wrenchgap.plant.simulation.loop import Loop, Signals, Stage
from wrenchgap.plant.state import Commands
from wrenchgap.plant.vehicle import GRAVITY, Arms, Rotors, Vehicle

TURN = 2.0 * np.pi
LIMITS = ("rotor_speed", "tilt_rate", "tilt_range", "held")


@dataclass(frozen=True)
class Saturation:
    """How many of N samples were limited by rotor speed, tilt rate, tilt range, or had an angle held."""

    rotor_speed: int = 0
    tilt_rate: int = 0
    tilt_range: int = 0
    held: int = 0


def _columns(arms: Arms, rotors: Rotors) -> tuple[Array, list[tuple[int, Indices]]]:
    """Columns of A (6, K), and for each group of unknowns its arm and rotors.

    A tilting arm owns two columns, lateral then vertical, of its summed thrust; a fixed arm one per rotor.
    """
    columns: list[Array] = []
    groups: list[tuple[int, Indices]] = []
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
    """n(W) and sat for one vehicle.

    Below an arm thrust of `hold_thrust` [N], or `hold_share` of an arm's thrust in hover where that is less, the tilt
    direction is meaningless and the angle is held: 0.2 N is more than an arm of a 30 g vehicle ever pushes.
    """

    def __init__(self, vehicle: Vehicle, hold_thrust: float = 0.2, hold_share: float = 0.05) -> None:
        self.vehicle = vehicle
        arms, rotors = vehicle.geometry()
        self.matrix, self.groups = _columns(arms, rotors)
        self.inverse: Array = np.asarray(np.linalg.pinv(self.matrix, rcond=1e-9), dtype=np.float64)
        self.hold_thrust = min(hold_thrust, hold_share * vehicle.body.mass * GRAVITY / len(arms))
        self.rank = int(np.linalg.matrix_rank(self.matrix, tol=1e-9))

    def achievable(self, wrench_B: Array) -> Array:
        """The part of wrenches (N, 6) that this geometry can make, before saturation."""
        return np.asarray(wrench_B @ (self.matrix @ self.inverse).T)

    def step(
        self, wrench_B: Array, before: Array, fresh: Mask | bool = False, dt: float | None = None
    ) -> tuple[Array, Array, Array]:
        """Commands for one wrench.

        Parameters
        ----------
        wrench_B : (6,)
            About O [N, Nm].
        before : (A,)
            Angles that were sent `dt` [s] ago [rad]; zero where none were.
        fresh
            Whether none were.
        dt
            Without it no rate limit is applied [s].

        Returns
        -------
        tilt : (A,)
            [rad].
        speed : (R,)
            [rad/s].
        limited : (4,)
            1.0 for each of `LIMITS` that was met, else 0.0.
        """
        arms, rotors = self.vehicle.geometry()
        solution = self.inverse @ wrench_B
        tilt, square = np.zeros_like(before), np.zeros_like(before, shape=len(rotors))
        weak, column = np.zeros_like(before), 0
        for arm, group in self.groups:
            thrust = solution[column : column + 1]
            if arms.tilts[arm]:
                lateral, vertical, own = thrust, solution[column + 1 : column + 2], slice(arm, arm + 1)
                thrust = np.hypot(lateral, vertical)
                weak[own] = 1.0 * (thrust < self.hold_thrust)
                tilt[own] = np.where(weak[own] > 0.0, before[own], np.arctan2(lateral, vertical))
            column += 1 + bool(arms.tilts[arm])
            square[group] = thrust / float(rotors.c_f[group].sum())
        desired = np.sqrt(np.maximum(square, 0.0))
        speed = np.clip(desired, rotors.speed_min, rotors.speed_max)
        over = (np.abs(speed - desired) > 0.0) | (square < 0.0)
        free = np.flatnonzero(arms.tilts)
        turned, slow = self.rate_limited(tilt[free], before[free], fresh, dt)
        tilt[free] = np.clip(turned, arms.tilt_min[free], arms.tilt_max[free])
        beyond = np.abs(tilt[free] - turned) > 0.0
        limited = [np.minimum(np.sum(1.0 * where, keepdims=True), 1.0) for where in (over, slow, beyond, weak)]
        return tilt, speed, np.concatenate(limited)

    def rate_limited(self, tilt: Array, before: Array, fresh: Mask | bool, dt: float | None) -> tuple[Array, Array]:
        """Angles (T,) of tilting arms, turned and limited in rate (see the module), and where the rate was limited."""
        arms, _ = self.vehicle.geometry()
        least, most = arms.tilt_min[arms.tilts], arms.tilt_max[arms.tilts]
        tilt = np.asanyarray(tilt + TURN * np.floor((before - tilt) / TURN + 0.5))  # next to the angle before
        stopped = np.flatnonzero(np.minimum(most, -least) < 1e4)  # rad: a model without stops has 1e9 degrees
        tilt[stopped] = angle_in_range(tilt[stopped], least[stopped], most[stopped])
        if dt is None:
            return tilt, np.zeros_like(tilt)
        step = np.where(fresh, np.inf, arms.tilt_rate_max[arms.tilts] * dt)
        change = tilt - before
        slow = np.abs(change) > step
        return np.where(slow, before + np.clip(change, -step, step), tilt), np.asanyarray(1.0 * slow)

    def allocate(
        self, wrench_B: Array, *, previous_tilt: Array | None = None, dt: float | None = None
    ) -> tuple[Commands, Saturation]:
        """Commands for wrenches (N, 6) about O by `step`, one by one, and the number of limited samples.

        Samples are `dt` [s] apart; `previous_tilt` (A,) [rad] is the angle one `dt` before the first. Without `dt`
        no rate limit is applied. The returned `wrench_B` is the request, before saturation.
        """
        count, (arms, rotors) = len(wrench_B), self.vehicle.geometry()
        compiled = count >= 64  # fewer steps take less time in numpy than tracing one
        first = {
            "tilt": np.zeros(len(arms)) if previous_tilt is None else previous_tilt,
            "speed": np.zeros(len(rotors)),
            "limited": np.zeros(len(LIMITS)),
            "fresh": np.array([float(previous_tilt is None)]),
        }

        def step(signals: Signals, wrench: Array) -> dict[str, Array]:
            tilt, speed, limited = self.step(wrench, signals["tilt"], signals["fresh"] > 0.0, dt)
            return {"tilt": tilt, "speed": speed, "limited": limited, "fresh": np.zeros(1)}

        log = ("tilt", "speed", "limited")
        loop = Loop(first, [Stage("allocation", step, wrench_B, log=log)], count, compiled=compiled)
        loop.run()
        tilt, speed, limited = (loop.logged("allocation", name, count) for name in log)
        saturation = dict(zip(LIMITS, limited.sum(axis=0).astype(int).tolist(), strict=True))
        return Commands(wrench_B, tilt, speed), Saturation(**saturation)


@lru_cache(maxsize=8)
def allocation_of(vehicle: Vehicle) -> Allocation:
    """The allocation of a vehicle, computed once for all parts of a flight."""
    return Allocation(vehicle)


def angle_in_range(tilt: Array, least: Array, most: Array, rounding: float = 1e-9) -> Array:
    """Angles (...) [rad], turned by whole turns into their range where that has the same direction, else unchanged.

    An angle that is beyond an end of its range by `rounding` [rad, turns] counts as at the end.
    """
    back = np.ceil(np.maximum(tilt - most, 0.0) / TURN - rounding)
    forth = np.ceil(np.maximum(least - tilt, 0.0) / TURN - rounding)
    other = tilt + TURN * (forth - back)
    return np.where((other >= least - rounding) & (other <= most + rounding), other, tilt)
