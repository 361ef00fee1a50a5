"""Whether a vehicle keeps its authority, and its margins, on a flight that it has not flown yet.

From the model with its fitted effects, the standard deviations of their values, and the flights at hand:

draws       values of the effects, drawn within their standard deviations; wind from a direction of chance
disturbance what the model leaves of the wrench of these flights, as a process drawn anew each time: one flight shows
            a slow gust once (`learn.diagnose.disturbance_process`)
demand      commands that make the trajectory's motion against it (`plant.demand`)
authority   in which share of the draws a rotor, or an arm, never needs more than `ROOM` of what it has
margins     of the attitude loops with the gains of the model file or the autopilot's parameters, where these flew:
            nominal, and as drawn, with the lags, the delays, the inertia and the effectiveness of the rotors

What the flights could not show is not in the draws: where the trajectory goes beyond them, that is said. Probabilities
are never nearer to one than those of `explain`: no catalogue of effects is complete.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from wrenchgap.flight.arguments import Progress, check_arguments, silent
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array, Mask
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.comparison import Range
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.data.opening import Flights, OpenFlight, listed
from wrenchgap.learn.data.prediction import predict
from wrenchgap.learn.diagnose.disturbance_process import Left, disturbance_process
from wrenchgap.learn.identify.add import Addition, model_of
from wrenchgap.learn.identify.contradiction import Contradiction, as_flown
from wrenchgap.learn.posterior.settings import DEFAULT
from wrenchgap.plant import Model, Vehicle
from wrenchgap.plant.controller import pushes_along_z_only
from wrenchgap.plant.demand import Demand, demand
from wrenchgap.plant.effect_values import WeakRotor, drawn, in_wind, weakened_rotors, with_drawn_inertia, with_load
from wrenchgap.plant.simulation.flight_plan import Plan, designed_for, prepare
from wrenchgap.plant.trajectory.reference import Reference, check_sampled
from wrenchgap.plant.trajectory.shapes import Flat
from wrenchgap.plant.wrench_model import WrenchModel, about_origin
from wrenchgap.replay.loop_margins import GO, WITHIN, Gains, LoopMargins, flown_loops

DRAWS = 200
"""Of the model and the disturbance: a probability of 0.9 is known to 0.02."""
PERIOD = 0.02
"""Of the samples along the trajectory [s]: four to a period of the filter's corner."""
SHORTEST, LONGEST = 1.0, 600.0
"""Of a trajectory [s]: in less nothing moves; 30,000 samples in 200 draws take half a minute and 0.5 GB."""
ROOM = 0.9
"""Share of what a part has that may be needed: the rest is for the controller, whose overshoot is not in the demand."""
NO_GO = 0.5
"""Probability of the weakest part below which a flight is none."""


class Decision(StrEnum):
    """What is said of the flight."""

    GO = "go"
    CARE = "go with care"
    NO_GO = "no go"


@dataclass(frozen=True)
class Authority:
    """Of one `part` and what of it is `used`: the most that it needs, as a share of what it has: 5th, 50th and 95th
    percentile (3,), nominal, and the `probability` that it is `ROOM` at most.
    """  # noqa: D205

    part: str
    used: str
    needs: Array
    nominal: float
    probability: float


@dataclass(frozen=True)
class Uncertain:
    """A value of an effect, by name, and the share of the scatter of the weakest part's need that goes with it."""

    effect: str
    parameter: str
    value: float
    std: float
    share: float


