"""The level of a thrust curve from a flight of a vehicle whose weight is known.

In the air the accelerometer along the thrust reads f_z = T / m with T = T_max sum_r n_r,z s(u_r), where s is the
curve's shape, s(1) = 1, so that at every moment T_max = m f_z / sum_r n_r,z s(u_r). The median over the flight is
taken, and what the middle half of it scatters by is said. Source: Newton's second law along the thrust.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wrenchgap.flight.flight import Array, Flight
from wrenchgap.plant.drafts.draft import Draft, Said
from wrenchgap.plant.vehicle import GRAVITY

FLYING = 0.7
"""Specific force along the thrust, in g, from which on rotors carry the vehicle, where commands do so too."""
THROTTLE = 0.1
"""Mean throttle below which they do not: the ground carries."""
SECONDS = 1.0
"""Time over which force and commands are averaged [s]: the vehicle answers late."""
LEAST = 3.0
"""Time in the air [s] below which nothing is said."""


def levelled(draft: Draft, flown: Flight) -> Draft:
    """The draft with the level of its thrust curve from this flight; as it was where the flight does not say it."""
    command, sent, imu = draft.command, flown.actuators, flown.imu
    if command is None or sent is None or imu is None or draft.mass is None or not draft.rotors:
        return draft
    if sent.unit != command.keys["unit"].value or sent.rotor_speed.shape[1] != len(draft.rotors):
        return draft
    shares = _shares(draft, sent.rotor_speed)
    up = np.array([r.direction_B.value for r in draft.rotors])[:, 2]
    lift, force = _together(sent.time, shares @ up, imu.time, imu.specific_force_B[:, 2])
    flying = (force > FLYING * GRAVITY) & (lift > THROTTLE * float(np.abs(up).sum()) * _share(draft, THROTTLE))
    seconds = float(flying.sum()) * float(np.median(np.diff(sent.time)))
    if seconds < LEAST:
        return draft
    ratio = float(draft.mass.value) * force[flying] / lift[flying]
    low, middle, high = np.percentile(ratio, (25.0, 50.0, 75.0))
    words = (
        f"fitted: the accelerometer's force over the commands, median of {seconds:.0f} s of {flown.path.name} "
        f"(middle half +-{50.0 * (high - low) / middle:.1f} %)"
    )
    return replace(draft, command=replace(command, thrust_max=Said(float(middle), words)))


def _shares(draft: Draft, raw: Array) -> Array:
    """Shares of full thrust (N, R) of commands as logged, by the shape of the draft's curve."""
    assert draft.command is not None
    keys = draft.command.keys
    low, high = keys["range"].value if "range" in keys else (0.0, 1.0)
    return _shape(draft, np.clip((np.nan_to_num(raw) - low) / (high - low), 0.0, 1.0))


def _shape(draft: Draft, u: Array) -> Array:
    assert draft.command is not None
    factor = float(draft.command.keys["factor"].value)
    return np.asarray(factor * u**2 + (1.0 - factor) * u)


def _share(draft: Draft, u: float) -> float:
    return float(_shape(draft, np.array(u)))


def _together(at: Array, lift: Array, time: Array, force: Array) -> tuple[Array, Array]:
    """Both averaged over `SECONDS`, at the stamps `at` of the commands that the IMU covers."""
    known = np.isfinite(force)
    if known.sum() < 2:
        return np.empty(0), np.empty(0)
    covered = (at >= time[known][0]) & (at <= time[known][-1])
    return _averaged(at, lift)[covered], np.interp(at[covered], time[known], _averaged(time[known], force[known]))


def _averaged(time: Array, values: Array) -> Array:
    width = max(1, round(SECONDS / max(float(np.median(np.diff(time))), 1e-6)))
    padded = np.pad(values, (width // 2, width - 1 - width // 2), mode="edge")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
