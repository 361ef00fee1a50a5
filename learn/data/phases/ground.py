"""On the ground or held, and the way up from it and down to it.

Contact is certain where something else than the rotors carries `CONTACT.carried` of the weight while the vehicle
neither falls nor moves fast; it reaches on to both sides as long as the vehicle stands still and a part of its weight
is carried: rotors that spin up or down on the ground. Free fall is no contact: there nothing carries. Height of the
ground's effect: Cheeseman and Bennett, ARC R&M 3021 (1955), 1/(1 - (R/4z)^2): 0.4 % of thrust at z = 4 R.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wrenchgap.learn.data.phases.phase import Phase, closed, runs
from wrenchgap.learn.data.phases.signals import Flags, Signals, carried, sizes
from wrenchgap.plant.vehicle import Vehicle


@dataclass(frozen=True)
class ContactThresholds:
    """When a vehicle is on the ground or held."""

    carried: float = 0.4
    """Share of the weight that something else carries, from which on contact is certain."""
    rests: float = 0.6
    """Share of the weight that is felt then, at least."""
    touching: float = 0.08
    """Share of the weight that something else carries where the vehicle stands still beside certain contact."""
    still_rate: float = 0.15
    """Slow rate [rad/s] up to which a vehicle stands still."""
    still_force: float = 0.06
    """Distance of the felt force from the weight up to which it does [weights]."""
    quick: float = 1.5
    """Speed [m/s] beyond which nothing stands on the ground: rotors that are driven by the air carry as well."""
    mostly: float = 0.5
    """Share of a contact in which a vehicle stands still that stands on the ground."""
    at_rest: float = 0.4
    """Shortest contact [s] where the vehicle stands still for most of it."""
    held: float = 1.0
    """Shortest contact [s] where it does not."""
    interrupted: float = 0.5
    """Interruptions of contact up to so long [s] are contact."""
    radii: float = 4.0
    """Height above the ground, in rotor radii, from which on it has no effect."""
    least_clearance: float = 0.1
    """The same [m], at least."""
    longest: float = 2.0
    """Longest take-off or landing [s]."""
    blind: float = 1.0
    """Its length [s] where the height is not known."""


CONTACT = ContactThresholds()


def contact(part: Signals, scale: float) -> Flags:
    """Where (N,) the vehicle stands on the ground, lies on it, or is held."""
    if not part.vertical:
        return _idle(part, scale)
    share, felt, still = carried(part, scale), sizes(part.slow_felt), stands(part)
    certain = (share > CONTACT.carried) & (felt > CONTACT.rests)
    if part.speed is not None:
        certain &= part.speed < CONTACT.quick
    for a, b in runs(certain):
        least = CONTACT.at_rest if still[a:b].mean() > CONTACT.mostly else CONTACT.held
        if (b - a) * part.dt < least and a > 0 and b < len(certain):
            certain[a:b] = False
    touching = certain | (still & (share > CONTACT.touching))
    found = np.zeros(len(certain), dtype=bool)
    for a, b in runs(touching):
        found[a:b] = certain[a:b].any()
    return closed(found, part.samples(CONTACT.interrupted))


def stands(part: Signals) -> Flags:
    """Where (N,) the vehicle neither turns nor is accelerated: on the ground, or in a calm hover."""
    felt = sizes(part.slow_felt)
    return np.asarray((part.turning < CONTACT.still_rate) & (np.abs(felt - 1.0) < CONTACT.still_force))


def _idle(part: Signals, scale: float) -> Flags:
    """Where nothing tells the ground but the commands: those that could not carry the vehicle."""
    return np.asarray(scale * sizes(part.slow_pushed) < 1.0 - CONTACT.rests)


def ground(part: Signals, on: Flags, vehicle: Vehicle) -> list[Phase]:
    """Ground, take-offs and landings of a stretch, of the contact (N,) in it."""
    clear = CONTACT.least_clearance
    if vehicle.has_rotors:
        radius = vehicle.geometry()[1].radius
        clear = max(clear, CONTACT.radii * float(np.nan_to_num(radius).max(initial=0.0)))
    still = stands(part)
    out = []
    for a, b in runs(on):
        words = (
            ("ground", "the ground carries it")
            if still[a:b].mean() > CONTACT.mostly
            else ("held", "no rotor carries it")
        )
        out.append(Phase(words[0], float(part.time[a]), float(part.time[b - 1]), words[1]))
        if b < len(on):
            out.append(_way(part, on, b, clear, up=True))
        if a > 0:
            out.append(_way(part, on, a - 1, clear, up=False))
    return [phase for phase in out if phase.stop > phase.start]


def _way(part: Signals, on: Flags, first: int, clear: float, *, up: bool) -> Phase:
    """From contact away: forward in time for a take-off, backward for a landing."""
    step = 1 if up else -1
    reach = part.samples(CONTACT.blind if part.height is None else CONTACT.longest)
    last = first
    while 0 <= last + step < len(on) and abs(last + step - first) < reach and not on[last + step]:
        last += step
        if part.height is not None and abs(part.height[last] - part.height[first]) > clear:
            break
    start, stop = sorted((float(part.time[first]), float(part.time[last])))
    why = f"within {clear:.2g} m of the ground" if part.height is not None else "next to the ground, height unknown"
    return Phase("take-off" if up else "landing", start, stop, why)