@dataclass(frozen=True, repr=False)
class Readiness(Result):
    """Whether to fly `trajectory` of `duration` [s] with a `payload` [kg], in a `wind` [m/s], at a `voltage` [V].

    `authority` is the weakest first; `loops` are those about the axes on which known `gains` flew. `beyond` are
    quantities in which the trajectory goes further than the flights; `first` is what to check on the bench, that on
    which most depends first. A model that does not feel wind (`feels_wind`) has no drag, one that does not feel the
    voltage (`feels_voltage`) the same thrust at any. `known` says whether any value has a standard deviation: else
    nothing says how wrong the model may be. In a share `below` of the draws a rotor would have to push less than it
    can: there no part has its authority. `designed_for` is the vehicle of a file of `design`. `analysed` [s] of flight
    were at hand; with what so much does not show of a constant disturbance goes the share `unseen` of the scatter of
    what the weakest part needs. After flights that `crashed`, or lost control, it is no go until the vehicle is sound;
    with rotors that the model says are `weakened` it is with care. Where flights show that it is late, or that rotors
    are weaker (`contradicted`), the numbers are those of the flights, and it is no plain go.
    """

    decision: Decision
    vehicle: Vehicle
    trajectory: str
    duration: float
    payload: float
    wind: float
    feels_wind: bool
    voltage: float | None
    feels_voltage: bool
    flights: tuple[str, ...]
    authority: tuple[Authority, ...]
    loops: tuple[LoopMargins, ...]
    gains: Gains
    beyond: tuple[Range, ...]
    first: tuple[Uncertain, ...]
    known: bool
    below: float
    analysed: float
    unseen: float
    crashed: tuple[str, ...] = ()
    weakened: tuple[WeakRotor, ...] = ()
    contradicted: tuple[Contradiction, ...] = ()
    designed_for: str = ""
    notes: tuple[object, ...] = ()


@check_arguments
def ready(
    flights: Flights,
    model: Model | Addition,
    trajectory: str,
    *,
    duration: float | None = None,
    payload: float = 0.0,
    wind: float = 0.0,
    voltage: float | None = None,
    progress: Progress | None = None,
) -> Readiness:
    """Whether a vehicle keeps its authority and its margins on a flight that it has not flown yet.

    Parameters
    ----------
    flights
        Opened for `model`; what it leaves of them acts on the flight to come.
    model
        With rotors, and effects as they were fitted, with standard deviations.
    trajectory
        A name, or a file of `design`; `duration` [s] is by default its own.
    payload, wind, voltage
        More mass [kg] at the centre of mass; a steady wind [m/s] from any side; the battery's voltage [V], by default
        the lowest that was logged.

    Returns
    -------
    Readiness
        The decision; of each rotor and arm the share of what it has, and with what probability that is enough; margins
        of the attitude loops.

    Raises
    ------
    ModelError
        For a model without rotors.
    UsageError
        For an unknown trajectory, and conditions that no vehicle flies in.
    """
    # Long because a `Readiness` has as many fields, one a line.
    flights, given = listed(flights, "ready"), model_of(model)
    model, contradicted = as_flown(flights, given)
    _check_conditions(payload, wind, voltage)
    plan = Plan(model, trajectory, duration)
    _, _, path = prepare(plan, min_duration=SHORTEST, max_duration=LONGEST)
    reference = (Flat(path) if pushes_along_z_only(model.vehicle) else path).at(np.arange(0.0, path.duration, PERIOD))
    check_sampled(reference, trajectory)
    volts, depends = _voltage(flights, model, voltage)
    state, motion = reference.followed(volts)
    loaded, rng = with_load(model, payload), np.random.default_rng(0)
    report = progress or silent
    report(0.1, "what these flights leave")
    records = [r for f in flights for r in f.records]
    process = disturbance_process([_left(r, model) for r in records])
    models = [in_wind(with_drawn_inertia(drawn(loaded, rng), rng), wind, rng) for _ in range(DRAWS)]
    disturbances, constants = process.draws(DRAWS, len(state.time), PERIOD, rng)
    report(0.3, "flying it")
    needed = demand(models, state, motion, PERIOD, disturbances)
    plain = demand([with_load(replace(model, effects=()), payload)], state, motion, PERIOD, 0.0 * disturbances[:1])
    authority, worst = _authorities(model, needed, plain, volts)
    margins = loops, gains = flown_loops(model, models, flights, volts)
    force = loaded.body.mass * np.linalg.norm(motion.specific_force_B, axis=1)
    beyond = _beyond(records, reference, wind, force)
    known = any(e.std is not None and np.any(e.std > 0.0) for e in given.effects)
    weakened = weakened_rotors(given.effects)
    feels_wind = any(e.effect.aerodynamic for e in model.effects)
    plain_go = (
        not (beyond or weakened or contradicted or (wind > 0.0 and not feels_wind)) and known and not gains.upper_bounds
    )
    crashed = tuple(f.flight.name for f in flights if any(c.name == "crash" for c in f.checks))
    return Readiness(
        Decision.NO_GO if crashed else _decision(authority, loops, plain_go=plain_go),
        model.vehicle,
        trajectory,
        float(path.duration),
        payload,
        wind,
        feels_wind,
        volts,
        depends,
        tuple(f.records[0].flight for f in flights),
        authority,
        *margins,
        beyond,
        _first(models, worst),
        known,
        1.0 - float(np.mean(_pushes(model, needed))),
        float(sum(len(r) * r.dt_kept for r in records)),
        _explained(worst, constants),
        crashed,
        weakened,
        contradicted,
        designed_for(plan),
        tuple(dict.fromkeys((*model.notes, *(n for f in flights for n in f.notes)))),
    )


