"""On the ground or held, and the way up from it and down to it.

Contact is certain where something else than the rotors carries `CARRIED` of the weight while the vehicle
neither falls nor moves fast; it reaches on to both sides as long as the vehicle stands still and a part of its weight
is carried: rotors that spin up or down on the ground. Free fall is no contact: there nothing carries. Height of the
ground's effect: Cheeseman and Bennett, ARC R&M 3021 (1955), 1/(1 - (R/4z)^2): 0.4 % of thrust at z = 4 R.
"""

from __future__ import annotations

import numpy as np

from wrenchgap.learn.data.phases.phase import Phase, closed, runs
from wrenchgap.learn.data.phases.signals import Flags, Signals, carried, sizes
from wrenchgap.plant.vehicle import Vehicle

CARRIED, RESTS = 0.4, 0.6
"""Share of the weight that something else carries, and that is felt at least: certain contact."""
TOUCHING = 0.08
"""Share of the weight that something else carries where the vehicle stands still beside certain contact."""
STILL_RATE, STILL_FORCE = 0.15, 0.06
"""Slow rate [rad/s] and distance of the felt force from the weight up to which a vehicle stands still."""
QUICK = 1.5
"""Speed [m/s] beyond which nothing stands on the ground: rotors that are driven by the air carry as well."""
MOSTLY = 0.5
"""Share of a contact in which a vehicle stands still that stands on the ground."""
AT_REST, HELD = 0.4, 1.0
"""For so long [s] contact lasts at least, where the vehicle stands still for most of it, and where it does not."""
INTERRUPTED = 0.5
"""Interruptions of contact up to so long [s] are contact."""
RADII, LEAST_CLEARANCE = 4.0, 0.1
"""Rotor radii, and metres, above the ground from which on it has no effect."""
LONGEST, BLIND = 2.0, 1.0
"""Of take-off and landing [s], and their length where the height is not known."""


def contact(part: Signals, scale: float) -> Flags:
    """Where (N,) the vehicle stands on the ground, lies on it, or is held."""
    if not part.vertical:
        return _idle(part, scale)
    share, felt, still = carried(part, scale), sizes(part.slow_felt), stands(part)
    certain = (share > CARRIED) & (felt > RESTS)
    if part.speed is not None:
        certain &= part.speed < QUICK
    for a, b in runs(certain):
        least = AT_REST if still[a:b].mean() > MOSTLY else HELD
        if (b - a) * part.dt < least and a > 0 and b < len(certain):
            certain[a:b] = False
    touching = certain | (still & (share > TOUCHING))
    found = np.zeros(len(certain), dtype=bool)
    for a, b in runs(touching):
        found[a:b] = certain[a:b].any()
    return closed(found, part.samples(INTERRUPTED))


def stands(part: Signals) -> Flags:
    """Where (N,) the vehicle neither turns nor is accelerated: on the ground, or in a calm hover."""
    felt = sizes(part.slow_felt)
    return np.asarray((part.turning < STILL_RATE) & (np.abs(felt - 1.0) < STILL_FORCE))


def _idle(part: Signals, scale: float) -> Flags:
    """Where nothing tells the ground but the commands: those that could not carry the vehicle."""
    return np.asarray(scale * sizes(part.slow_pushed) < 1.0 - RESTS)


def ground(part: Signals, on: Flags, vehicle: Vehicle) -> list[Phase]:
    """Ground, take-offs and landings of a stretch, of the contact (N,) in it."""
    clear = LEAST_CLEARANCE
    if vehicle.has_rotors:
        radius = vehicle.geometry()[1].radius
        clear = max(clear, RADII * float(np.nan_to_num(radius).max(initial=0.0)))
    still = stands(part)
    out = []
    for a, b in runs(on):
        words = ("ground", "the ground carries it") if still[a:b].mean() > MOSTLY else ("held", "no rotor carries it")
        out.append(Phase(words[0], float(part.time[a]), float(part.time[b - 1]), words[1]))
        if b < len(on):
            out.append(_way(part, on, b, clear, up=True))
        if a > 0:
            out.append(_way(part, on, a - 1, clear, up=False))
    return [phase for phase in out if phase.stop > phase.start]


def _way(part: Signals, on: Flags, first: int, clear: float, *, up: bool) -> Phase:
    """From contact away: forward in time for a take-off, backward for a landing."""
    step = 1 if up else -1
    reach = part.samples(BLIND if part.height is None else LONGEST)
    last = first
    while 0 <= last + step < len(on) and abs(last + step - first) < reach and not on[last + step]:
        last += step
        if part.height is not None and abs(part.height[last] - part.height[first]) > clear:
            break
    start, stop = sorted((float(part.time[first]), float(part.time[last])))
    why = f"within {clear:.2g} m of the ground" if part.height is not None else "next to the ground, height unknown"
    return Phase("take-off" if up else "landing", start, stop, why)
