"""What a motion asks of rotors and arms: commands with which a vehicle makes it, and how much of their range they take.

Along a motion the wrench that is needed about O is that of Newton and Euler, W. The model's own effects on the wrench
(drag in the air as it moves, a tether) and a disturbance d are there besides, and rotors make what is left,

    W_rotors(u) = W - W_others(u) - d

The commands u are those of the vehicle's own allocation, asked for as much as makes this hold: what is missing is added
to what is asked for until nothing is. That is what the integral of a controller does; an error e of a gain leaves e^n
after n rounds. A vehicle whose rotors push along z only turns its z axis into the force that is needed: of it the
length is asked for.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.flight import Array, Mask
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.controller import pushes_along_z_only
from wrenchgap.plant.state import Motion, State
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import WrenchModel, about_origin, measured_wrench

ROUNDS = 20
"""Of asking for more: an error of gain of half is answered to 1e-6."""
BEYOND = 5.0
"""Speeds that are asked for are cut at so many times their largest: 25 times the thrust."""
AT_ONCE = 200_000
"""Samples, all models together, whose arrays are in memory at once: 0.2 GB for twelve rotors."""
REACHED = 1e-3
"""Of the weight, and of the weight at the arms' length: what is missing below it is rounding."""


@dataclass(frozen=True)
class Demand:
    """The most that a motion takes of D models, all shares of what a part has: `thrust` (D, R) of each rotor's largest
    thrust, T = c_f Omega^2, by its command, and the `least` of it (D, R); `tilt` and `tilt_rate` (D, A) of the range
    and the rate of each arm; whether the wrench is `reached` (D,) all the time.
    """  # noqa: D205

    thrust: Array
    least: Array
    tilt: Array
    tilt_rate: Array
    reached: Mask


def demand(models: Sequence[WrenchModel], state: State, motion: Motion, dt: float, disturbances: Array) -> Demand:
    """Of a motion of O in N samples, `dt` [s] apart, for models of one vehicle with other effects.

    `disturbances` (D, N, 6) [N, Nm] act on each about O, in B. Raises ModelError for a vehicle without rotors.
    """
    allocation = Allocation(_unlimited(models[0].vehicle))
    some = max(1, AT_ONCE // len(state.time))
    parts = [slice(k, k + some) for k in range(0, len(models), some)]
    found = [_demand(allocation, models[part], state, motion, dt, disturbances[part]) for part in parts]
    return Demand(*(np.concatenate(each) for each in zip(*(vars(one).values() for one in found), strict=True)))


def _demand(
    allocation: Allocation,
    models: Sequence[WrenchModel],
    state: State,
    motion: Motion,
    dt: float,
    disturbances: Array,
) -> Demand:
    vehicle, count = models[0].vehicle, len(state.time)
    arms, rotors = vehicle.geometry()
    along_z, weight = pushes_along_z_only(vehicle), vehicle.body.mass * GRAVITY
    lever = float(np.median(np.linalg.norm(arms.position_B, axis=1)))
    least = REACHED * weight * np.array([1.0, 1.0, 1.0, lever, lever, lever])
    needed = np.array([about_origin(m.body, measured_wrench(m.body, motion)) for m in models]) - disturbances
    asked = needed
    for _ in range(ROUNDS):
        commands, _ = allocation.allocate(asked.reshape(-1, 6))
        split = [commands.take(slice(k, k + count)) for k in range(0, len(models) * count, count)]
        pairs = list(zip(models, split, strict=True))
        made = np.array([m.rotors(c, state, None)[1] for m, c in pairs])
        rest = needed - (np.array([m.wrench(c, state) for m, c in pairs]) - made)
        if along_z:
            rest[..., :3] = np.linalg.norm(rest[..., :3], axis=2, keepdims=True) * [0.0, 0.0, 1.0]
        missing = allocation.achievable(rest - made)
        if np.all(np.abs(missing) < least):
            break
        asked = asked + missing
    assert commands.rotor_speed is not None
    assert commands.tilt is not None
    shape = (len(models), count, -1)
    tilt, thrust = commands.tilt.reshape(shape), (commands.rotor_speed / rotors.speed_max).reshape(shape) ** 2
    range_, rate = np.maximum(arms.tilt_max, -arms.tilt_min), np.abs(np.diff(tilt, axis=1, prepend=tilt[:, :1])) / dt
    return Demand(
        thrust.max(axis=1),
        thrust.min(axis=1),
        np.where(arms.tilts, np.abs(tilt).max(axis=1) / range_, 0.0),
        np.where(arms.tilts, rate.max(axis=1) / arms.tilt_rate_max, 0.0),
        np.all(np.abs(missing) < least, axis=(1, 2)),
    )


def _unlimited(vehicle: Vehicle) -> Vehicle:
    """The vehicle with rotors that turn as fast and as slowly as they are asked to."""
    arms, rotors = vehicle.geometry()
    faster = replace(rotors, speed_max=BEYOND * rotors.speed_max, speed_min=np.zeros_like(rotors.speed_min))
    return replace(vehicle, arms=arms, rotors=faster)
