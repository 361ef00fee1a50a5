"""Commands at the limits of the model file.

A command *at* a limit is as good as any: what the rotors were told is known, and the model is given the same. It is
shown and not left out. What matters is a command that asks for more than there is: then the wrench that counts as
commanded is not the one that the vehicle was able to make. It is left out where the missing part, behind the filter of
the analysis, is larger than 5 % of the weight, or 2 % of the weight at the rotors' distance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wrenchgap.flight.flight import Array, Samples
from wrenchgap.flight.memory import HOURS, empty_on_disk, give_back
from wrenchgap.flight.stamps import pieces
from wrenchgap.learn.data.measurement import low_pass
from wrenchgap.learn.data.phases.phase import Phase, closed, runs
from wrenchgap.learn.data.phases.signals import SIGNALS, sizes
from wrenchgap.plant.actuation import nominal_wrench
from wrenchgap.plant.allocation import allocation_of
from wrenchgap.plant.state import Commands
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import about_com, about_origin


def saturations(
    samples: Samples,
    commands: Commands,
    source: str,
    vehicle: Vehicle,
    cutoff_hz: float,
    *,
    least_force: float = 0.05,
    least_torque: float = 0.02,
    full: float = 0.999,
    joined: float = 0.2,
) -> list[Phase]:
    """Where rotors are at their limits, and where that takes away from the wrench that counts as commanded.

    `source` is that of `commands_of`. Vehicles without rotors in the model file have no limits. A missing force
    matters from `least_force` [weights] on, a torque from `least_torque` [weights at the rotors' distance], root mean
    square. A rotor is at its limit from the share `full` of `speed_max` on; what is closer than `joined` [s] is one.
    """
    if not vehicle.has_rotors or commands.rotor_speed is None or len(samples) < SIGNALS.fewest:
        return []
    _, rotors = vehicle.geometry()
    at = np.any(commands.rotor_speed >= full * rotors.speed_max, axis=1)
    join = max(1, round(joined / samples.dt))
    give_back(len(samples))
    missing = _missing(commands, source, vehicle)
    force, torque = _sizes(missing, samples.dt, min(cutoff_hz, 0.3 / samples.dt))
    give_back(len(missing))
    weight = vehicle.body.mass * GRAVITY
    arm = float(np.sqrt(np.mean(np.sum(vehicle.geometry()[0].position_B ** 2, axis=1))))
    matters = closed((force > least_force * weight) | (torque > least_torque * weight * arm), join)
    out = []
    for a, b in runs(matters):
        most = f"up to {force[a:b].max():.2g} N and {torque[a:b].max():.2g} Nm beyond what the rotors can make"
        out.append(Phase("saturation", float(samples.time[a]), float(samples.time[b - 1]), most))
    for a, b in runs(closed(at, join) & ~matters):
        why = "a rotor is commanded to its largest speed: that is known to the model"
        out.append(Phase("saturation", float(samples.time[a]), float(samples.time[b - 1]), why, left_out=False))
    return out


def _sizes(missing: Array, dt: float, cutoff_hz: float) -> tuple[Array, Array]:
    """Sizes (N,) of force and torque of wrenches (N, 6) behind a filter; of hours, one column after the other."""
    if not missing.any():
        return np.zeros(len(missing)), np.zeros(len(missing))
    if len(missing) < HOURS:
        missing = low_pass(missing, dt, cutoff_hz)
        return sizes(missing[:, :3]), sizes(missing[:, 3:])
    force, torque = (sum(low_pass(missing[:, k], dt, cutoff_hz) ** 2 for k in part) for part in (range(3), range(3, 6)))
    return np.sqrt(force), np.sqrt(torque)


def _missing(commands: Commands, source: str, vehicle: Vehicle) -> Array:
    """Commanded wrench (N, 6) minus the one of the same commands within the rotors' limits."""
    _, rotors = vehicle.geometry()
    assert commands.rotor_speed is not None
    if source == "allocated":
        allocation, asked = allocation_of(vehicle), empty_on_disk((len(commands.rotor_speed), 6))
        for piece in pieces(len(asked)):
            sent = commands.take(piece)
            asked[piece] = allocation.achievable(about_origin(vehicle.body, sent.wrench_B))
            asked[piece] -= nominal_wrench(vehicle, sent)
            give_back(len(asked))
        return asked
    within, missing = np.clip(commands.rotor_speed, 0.0, rotors.speed_max), np.zeros((len(commands.rotor_speed), 6))
    beyond = np.flatnonzero((within != commands.rotor_speed).any(axis=1))
    if len(beyond):
        sent = commands.take(beyond)
        limited = replace(sent, rotor_speed=within[beyond])
        made = (about_com(vehicle.body, nominal_wrench(vehicle, one)) for one in (sent, limited))
        missing[beyond] = np.subtract(*made)
    return missing
