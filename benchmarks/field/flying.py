"""Three kinds of flying for vehicles with fixed rotors: references at the control ticks, and what is added to commands.

| kind | reference | added to the commands | controller |
|---|---|---|---|
| excited | multisines on position and yaw | multisines on thrust and torques, 0.6-5 Hz | RotorPy's SE3 |
| mission | hovers, RotorPy's min-snap lines through waypoints, turns | nothing | RotorPy's SE3 |
| low | hovers with a height scan down to one rotor radius | nothing | RotorPy's SE3 |
| turbulence | stands still, in gusts | nothing | softer, with integrals of position and attitude |

Lengths go with the vehicle: a nano quadrotor flies 1 m where one of 1.5 kg flies 2 m.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.field.vehicles import GRAVITY, Vehicle
from benchmarks.hidden_effects.trajectories import multisine, quintic
from wrenchgap.flight.flight import Array

RATE = 200.0
"""Hz, of the controller and of the log."""
HEIGHT = 1.6
THRUST_SHARE = 0.05
"""Rms of the thrust that excitation adds, over the weight."""
SHARE_OF_TILT, SHARE_OF_YAW = 0.02, 0.10
"""Rms of the torques that excitation adds, over m g arm and over kappa m g."""


@dataclass(frozen=True)
class Plan:
    """Flat outputs at the ticks: `time`, `yaw`, `yaw_rate` (N,); `position`, `velocity`, `acceleration` (N, 3) in E.

    `added` (N, 4) [N, Nm] goes onto commanded thrust and torque; `integral` switches the controller's integrals on.
    """

    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    yaw: Array
    yaw_rate: Array
    added: Array
    integral: bool = False


def plan(kind: str, vehicle: Vehicle, seconds: float, seed: int) -> Plan:
    """One flight of `kind`, drawn from `seed`."""
    return KINDS[kind](vehicle, np.arange(round(seconds * RATE)) / RATE, np.random.default_rng([seed, 41]))


def _size(vehicle: Vehicle) -> float:
    """m, of a manoeuvre."""
    return float(np.clip(2.0 * (vehicle.mass / 1.5) ** 0.2, 0.7, 2.5))


Course = Callable[[Array], Array]
"""Times (N,) to positions (N, 3) or headings (N,)."""


def _sampled(time: Array, position: Course, yaw: Course) -> tuple[Array, ...]:
    """Position (., 3) and yaw with derivatives by central differences over +-2 ms."""
    eps = 2e-3
    p, before, after = position(time), position(time - eps), position(time + eps)
    yaws = [yaw(time + k * eps) for k in (-1, 0, 1)]
    rate = (yaws[2] - yaws[0]) / (2 * eps)
    return p, (after - before) / (2 * eps), (after - 2 * p + before) / eps**2, yaws[1], rate


def excited(vehicle: Vehicle, time: Array, rng: np.random.Generator) -> Plan:
    """All axes at once, faded in over 2 s."""
    seeds = rng.integers(1 << 31, size=8)

    def sines(t: Array, k: int, low: float, high: float, fall: float = 1.0) -> Array:
        return multisine(t, np.random.default_rng(seeds[k]), low, high, fall)

    size = _size(vehicle)

    def position(t: Array) -> Array:
        swing = np.stack([rms * sines(t, k, 0.08, 0.55) for k, rms in enumerate((0.5, 0.5, 0.2))], 1)
        return np.asarray(quintic(t / 2.0)[:, None] * size * swing + np.array((0.0, 0.0, HEIGHT + 0.5 * size)))

    flat = _sampled(time, position, lambda t: quintic(t / 2.0) * 0.6 * sines(t, 3, 0.06, 0.4))
    weight = vehicle.mass * GRAVITY
    tilt, yaw = SHARE_OF_TILT * weight * vehicle.arm, SHARE_OF_YAW * weight * vehicle.k_m / vehicle.k_eta
    added = np.stack(
        [rms * sines(time, 4 + k, 0.6, 5.0, 0.3) for k, rms in enumerate((THRUST_SHARE * weight, tilt, tilt, yaw))],
        1,
    )
    return Plan(time, *flat, quintic(time / 2.0)[:, None] * added)


def mission(vehicle: Vehicle, time: Array, rng: np.random.Generator) -> Plan:
    """Hover, fly a line of two legs with a turn of heading, hover, and so on, until the time is up."""
    from rotorpy.trajectories.minsnap import MinSnap

    size, dt = _size(vehicle), 1.0 / RATE
    at, heading = np.array((0.0, 0.0, HEIGHT)), 0.0
    rows: list[Array] = []
    while len(rows) < len(time):
        rows += [np.concatenate((at, np.zeros(6), (heading, 0.0)))] * round(rng.uniform(1.5, 2.5) * RATE)
        low, high = np.array((-2.0, -2.0, 1.0)), np.array((2.0, 2.0, 2.5))
        stops = [at]
        while len(stops) < 3:
            stop = rng.uniform(low, high) * np.array((size, size, 1.0))
            if np.linalg.norm(stop - stops[-1]) > 0.8 * size:
                stops.append(stop)
        turn = heading + rng.uniform(-1.5, 1.5)
        yaws = np.array((heading, 0.5 * (heading + turn), turn))
        speed = rng.uniform(0.3, 0.6) * size  # peaks of some 3 m/s and 4 m/s^2 with 1.5 kg
        legs = MinSnap(np.array(stops), yaws, v_max=20.0, v_avg=speed, verbose=False)
        for t in np.arange(0.0, legs.t_keyframes[-1], dt):
            flat = legs.update(t)
            rows.append(
                np.concatenate((flat["x"], flat["x_dot"], flat["x_ddot"], (float(flat["yaw"]), float(flat["yaw_dot"]))))
            )
        at, heading = stops[-1], turn
    table = np.array(rows[: len(time)])
    columns = (table[:, :3], table[:, 3:6], table[:, 6:9], table[:, 9], table[:, 10])
    return Plan(time, *columns, np.zeros((len(time), 4)))


def low(vehicle: Vehicle, time: Array, rng: np.random.Generator) -> Plan:
    """Up and down between 1 and 6 rotor radii, with some drift and heading."""
    seeds, radius = rng.integers(1 << 31, size=3), vehicle.radius

    def position(t: Array) -> Array:
        drift = [0.15 * multisine(t, np.random.default_rng(seeds[k]), 0.08, 0.4) for k in range(2)]
        return np.stack((*drift, radius * (3.5 + 2.5 * np.cos(2 * np.pi * t / 7.0))), 1)

    flat = _sampled(time, position, lambda t: 0.5 * multisine(t, np.random.default_rng(seeds[2]), 0.06, 0.3))
    return Plan(time, *flat, np.zeros((len(time), 4)))


def turbulence(vehicle: Vehicle, time: Array, rng: np.random.Generator) -> Plan:
    """Stand still."""
    still = np.zeros((len(time), 3))
    flat = (still + np.array((0.0, 0.0, HEIGHT)), still, still, still[:, 0], still[:, 0])
    return Plan(time, *flat, np.zeros((len(time), 4)), integral=True)


KINDS: dict[str, Callable[[Vehicle, Array, np.random.Generator], Plan]] = {
    "excited": excited,
    "mission": mission,
    "low": low,
    "turbulence": turbulence,
}


def gusts(time: Array, rms: float, seconds: float, rng: np.random.Generator, columns: int = 3) -> Array:
    """Turbulence (N, columns) of one correlation time: an Ornstein-Uhlenbeck process, sampled exactly.

    Its spectrum is Dryden's longitudinal one, 2 sigma^2 tau / (1 + (omega tau)^2), tau = L / V (MIL-F-8785C). RotorPy's
    own Dryden gusts need torch and scale with the time step.
    """
    keep = float(np.exp(-(time[1] - time[0]) / seconds))
    kicks = rng.normal(size=(len(time), columns)) * np.sqrt(1.0 - keep**2)
    out = np.empty((len(time), columns))
    value = rng.normal(size=columns)
    for k, kick in enumerate(kicks):
        value = keep * value + kick
        out[k] = value
    return rms * out
