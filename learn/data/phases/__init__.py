"""Phases of a flight: which parts of it are no ordinary flight, found from what the log carries, in one place.

    phase       names, and what an analysis leaves out
    signals     commanded and felt force side by side
    ground      contact, take-off, landing, impacts, loss of control

Commands beyond what the rotors can make are found here (`saturations`). Asked in `learn.data.opening`; docs/checks.md
says what is done with them. What a user reads of them, times that are left out, checks, and a log without any flight,
is made here too.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from wrenchgap.flight.check import UNPOWERED, Check, TimeLeftOut
from wrenchgap.flight.flight import Array, Gap, Samples
from wrenchgap.flight.memory import HOURS, empty_on_disk, give_back
from wrenchgap.flight.row_kernels import runs
from wrenchgap.flight.stamps import pieces
from wrenchgap.learn.data.measurement import low_pass
from wrenchgap.learn.data.phases.ground import clearance, grounded, within
from wrenchgap.learn.data.phases.phase import SIGNALS, Phase, closed, signals, sizes, used_samples
from wrenchgap.learn.data.read_options import MINIMUM_FLIGHT, Between, times_outside
from wrenchgap.plant.actuation import nominal_wrench
from wrenchgap.plant.allocation import allocation_of
from wrenchgap.plant.model import Model
from wrenchgap.plant.state import Commands
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import about_com, about_origin


def phases_of(
    parts: Sequence[tuple[Samples, Commands, str]],
    vehicle: Vehicle,
    cutoff_hz: float,
    keep: Sequence[str] = (),
    mostly: float = 0.5,
) -> tuple[Phase, ...]:
    """Phases of a flight, in order of time, of its stretches with their commands (`measurement.commands_of`).

    `keep` are names of phases that are found but not left out; `mostly` is the share of the time in the air beyond
    which saturation is no phase of a flight, but a limit that is too low.
    """
    seen = [signals(samples, commands, vehicle) for samples, commands, _ in parts]
    found = grounded([one for one in seen if one is not None], clearance(vehicle))
    del seen  # hours of signals, which nothing needs below
    limited = [p for one in parts for p in saturations(*one, vehicle, cutoff_hz)]
    limited = [p for p in limited if not within(p, found)]
    flown = sum(used_samples(samples.time, found).sum() * samples.dt for samples, _, _ in parts)
    if sum(p.stop - p.start for p in limited if p.left_out) > mostly * flown:
        why = "for most of the flight: is vehicle.rotor.speed_max too low?"
        limited = [replace(p, why=why, left_out=False) for p in limited]
    every = (replace(p, left_out=False) if p.name in keep else p for p in (*found, *limited))
    return tuple(sorted(every, key=lambda phase: (phase.start, phase.stop)))


def times_left_out(
    flight: str, between: Between, holes: Iterable[Gap], phases: Sequence[Phase], log: Sequence[Samples]
) -> list[TimeLeftOut]:
    """Every time that is not used, with its reason; `holes` are those between the parts that are, `log` is all of it.

    In a hole lie phases, and pieces of flight too short to be of use. What begins or ends with the log is open there.
    """
    first, last = float(log[0].time[0]), float(log[-1].time[-1])
    edge = 0.3  # s, less than which is not worth a word
    told = [TimeLeftOut(flight, gap.start, gap.stop, "not asked for (--between)") for gap in times_outside(between)]

    def tell(start: float, stop: float, hole: Gap, why: str) -> None:
        """Next to an end of the log, a time goes on as the hole does."""
        start, stop = hole.start if start < first + edge else start, hole.stop if stop > last - edge else stop
        told.append(TimeLeftOut(flight, start, stop, why))

    short = f"less than {MINIMUM_FLIGHT:g} s of flight"
    for hole in holes:
        at = max(hole.start, first)
        for phase in phases:
            if not phase.left_out or phase.stop < hole.start or phase.start > hole.stop:
                continue
            if phase.start - at >= edge:
                tell(at, phase.start, hole, short)
            stop = min(phase.stop, hole.stop)
            tell(max(phase.start, hole.start), stop, hole, f"{phase.name}: {phase.why}")
            at = max(at, stop)
        end = min(hole.stop, last)
        if end - at >= edge:
            tell(at, end, hole, short)
    return told


def phase_checks(phases: Sequence[Phase]) -> tuple[Check, ...]:
    """What is worth a warning: crashes and impacts, and limits that a vehicle is at all the time."""
    found = []
    for name in ("crash", "impact"):
        events = [p for p in phases if p.name == name]
        if events:
            first = events[0]
            more = f", and {len(events) - 1} time(s) more" if len(events) > 1 else ""
            kept = " left out" if first.left_out else " kept (--keep)"
            at = first.start if first.event is None else first.event
            spell = f"{first.start:.2f} to {first.stop:.2f} s"
            found.append(Check("crash", "warn", f"{first.title} at {at:.2f} s{more}: {first.why}; {spell}{kept}."))
    limited = [p for p in phases if p.name == "saturation" and (p.left_out or "too low" in p.why)]
    if limited:
        seconds = sum(p.stop - p.start for p in limited)
        kept = "left out" if limited[0].left_out else "kept"
        found.append(Check("saturation", "warn", f"{seconds:.1f} s saturated: {limited[0].why}; {kept}."))
    return tuple(found)


def never_flew(
    name: str, phases: Sequence[Phase], model: Model, notes: Sequence[object] = (), *, of_rotors: bool = False
) -> str:
    """The one line for a log in which nothing of `MINIMUM_FLIGHT` is left; `notes` are those of its reader.

    `of_rotors`: the wrench is that of the logged rotor speeds.
    """
    unpowered = next((str(note) for note in notes if str(note).endswith(UNPOWERED)), None)
    if unpowered is not None:
        return f"{name}: {unpowered.removesuffix('.')}; give another log"
    weight = f"{model.vehicle.body.mass * GRAVITY:.3g} N"
    seconds: dict[str, float] = {}
    for phase in phases:
        if phase.left_out:
            seconds[phase.name] = seconds.get(phase.name, 0.0) + phase.stop - phase.start
    if not seconds:
        return f"{name}: no stretch of {MINIMUM_FLIGHT:g} s of flight in the log"
    listed = ", ".join(f"{which} {length:.1f} s" for which, length in seconds.items())
    most = max(seconds, key=lambda which: seconds[which])
    why = f"{name}: no {MINIMUM_FLIGHT:g} s of flight ({listed})"
    if most in ("ground", "held"):
        unit = "rotor speeds in rad/s" if of_rotors else "wrench in newtons"
        asked = f"is it the model of this vehicle, {unit}?"
        return f"{why}: the rotors never carry {model.vehicle.name}'s weight ({weight}); {asked}"
    return f"{why}; keep a phase with --keep {most}"


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
    """Where rotors are at their limits, from `full` of `speed_max` on (within `joined` [s] one), and what it takes.

    A command at a limit is as good as any, as the model is given the same: shown, not left out. Left out is one that
    asks for more than there is, where the part that is missing behind the analysis' filter, root mean square, is above
    `least_force` [weights] or `least_torque` [weights at the rotors' distance]. `source` is that of `commands_of`.
    Without rotors in the model file there are no limits.
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
