"""Phases of a flight without a model: on the ground, take-off, hover, moving flight, landing, impact, crash.

`learn.data.phases` compares commanded and measured force in shares of the weight. Without a mass the unit of the
command is its size per measured specific force while it is large: in the air the two are in proportion.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import GRAVITY, Array, Flight, Mask, Samples, WrenchSeries, WrenchUnit
from wrenchgap.flight.resample import resample
from wrenchgap.flight.row_kernels import lengths, runs
from wrenchgap.learn.data.checks.bench import stood_still
from wrenchgap.learn.data.measurement import low_pass
from wrenchgap.learn.data.phases.ground import CONTACT, grounded
from wrenchgap.learn.data.phases.phase import SIGNALS, Phase, Signals, closed, signals_of, used_samples
from wrenchgap.learn.health.rotors import Thrusts, is_multirotor


@dataclass(frozen=True)
class HoverThresholds:
    """What counts as hover; all signals behind a low-pass of `SIGNALS.slow_hz`."""

    rate_hz: float = 50.0
    """Clock [Hz] on which phases are found: impacts last some 20 ms."""
    turning: float = 0.35
    """Rate [rad/s] up to which a vehicle hovers: 20 deg/s, a slow turn in yaw."""
    force: float = 0.1
    """Distance of the specific force from g, in shares of g: a thrust that changes the balance of motors by as much."""
    speed: float = 1.0
    """Speed [m/s]: below, the drag of common multirotors is below 0.03 g."""
    tilt: float = 0.26
    """Tilt [rad] where the speed is not known, 15 deg: more is not held without drifting away or a strong wind."""
    level: float = 0.1
    """Tilt [rad] up to which a hover is level, 6 deg: of rotors on arms that tilt, the even shares of thrust change by
    the square of it and by the lateral force, a tenth of the weight; no wind to speak of holds a level hover."""
    large: tuple[float, ...] = (90.0, 75.0, 50.0)
    """Percentiles of the commanded force that tell which commands are large, the first that holds."""
    proportion: float = 0.2
    """Relative distance within which commanded and measured force are in proportion: the error of a thrust curve."""
    mostly: float = 0.5
    """Share of the large commands that are, where they are those of a flight."""
    joined: float = 0.5
    """Interruptions up to so long [s] do not end a hover."""
    briefest: float = 1.0
    """A shorter hover [s] is moving flight."""
    off: float = 0.03
    """Share of the full thrust of all rotors up to which nothing flies: it would carry 33 times its weight. Motors that
    idle have 0.01."""


HOVER = HoverThresholds()
AIRBORNE = ("hover", "moving")
LEVEL = "level hover"


class NoPhases(StrEnum):
    """Why nothing is said of the phases of a flight."""

    COMMANDS = "no topic is read as commands of thrust"
    POWER = "the motors never ran"
    MOTION = "neither an IMU nor an odometry goes with the commands"
    DOUBT = "the log is not what it seems"
    BENCH = "the vehicle stood still while its motors ran"
    VEHICLE = "no multirotor"


@dataclass(frozen=True)
class FlightPhases:
    """Every phase of a flight in order of time; hover and moving flight are named so.

    `lack` says why there is none. Where the speed is not known (`speed_known`), steady flight counts as hover. `level`
    are the parts of hover in which the vehicle stands level, by its attitude or, without one, by the specific force,
    which points up where nothing accelerates.
    """

    phases: tuple[Phase, ...] = ()
    lack: NoPhases | None = None
    speed_known: bool = False
    level: tuple[Phase, ...] = ()

    def seconds(self, *names: str) -> float:
        """Time [s] in the phases of these names."""
        return float(sum(p.stop - p.start for p in self.phases if p.name in names))

    def until(self, time: float) -> "FlightPhases":
        """What of them was before a time [s]."""
        parts = [
            tuple(replace(p, stop=min(p.stop, time)) for p in phases if p.start < time)
            for phases in (self.phases, self.level)
        ]
        return replace(self, phases=parts[0], level=parts[1])

    def within(self, time: Array, *names: str) -> Mask:
        """Which of the times (N,) [s] lie in phases of these names."""
        inside = np.zeros(len(time), dtype=bool)
        for phase in self.phases:
            if phase.name in names:
                inside |= (time >= phase.start) & (time <= phase.stop)
        return inside

    def named(self, *names: str) -> tuple[Phase, ...]:
        """The phases of these names."""
        return tuple(p for p in self.phases if p.name in names)


SPEAKS_OF_OTHERS = ("roles", "clipped", "velocity", "odometry-scale", "odometry-rate")
"""Bad checks that leave the forces, of which phases are made, as they are."""


def doubtful(flight: Flight) -> bool:
    """Whether a check calls the log bad in what phases are made of: a wrong unit looks like a crash."""
    return any(c.stops and c.name not in SPEAKS_OF_OTHERS for c in flight.checks or ())


def phases_of(flight: Flight, thrusts: Thrusts | None, by_model: Sequence[Phase] | None = None) -> FlightPhases:
    """The phases of a flight; `by_model` are those on the ground and of crashes where a model told them."""
    if doubtful(flight):
        return FlightPhases(lack=NoPhases.DOUBT)
    if not is_multirotor(flight.autopilot):
        return FlightPhases(lack=NoPhases.VEHICLE)
    force = _commanded_force(flight, thrusts)
    if force is None:
        return FlightPhases(lack=NoPhases.COMMANDS)
    if not (lengths(force.wrench_B[:, :3]) > (HOVER.off if force.unit == "normalised" else 0.0)).any():
        return FlightPhases(lack=NoPhases.POWER)
    played = replace(flight, commanded=force, actuators=None, desired=None, reference=None, battery=None)
    try:
        stretches = resample(played, HOVER.rate_hz, ("commanded",) if flight.imu is None else ("commanded", "imu"))
    except LogError:
        return FlightPhases(lack=NoPhases.MOTION)
    long = [samples for samples in stretches.samples if len(samples) >= SIGNALS.fewest]
    unit = _unit(long)
    if unit is None:
        return FlightPhases(lack=NoPhases.MOTION)
    turned, pushed, felt = (
        np.concatenate([_slow(get(s), s.dt) for s in long])
        for get in (lambda s: s.omega_B, _force, lambda s: s.specific_force_B)
    )
    if stood_still(turned, pushed, felt, long):
        return FlightPhases(lack=NoPhases.BENCH)
    forces = [(s, _force(s) / unit, np.nan_to_num(s.specific_force_B) / GRAVITY) for s in long]
    known = [(s, signals_of(s, pushed, felt, np.nan_to_num(s.omega_B))) for s, pushed, felt in forces]
    if by_model is None:
        found = grounded([signals for _, signals in known], CONTACT.least_clearance)
    else:
        found = [replace(phase, left_out=True) for phase in by_model if phase.name != "saturation"]
    airborne = [phase for samples, signals in known for phase in _in_the_air(samples, signals, found)]
    level = tuple(phase for phase in airborne if phase.name == LEVEL)
    every = tuple(sorted([*found, *(p for p in airborne if p not in level)], key=lambda p: (p.start, p.stop)))
    return FlightPhases(every, speed_known=all(signals.speed is not None for _, signals in known), level=level)


def _commanded_force(flight: Flight, thrusts: Thrusts | None) -> WrenchSeries | None:
    """A commanded force in any unit: the logged one in newtons, else the thrust of all rotors, along z."""
    sent = flight.commanded
    if thrusts is None or (sent is not None and sent.unit == "N"):
        return sent
    assert flight.actuators is not None
    force = np.zeros((len(thrusts.time), 6))
    force[:, 2] = thrusts.share.mean(axis=1)
    unit: WrenchUnit = "N" if thrusts.limits is None else "normalised"
    return WrenchSeries(flight.actuators.topic, thrusts.time, force, gaps=flight.actuators.gaps, unit=unit)


def _force(samples: Samples) -> Array:
    """Commanded force (N, 3) in its own unit."""
    assert samples.wrench_cmd_B is not None
    return samples.wrench_cmd_B[:, :3]


def _unit(stretches: Sequence[Samples]) -> float | None:
    """The commanded force that carries the weight: per measured one, while it is large; None where none ever is.

    In flight the two are in proportion. Where the largest commands are those of a loss of control, most of them are
    not, and large is what is large without them.
    """
    pushed = np.concatenate([lengths(_slow(_force(s), s.dt)) for s in stretches] or [np.zeros(0)])
    felt = np.concatenate([lengths(_slow(s.specific_force_B, s.dt)) for s in stretches] or [np.zeros(0)]) / GRAVITY
    if not len(pushed) or not np.isfinite(pushed).all():
        return None
    found = []
    for high in np.percentile(pushed, HOVER.large):
        known = (pushed > SIGNALS.pushing * high) & np.isfinite(felt) & (felt > SIGNALS.scales[0])
        if known.any() and (unit := float(np.median(ratio := pushed[known] / felt[known]))) > 0.0:
            found.append(unit)
            if np.mean(np.abs(np.log(ratio / unit)) < np.log1p(HOVER.proportion)) > HOVER.mostly:
                return unit
    return found[0] if found else None


def _slow(force: Array, dt: float) -> Array:
    """Forces (N, 3) as phases are found of them."""
    return low_pass(np.nan_to_num(force), dt, min(SIGNALS.slow_hz, SIGNALS.of_nyquist / dt))


def _in_the_air(samples: Samples, signals: Signals, others: Sequence[Phase]) -> list[Phase]:
    """Hover, what of it is level, and moving flight, in what of a stretch is in no other phase."""
    free = used_samples(samples.time, others)
    up = signals.slow_felt / np.maximum(lengths(signals.slow_felt), 1e-9)[:, None]
    if samples.quat_EB is not None:
        up = so3.rotate_inverse(samples.quat_EB, np.tile([0.0, 0.0, 1.0], (len(samples), 1)))
    upright = up[:, 2]  # cosine of the tilt
    still = (signals.turning < HOVER.turning) & (np.abs(lengths(signals.slow_felt) - 1.0) < HOVER.force)
    if signals.speed is not None:
        still &= signals.speed < HOVER.speed
    elif samples.quat_EB is not None:
        still &= upright > np.cos(HOVER.tilt)
    hover = closed(still & free, signals.samples(HOVER.joined)) & free
    for a, b in runs(hover):
        hover[a:b] = (b - a) * signals.dt >= HOVER.briefest
    return [
        Phase(name, float(samples.time[a]), float(samples.time[b - 1]), why, left_out=False)
        for name, flags, why in (
            ("hover", hover, "neither turns, moves nor is accelerated"),
            (LEVEL, hover & (upright > np.cos(HOVER.level)), "a hover that is level"),
            ("moving", free & ~hover, "in the air, and no hover"),
        )
        for a, b in runs(flags)
        if b - a > 1
    ]