def _check_conditions(payload: float, wind: float, voltage: float | None) -> None:
    ranges = (("--payload", payload, 0.0, 1e4), ("--wind", wind, 0.0, 50.0), ("--voltage", voltage, 1.0, 1e3))
    for name, value, least, most in ranges:
        if value is not None and not least <= value <= most:
            raise UsageError(f"{name} {value:g}: expected {least:g} to {most:g}")


def _voltage(flights: Sequence[OpenFlight], model: Model, given: float | None) -> tuple[float | None, bool]:
    """The voltage [V] of the flight to come, by default the lowest of these but for a twentieth of their time; and
    whether the model depends on it. Raises UsageError where it does and none is known, and for that of a single cell.
    """  # noqa: D205
    nominal = None if model.command is None or model.command.voltage is None else model.command.voltage[0]
    if given is not None and nominal is not None and not 0.5 <= given / nominal <= 2.0:
        words = f"that of the whole battery, {0.5 * nominal:.3g} to {2.0 * nominal:.3g}"
        raise UsageError(f"--voltage {given:g}: {model.name} is for a battery of {nominal:g} V; expected {words}")
    depends = [e.name for e in model.effects if e.effect.needs_voltage]
    depends += ["thrust"] if model.command is not None and model.command.uses_voltage else []
    if given is not None or not depends:
        return given, bool(depends)
    logged = [s.voltage for f in flights for s in f.flown if s.voltage is not None]
    if not logged:
        raise UsageError(f"{depends[0]} depends on the battery's voltage, and no log has it; give one with --voltage")
    return float(np.percentile(np.concatenate(logged), 5.0)), True


def _left(record: Record, model: Model) -> Left:
    """What a model leaves of the measured wrench."""
    left = about_origin(model.vehicle.body, np.nan_to_num(record.measured - predict(record, model.wrench_model)))
    return Left(left, record.dt_kept, record.noise)


def _authorities(
    model: Model, needed: Demand, plain: Demand, voltage: float | None
) -> tuple[tuple[Authority, ...], Array]:
    """Of every rotor, up to full command at this voltage, and arm, the weakest first; and what of the weakest each draw
    needs (D,).
    """  # noqa: D205
    arms, rotors = model.vehicle.geometry()
    full = rotors.speed_max if model.command is None else model.command.full_speed(voltage, model.vehicle)
    of_full, pushes = (rotors.speed_max / full) ** 2, _pushes(model, needed)
    bounded = np.maximum(arms.tilt_max, -arms.tilt_min) < 1e4  # rad: a model without stops has 1e9 degrees
    found: list[tuple[Authority, Array]] = []

    def add(part: str, used: str, most: Array, nominal: float, enough: Mask) -> None:
        probability = min(float(np.mean(enough & pushes)), DEFAULT.certain)
        found.append((Authority(part, used, np.percentile(most, WITHIN), nominal, probability), most))

    for r in range(len(rotors)):
        most, nominal = of_full[r] * needed.thrust[:, r], float(of_full[r] * plain.thrust[0, r])
        add(model.vehicle.rotor_name(r), "thrust", most, nominal, most <= ROOM)
    for a in np.flatnonzero(arms.tilts):
        for used, share, nominally, on in (
            ("tilt", needed.tilt, plain.tilt, bounded[a]),
            ("tilt rate", needed.tilt_rate, plain.tilt_rate, arms.tilt_rate_max[a] < 1e4),
        ):
            if on:
                add(model.vehicle.arm_name(int(a)), used, share[:, a], float(nominally[0, a]), share[:, a] <= ROOM)
    found.sort(key=lambda pair: (pair[0].probability, -pair[0].needs[1]))
    return tuple(one for one, _ in found), found[0][1]


