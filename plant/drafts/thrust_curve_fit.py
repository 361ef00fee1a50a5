"""The curve of thrust over the command, from a flight of a vehicle whose weight is known.

In the air the accelerometer along the thrust reads m f_z = T_max sum_r n_r,z [f u_r^2 + (1 - f) u_r]. Both columns are
known, so T_max and f follow from least squares; f is believed where leaving out single stretches of the
flight scatters it by less than `SURE` (jackknife), else the assumed f stays and T_max alone is taken, as the median of
what every moment says. Source: Newton's second law along the thrust; Efron, "The jackknife", 1982.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array, Flight
from wrenchgap.plant.drafts.draft import Draft, Sourced
from wrenchgap.plant.vehicle import GRAVITY

FLYING = 0.6
"""Lift, in shares of what is large in this flight (the 90th percentile), from which on the rotors carry."""
LEAST_THROTTLE = 0.1
"""Mean share of full throttle below which they do not: idling on the ground."""
HEIGHT = 0.2
"""Height above the ground [m] from which on the rotors carry, where the odometry knows it."""
STRONG = (1.05, 12.0)
"""Thrust at full throttle over the weight that a multirotor can have."""
SECONDS = 0.5
"""Time over which force and commands are averaged [s]: the vehicle answers late."""
LEAST = 3.0
"""Time in the air [s] below which nothing is said."""
SURE = 0.15
"""Standard deviation of the curve's factor up to which a flight shows it."""
VARIES = 0.02
"""Range of the throttle (5 to 95 %), relative to its median, from which on a flight can show the curve's shape."""
STRETCHES = 8
"""Into which the flight is cut for that."""


def with_fitted_thrust(draft: Draft, flown: Flight) -> Draft:
    """The draft with the level of its thrust curve from this flight, and its shape where that was assumed.

    As it was where the flight does not say it: too short, or commands of another unit or number.
    """
    command, sent, imu = draft.command, flown.actuators, flown.imu
    if command is None or sent is None or imu is None or draft.mass is None or not draft.rotors:
        return draft
    if sent.unit != command.keys["unit"].value or sent.rotor_speed.shape[1] != len(draft.rotors):
        return draft
    columns = _columns(draft, sent.rotor_speed)
    lift, force = _in_the_air(flown, sent.time, columns)
    seconds = len(force) * float(np.median(np.diff(sent.time)))
    if seconds < LEAST:
        return draft
    carried = float(draft.mass.value) * force
    where = f"{seconds:.0f} s of {flown.path.name}"
    factor, keys = command.keys["factor"], dict(command.keys)
    if factor.assumed and (found := _factor(lift, carried)) is not None:
        value, std = found
        factor = Sourced(
            round(value, 3), f"fitted: the accelerometer's force over the commands, {where}, +-{max(std, 0.01):.2g}"
        )
        keys["factor"] = factor
    shape = lift @ (1.0 - float(factor.value), float(factor.value))
    low, middle, high = np.percentile(carried / shape, (25.0, 50.0, 75.0))
    words = (
        f"fitted: the accelerometer's force over the commands, median of {where} "
        f"(middle half +-{50.0 * (high - low) / middle:.1f} %)"
    )
    rotors = abs(float(np.sum([r.direction_B.value[2] for r in draft.rotors])))
    ratio = float(middle) * rotors / (float(draft.mass.value) * GRAVITY)
    if not STRONG[0] < ratio < STRONG[1]:
        note = f"{where}: full throttle would lift {ratio:.3g} times the weight; not believed, is this a flight?"
        return replace(draft, notes=(*draft.notes, note))
    return replace(draft, command=replace(command, keys=keys, thrust_max=Sourced(float(middle), words)))


def _columns(draft: Draft, raw: Array) -> Array:
    """Sums (N, 2) over rotors of n_z u and n_z u^2, of commands (N, R) as logged."""
    assert draft.command is not None
    keys = draft.command.keys
    low, high = keys["range"].value if "range" in keys else (0.0, 1.0)
    u = np.clip((np.nan_to_num(raw) - low) / (high - low), 0.0, 1.0)
    up = np.array([r.direction_B.value for r in draft.rotors])[:, 2]
    return np.stack((u @ up, u**2 @ up), axis=1)


def _in_the_air(flown: Flight, at: Array, columns: Array) -> tuple[Array, Array]:
    """Columns (M, 2) and specific force along z (M,), averaged, where the rotors carry the vehicle."""
    nothing = np.empty((0, 2)), np.empty(0)
    assert flown.imu is not None
    time, force = flown.imu.time, flown.imu.specific_force_B[:, 2]
    known = np.isfinite(force)
    if known.sum() < 2 or len(at) < 2:
        return nothing
    covered = (at >= time[known][0]) & (at <= time[known][-1])
    lift = np.stack([_averaged(at, column) for column in columns.T], axis=1)
    felt = np.interp(at, time[known], _averaged(time[known], force[known]))
    spinning = lift[:, 0] > LEAST_THROTTLE * _rotors(flown)
    if not spinning.any():
        return nothing
    large = float(np.percentile(lift[spinning, 1], 90.0))
    flying = covered & spinning & (lift[:, 1] > FLYING * large) & (felt > 0.5 * GRAVITY)
    flying &= _off_the_ground(flown, at, spinning)
    return lift[flying], felt[flying]


def _off_the_ground(flown: Flight, at: Array, spinning: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where (N,) the vehicle is above where its rotors stood still; where they never do, whether it moved at all."""
    if flown.odometry is None:
        return np.ones(len(at), dtype=bool)
    places = [np.interp(at, flown.odometry.time, column) for column in flown.odometry.position_E.T]
    if (~spinning).any():
        return np.asarray(places[2] > float(np.median(places[2][~spinning])) + HEIGHT)
    return np.full(len(at), max(float(np.ptp(column)) for column in places) > HEIGHT)


def _rotors(flown: Flight) -> int:
    assert flown.actuators is not None
    return int(flown.actuators.rotor_speed.shape[1])


def _averaged(time: Array, values: Array) -> Array:
    width = max(1, round(SECONDS / max(float(np.median(np.diff(time))), 1e-6)))
    padded = np.pad(values, (width // 2, width - 1 - width // 2), mode="edge")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="valid")


def _factor(lift: Array, carried: Array) -> tuple[float, float] | None:
    """The curve's factor and its standard deviation; None where the flight does not show it."""

    def share(rows: NDArray[np.bool_]) -> float:
        line, square = np.linalg.lstsq(lift[rows], carried[rows], rcond=None)[0]
        return float(square / (line + square)) if line + square > 0.0 else float("nan")

    low, middle, high = np.percentile(lift[:, 0], (5.0, 50.0, 95.0))
    if high - low < VARIES * middle:
        return None
    stretch = np.arange(len(carried)) * STRETCHES // len(carried)
    without = np.array([share(stretch != k) for k in range(STRETCHES)])
    std = float(np.sqrt((STRETCHES - 1) * np.var(without)))
    found = share(stretch >= 0)
    sure = std < SURE and -3.0 * SURE < found < 1.0 + 3.0 * SURE
    return (float(np.clip(found, 0.0, 1.0)), std) if sure else None
