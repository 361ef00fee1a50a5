"""On the ground or held, the way up from it and down to it, and how it is hit.

Contact is certain where something else than the rotors carries `CONTACT.carried` of the weight while the vehicle
neither falls nor moves fast; it reaches on to both sides as long as the vehicle stands still and a part of its weight
is carried: rotors that spin up or down on the ground. Free fall is no contact: there nothing carries. Height of the
ground's effect: Cheeseman and Bennett, ARC R&M 3021 (1955), 1/(1 - (R/4z)^2): 0.4 % of thrust at z = 4 R.

An impact is a spike of the felt force that no rotor makes. It is a crash where the motion contradicts the commands from
then on until the end, or where the vehicle comes to lie; else the vehicle struck something and flew on. Without an
impact, a motion that contradicts the commands by half of the weight and more until the log ends, or until the ground,
is one too. What a wrong model does, or a lost rotor with which the flight goes on, is there throughout, or ends: no
crash.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.flight import Array, Mask
from wrenchgap.flight.row_kernels import lengths, runs
from wrenchgap.learn.data.phases.phase import Phase, Signals, closed, command_scale, sizes
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
    quick: float = 1.0
    """Speed [m/s] beyond which nothing stands on the ground: rotors that are driven by the air carry as well."""
    walking: float = 2.0
    """The same [m/s] while the rotors stand: a vehicle that is carried away."""
    stopped: float = 0.05
    """Commanded force up to which the rotors stand [weights]."""
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


def grounded(seen: Sequence[Signals], clear: float) -> list[Phase]:
    """Contact with the ground, take-offs, landings, impacts and crashes of stretches; `clear` is of `clearance`."""
    found: list[Phase] = []
    if seen:
        scale = command_scale(seen)
        on = [contact(part, scale) for part in seen]
        air = np.concatenate([part.spikes(scale)[~flags] for part, flags in zip(seen, on, strict=True)])
        usual = 0.0 if len(air) == 0 else float(np.percentile(air, 25.0))
        crash: Phase | None = None  # that the end of the stretch before cut off
        for part, flags in zip(seen, on, strict=True):
            lost = crashes(part, flags, scale, usual)
            if crash is not None and not flags[0]:
                landed = int(np.argmax(flags)) if flags.any() else len(flags)
                found.remove(crash)
                crash = replace(crash, stop=float(part.time[_end_of_rest(flags, landed) - 1]))
                lost = [crash, *(p for p in lost if not within(p, [crash]))]
            found += [p for p in ground(part, flags, clear) if not within(p, lost)] + lost
            crash = next((p for p in lost if p.name == "crash" and p.stop >= part.time[-1]), None)
    return found


def within(phase: Phase, others: Sequence[Phase]) -> bool:
    """Whether a phase lies in another one that is left out."""
    return any(o.left_out and o.start <= phase.start and phase.stop <= o.stop for o in others)


def contact(part: Signals, scale: float) -> Mask:
    """Where (N,) the vehicle stands on the ground, lies on it, or is held."""
    if not part.vertical:  # nothing tells the ground but the commands: those that could not carry the vehicle
        return np.asarray(scale * sizes(part.slow_pushed) < 1.0 - CONTACT.rests)
    share, felt, still = part.carried(scale), sizes(part.slow_felt), stands(part)
    certain = (share > CONTACT.carried) & (felt > CONTACT.rests)
    slow = np.ones(len(certain), dtype=bool)
    if part.speed is not None:
        stopped = scale * sizes(part.slow_pushed) < CONTACT.stopped
        slow = part.speed < np.where(stopped, CONTACT.walking, CONTACT.quick)
    certain &= slow
    for a, b in runs(certain):
        least = CONTACT.at_rest if still[a:b].mean() > CONTACT.mostly else CONTACT.held
        if (b - a) * part.dt < least and a > 0 and b < len(certain):
            certain[a:b] = False
    touching = certain | (still & slow & (share > CONTACT.touching))
    found = np.zeros(len(certain), dtype=bool)
    for a, b in runs(touching):
        found[a:b] = certain[a:b].any()
    return closed(found, part.samples(CONTACT.interrupted))


def stands(part: Signals) -> Mask:
    """Where (N,) the vehicle neither turns nor is accelerated: on the ground, or in a calm hover."""
    felt = sizes(part.slow_felt)
    return np.asarray((part.turning < CONTACT.still_rate) & (np.abs(felt - 1.0) < CONTACT.still_force))


def clearance(vehicle: Vehicle) -> float:
    """Height above the ground [m] from which on it has no effect."""
    if not vehicle.has_rotors:
        return CONTACT.least_clearance
    radius = vehicle.geometry()[1].radius
    return max(CONTACT.least_clearance, CONTACT.radii * float(np.nan_to_num(radius).max(initial=0.0)))


def ground(part: Signals, on: Mask, clear: float) -> list[Phase]:
    """Ground, take-offs and landings of a stretch, of the contact (N,) in it; `clear` is that of `clearance`."""
    still = stands(part)
    out = []
    for a, b in runs(on):
        mostly = still[a:b].mean() > CONTACT.mostly
        name, why = ("ground", "the ground carries it") if mostly else ("held", "no rotor carries it")
        out.append(Phase(name, float(part.time[a]), float(part.time[b - 1]), why))
        if b < len(on):
            out.append(_way(part, on, b, clear, up=True))
        if a > 0:
            out.append(_way(part, on, a - 1, clear, up=False))
    return [phase for phase in out if phase.stop > phase.start]


def _way(part: Signals, on: Mask, first: int, clear: float, *, up: bool) -> Phase:
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


@dataclass(frozen=True)
class CrashThresholds:
    """What an impact is, and when control is lost."""

    spike: float = 2.5
    """Felt minus commanded force of an impact, at least [weights]."""
    outstanding: float = 20.0
    """The same, in quartiles of the flight."""
    one_event: float = 0.5
    """Spikes closer than this [s] are one impact."""
    lost: float = 0.5
    """Contradiction of motion and commands from which on control is lost [weights]."""
    lost_times: float = 4.0
    """The same, in medians of the time before it."""
    losing: float = 0.4
    """Share of that, from which on back in time the loss began."""
    briefest: float = 0.5
    """Shortest loss of control [s]."""
    sways: float = 0.4
    """Time [s] for which it may dip below."""
    before: float = 0.1
    """Time before an impact [s] that shows nothing of the vehicle."""
    after: float = 0.4
    """Time after it [s], likewise."""
    sure: float = 1.0
    """Time [s] from the first contradiction to an impact below which none is told: slow signals mix the impact into it,
    and the air of a quick turn that was commanded does the same."""
    bounces: float = 3.0
    """Impacts and contacts with the ground that follow one another within this time [s] up to a crash belong to it."""
    dropped: float = 1.5
    """Time [s] from an impact to the ground in which the two are one event."""
    lying: float = 0.5
    """Vertical share of the felt force below which a vehicle at rest does not stand on its feet."""


CRASH = CrashThresholds()


def crashes(part: Signals, on: Mask, scale: float, usual: float) -> list[Phase]:
    """Impacts and crashes of a stretch with contact `on` (N,); `usual` is the lower quartile of spikes in the air."""
    sudden, doubt = part.spikes(scale), part.contradiction(scale)
    struck = (sudden > max(CRASH.spike, CRASH.outstanding * usual)) & ~on
    struck[: part.samples(CRASH.one_event)] = False  # where filters, and derivatives of an odometry, begin
    out = []
    for a, b in runs(~on):
        lies = _lies(part, on, b)
        begin = _loss(part, doubt, a, b, lies=lies)
        hits = runs(closed(struck[a:b], part.samples(CRASH.one_event)))
        events = [(a + first, a + stop - 1) for first, stop in hits]  # first and last sample of every impact
        ending = [at for at, _ in events if _ends(part, doubt, on, (a, at, b), lies=lies)]
        if ending:
            begin = min(begin, ending[0]) if begin is not None else ending[0]
        if begin is not None:
            stop = float(part.time[_end_of_rest(on, b) - 1])
            event, words = begin, ""
            if ending:
                event, seconds = ending[0], (ending[0] - begin) * part.dt
                began = (
                    f", {seconds:.1f} s after motion began to contradict the commands" if seconds > CRASH.sure else ""
                )
                words = f"an impact{began}, and "
            words += "the vehicle comes to lie" if lies else "motion contradicts the commands until the end"
            out.append(Phase("crash", float(part.time[begin]), stop, words, event=float(part.time[event])))
        for first, last in events:
            hard_landing = b < len(on) and (b - last) * part.dt < CRASH.dropped
            if not hard_landing and (begin is None or first < begin):
                start, stop = float(part.time[first] - CRASH.before), float(part.time[last] + CRASH.after)
                peak = float(sudden[first : last + 1].max())
                why = f"a force of {peak:.1f} weights that no rotor makes"
                out.append(Phase("impact", start, stop, why, event=float(part.time[first])))
    return _joined(out, part, on)


def _joined(found: list[Phase], part: Signals, on: Mask) -> list[Phase]:
    """The same, with the impacts, bounces and stays on the ground right before a crash as a part of it."""
    crash = next((p for p in found if p.name == "crash"), None)
    if crash is None:
        return found
    start, stop = crash.start, max(p.stop for p in found if p.name == "crash")
    landed = [(float(part.time[a]), float(part.time[b - 1])) for a, b in runs(on) if a > 0]
    before = sorted([*((p.start, p.stop) for p in found if p.name == "impact"), *landed], reverse=True)
    for begin, end in before:
        if begin < start and end > start - CRASH.bounces:
            start = begin
    rest = [p for p in found if p.name == "impact" and p.stop < start]
    return [*rest, replace(crash, start=start, stop=stop)]


def _ends(part: Signals, doubt: Array, on: Mask, stay: tuple[int, int, int], *, lies: bool) -> bool:
    """Whether an impact ends a stay in the air: first sample, that of the impact, one past the last."""
    a, at, b = stay
    left = (b - at) * part.dt
    if b < len(on) and left < CRASH.dropped:
        return lies
    after = min(at + part.samples(CRASH.after), b - 1)
    return left < CRASH.after + CRASH.briefest or _contradicts(part, doubt, a, at, after, b)


def _contradicts(part: Signals, doubt: Array, a: int, begin: int, after: int, b: int) -> bool:
    """Whether motion follows commands up to sample `begin` and contradicts them from `after` to `b`."""
    if begin - a < part.samples(CRASH.briefest):
        return False
    return float(np.median(doubt[after:b])) > max(CRASH.lost, CRASH.lost_times * float(np.median(doubt[a:begin])))


def _loss(part: Signals, doubt: Array, a: int, b: int, *, lies: bool) -> int | None:
    """Where the motion begins to contradict the commands until sample `b`, or the last second before a vehicle lies."""
    lost = closed(doubt[a:b] > CRASH.lost, part.samples(CRASH.sways))
    last = [run for run in runs(lost) if a + run[1] >= b - part.samples(CRASH.sways)]
    if last and (last[0][1] - last[0][0]) * part.dt >= CRASH.briefest:
        begin = a + last[0][0]
        while begin > a and doubt[begin - 1] > CRASH.losing * CRASH.lost:
            begin -= 1
        if _contradicts(part, doubt, a, begin, begin, b):
            return begin
    return max(a, b - part.samples(1.0)) if lies else None


def _lies(part: Signals, on: Mask, b: int) -> bool:
    """Whether the vehicle that comes to the ground at sample `b` lies there on its side or back."""
    stop = _end_of_rest(on, b)
    if b >= len(on) or not part.vertical:
        return False
    felt = part.slow_felt[b:stop]
    return bool(np.median(felt[:, 2] / np.maximum(lengths(felt), 1e-9)) < CRASH.lying)


def _end_of_rest(on: Mask, b: int) -> int:
    """One past the last sample of the contact that begins at sample `b`."""
    while b < len(on) and on[b]:
        b += 1
    return b