def _pushes(model: Model, needed: Demand) -> Mask:
    """In which draws (D,) no rotor has to push less than it can."""
    _, rotors = model.vehicle.geometry()
    least = (rotors.speed_min / rotors.speed_max) ** 2
    return np.asarray(needed.reached & np.all(needed.least >= least, axis=1))


def _beyond(records: Sequence[Record], reference: Reference, wind: float, force: Array) -> tuple[Range, ...]:
    """Quantities in which a trajectory, with the `force` (N,) [N] that it takes, leaves what these flights did."""
    posed = all(r.has_pose for r in records)
    pairs: tuple[tuple[str, str, bool, Callable[[Record], Array], Array], ...] = (
        ("speed", "m/s", posed, lambda r: r.state_kept.velocity_E, wind + np.linalg.norm(reference.velocity_E, axis=1)),
        ("body rate", "rad/s", True, lambda r: r.state_kept.omega_B, np.linalg.norm(reference.omega_D, axis=1)),
        ("commanded force", "N", True, lambda r: r.commanded[:, :3], force),
    )
    found = [
        Range(name, unit, max(float(np.linalg.norm(flown(r), axis=1).max()) for r in records), float(asked.max()))
        for name, unit, known, flown, asked in pairs
        if known
    ]
    return tuple(one for one in found if one.outside)


def _decision(authority: Sequence[Authority], loops: Sequence[LoopMargins], *, plain_go: bool) -> Decision:
    """A loop that keeps less than its margins is flown with care; one that loses half of them may be lost in a gust."""
    parts = [one.probability for one in authority]
    if min((*parts, *(one.half for one in loops))) < NO_GO:
        return Decision.NO_GO
    enough = min((*parts, *(one.probability for one in loops))) >= GO
    return Decision.GO if enough and plain_go else Decision.CARE


def _explained(worst: Array, drawn_with: Array) -> float:
    """Share of the scatter of what each draw needs (D,) that goes linearly with what was drawn (D, P)."""
    needs, off = worst - worst.mean(), drawn_with - drawn_with.mean(axis=0)
    if not needs.any():
        return 0.0
    rest = needs - off @ np.linalg.lstsq(off, needs, rcond=1e-9)[0]
    return float(1.0 - (rest @ rest) / (needs @ needs))


def _first(models: Sequence[WrenchModel], worst: Array, least: float = 0.1) -> tuple[Uncertain, ...]:
    """Values with which more than a tenth of the scatter of what the weakest part needs goes, the largest first."""
    found = []
    for k, one in enumerate(models[0].effects):
        if one.std is None or one.name == "wind":
            continue
        theta = np.array([m.effects[k].theta for m in models])
        for p, parameter in enumerate(one.effect.parameters(models[0].vehicle)):
            spread = float(theta[:, p].std() * worst.std())
            share = float(np.cov(theta[:, p], worst)[0, 1] / spread) ** 2 if spread > 0.0 else 0.0
            if share > least:
                value, std = float(np.mean(theta[:, p])), float(np.std(theta[:, p]))
                found.append(Uncertain(one.name, parameter.name, value, std, share))
    return tuple(sorted(found, key=lambda u: -u.share))
