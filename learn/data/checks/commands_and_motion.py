"""Commands and motion of a flight side by side, as far as checks need them: roughly, and before anything is trusted."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import Array, Samples
from wrenchgap.flight.row_kernels import lengths, runs
from wrenchgap.flight.stamps import spread
from wrenchgap.learn.data.feedback_regressors import lagged
from wrenchgap.learn.data.measurement import derivative, felt_at_origin, from_actuators, low_pass, measured_axes
from wrenchgap.plant.state import Motion, rows
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import measured_wrench


@dataclass(frozen=True)
class ComparisonSettings:
    """What of a flight is compared with the commands."""

    cutoff_hz: float = 4.0
    """Low-pass of everything that is compared [Hz]: below vibration, above trim."""
    fast_hz: float = 0.8
    """Frequency [Hz] above which a torque moves the vehicle; below, commands answer what disturbs (arms that droop, a
    shifted load), and the vehicle hardly turns."""
    lags: tuple[float, ...] = (0.0, 0.03, 0.08)
    """Time constants [s] of the actuators that are tried."""
    lifted: float = 0.3
    """Share of the usual command's size, and of the weight, above which a vehicle flies."""
    enough: float = 120.0
    """Time of a flight that is looked at [s]."""
    piece: float = 20.0
    """Time of it that lies together [s]."""
    shortest: float = 2.0
    """Shortest stretch [s]."""
    slowest: float = 0.1
    """Longest period of its clock [s]."""


COMPARED = ComparisonSettings()


@dataclass(frozen=True)
class CommandsAndMotion:
    """K samples in the air, low-passed. `measured` (K, 6) is m f and J domega + omega x J omega.

    `wrench` (K, 6) is the commanded one (None: not logged), `made` the one that the model makes of the logged `tilt`
    and `speed`, `pushed` the first of both that is known; all in B about the centre of mass.
    `omega` (K, 3) are the rates that go with `measured`, `parts` the stretches, as slices; `dt` [s].
    """

    measured: Array
    omega: Array
    wrench: Array | None
    made: Array | None
    pushed: Array
    tilt: Array | None
    speed: Array | None
    parts: tuple[slice, ...]
    dt: float

    @property
    def witness(self) -> Array:
        """What the actuators are held against: the commanded wrench where it is logged, else the motion."""
        return self.measured if self.wrench is None else self.wrench


def commands_and_motion(stretches: Sequence[Samples], vehicle: Vehicle) -> CommandsAndMotion | None:
    """The flight side by side; None where nothing was flown for long, or an axis was not measured."""
    if not stretches or stretches[0].dt > COMPARED.slowest:
        return None
    try:
        pieces = looked_at([one for one in stretches if len(one) * one.dt >= COMPARED.shortest])
        rows = [_row(samples, vehicle) for samples in pieces]
    except FitError:
        return None  # said where the flight is prepared: these are not the rotors of this vehicle
    if not rows or not measured_axes(vehicle, stretches[0].unmeasured).all():
        return None
    measured, omega = (np.concatenate([row[0][k] for row in rows]) for k in (0, 1))
    joined = [
        None if any(row[k] is None for row in rows) else np.concatenate([row[k] for row in rows]) for k in range(1, 5)
    ]
    wrench, made, tilt, speed = joined
    pushed = wrench if wrench is not None else made
    if pushed is None or not np.isfinite(measured).all():
        return None
    size = lengths(low_pass(pushed[:, :3], stretches[0].dt, 1.0))
    felt = lengths(measured[:, :3])
    usual, high = np.percentile(size, (50, 90))  # the median, unless most of the log is on the ground
    flying = (size > COMPARED.lifted * (usual if usual > 0.05 * high else high)) & (
        felt > COMPARED.lifted * vehicle.body.mass * GRAVITY
    )
    begins = np.cumsum([len(row[0][0]) for row in rows])[:-1]  # where a stretch begins
    parts: list[slice] = []
    for start, stop in runs(flying):
        cuts = [start, *(int(k) for k in begins if start < k < stop), stop]
        parts += [slice(a, b) for a, b in itertools.pairwise(cuts)]
    dt = stretches[0].dt
    trim = int(0.5 / dt)
    parts = [slice(p.start + trim, p.stop - trim) for p in parts if (p.stop - p.start) * dt > COMPARED.shortest]
    return CommandsAndMotion(measured, omega, wrench, made, pushed, tilt, speed, tuple(parts), dt) if parts else None


def looked_at(stretches: Sequence[Samples]) -> list[Samples]:
    """Of hours of flight, `COMPARED.enough` in pieces of `COMPARED.piece` that are evenly spread over each stretch."""
    total = sum(len(one) * one.dt for one in stretches)
    if total <= COMPARED.enough:
        return list(stretches)
    out = []
    for one in stretches:
        run = round(COMPARED.piece / one.dt)
        most = max(round(len(one) * COMPARED.enough / total), min(run, len(one)))
        out += [rows(one, part) for part in spread(len(one), most, run)]
    return out


Row = tuple[tuple[Array, Array], Array | None, Array | None, Array | None, Array | None]


def _row(samples: Samples, vehicle: Vehicle) -> Row:
    dt = samples.dt
    omega = compared(samples.omega_B, dt)
    omega_dot = derivative(omega, dt)
    felt = felt_at_origin(compared(samples.specific_force_B, dt), omega, omega_dot, vehicle.imu_position_B)
    measured = measured_wrench(vehicle.body, Motion(omega, omega_dot, felt))
    wrench = None if samples.wrench_cmd_B is None else compared(samples.wrench_cmd_B, dt)
    speed = samples.rotor_speed_cmd
    if not vehicle.has_rotors or speed is None or not speed.shape[1]:
        return (measured, omega), wrench, None, None, None
    logged = from_actuators(samples.flight, vehicle, samples.tilt_cmd, speed)
    return (measured, omega), wrench, compared(logged.wrench_B, dt), logged.tilt, logged.rotor_speed


def compared(signal: Array, dt: float) -> Array:
    """A signal (N, C) behind the filter of all that is compared."""
    return low_pass(signal, dt, min(COMPARED.cutoff_hz, 0.3 / dt))


def moving(seen: CommandsAndMotion, values: Array, tau: float = 0.0, *, fast: bool = False) -> Array:
    """Values (N, C) behind a lag, of the parts in the air, each without its mean: (K, C); `fast`: high-passed."""
    out = []
    for part in seen.parts:
        late = np.stack([lagged(column[part], tau / seen.dt) for column in values.T], axis=1)
        out.append(late - (low_pass(late, seen.dt, COMPARED.fast_hz) if fast else late.mean(axis=0)))
    return np.concatenate(out)


def at_lags(seen: CommandsAndMotion, values: Array, *, fast: bool = False) -> list[Array]:
    """`moving` values behind each of the lags that are tried."""
    return [moving(seen, values, tau, fast=fast) for tau in COMPARED.lags]


def flown(seen: CommandsAndMotion, values: Array) -> Array:
    """Values (N, C) of the parts in the air: (K, C)."""
    return np.concatenate([values[rows] for rows in seen.parts])
