"""Parameters flight by flight: each flight fitted by itself, and what each parameter did over the flights.

A flight is fitted without the trims that `add` grants flights which differ (`learn.identify.bias_and_trim`): what
differs is looked for. On axes where the commands of any flight answer the motion, what such answers could explain is
left out of all of them, so that every flight is fitted alike. Steps and drifts: `learn.identify.steps_and_drift`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import pairwise, product

import numpy as np

from wrenchgap.flight.arguments import Progress, silent
from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.flight.repeats import signature
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.candidates import Lack, Untried, inapplicable
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.errors import rms
from wrenchgap.learn.data.one_vehicle import refuse_other_vehicle
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.timing import timing_of, unfollowed_axes
from wrenchgap.learn.identify.fit import fit
from wrenchgap.learn.identify.least_squares import MISFIT
from wrenchgap.learn.identify.moved_centre import MovedCentre, all_alike, moved_centre
from wrenchgap.learn.identify.steps_and_drift import Course, Verdict, course
from wrenchgap.plant.effects import Parameter, find, require_force
from wrenchgap.plant.model import Model

TRIMS = ("thrust_scale", "com_offset")
"""What is fitted where neither the user nor the model names an effect: what every repair moves."""
PARTS = (
    "rotor_thrust",
    "drag_torque_by_rotor",
    "motor_lag_by_rotor",
    "tilt_offset",
    "servo_lag_by_arm",
    "backlash_by_arm",
)
"""What is fitted for the health of parts: thrust, drag torque and lag of each rotor; zero, lag and play of each arm."""
DATED = 10**18
"""September 2001 [ns]: stamps below count from the start of a computer, or of a clock that was never set."""
ROTORS = ("rotor_thrust",)
"""What is fitted instead on rotors that do not tilt: their thrusts make all that `TRIMS` could, and yaw besides."""


@dataclass(frozen=True)
class LeftOut:
    """An effect that was not fitted because a flight lacks what it needs."""

    flight: str
    reason: Untried


@dataclass(frozen=True)
class ParameterTrend:
    """One parameter over n flights: `values` (n,) and their standard deviations `std` (n,), in `unit`.

    `errors` (n,) are those of each flight by itself, without what the law may be off by, which is the same on all
    flights. `at_limit` are the flights (indices) on which the value ended at the limit of what is plausible.
    """

    effect: str
    name: str
    unit: str
    values: Array
    std: Array
    errors: Array
    course: Course
    at_limit: tuple[int, ...]


@dataclass(frozen=True)
class FollowedFlight:
    """One of the flights: the log without its samples, its notes, its sensor noise (6,) [N, Nm] and the filter [Hz];
    `signature` is what it is known again by (`flight.repeats.signature`), `span` from when to when it flew [ns].
    """  # noqa: D205

    flight: Flight
    notes: tuple[object, ...]
    noise: Array
    cutoff_hz: float
    signature: tuple[int, ...] = ()
    span: tuple[int, int] = (0, 0)


@dataclass(frozen=True)
class FlightValues:
    """What one flight says by itself: `effects`, and their parameters `theta` (P,) one effect after the other.

    Standard deviations `std` (P,), names "effect.parameter" that ended at a limit, rms (6,) [N, Nm] of the residual.
    """

    effects: tuple[str, ...]
    theta: Array
    std: Array
    at_bound: tuple[str, ...]
    left: Array


@dataclass(frozen=True, repr=False)
class Trend(Result):
    """Parameters over flights, in the order given; `left_out` are effects that were not fitted, and why.

    `left` (n, 6) [N, Nm] is the rms of the residual of each flight with its own values. `notes` say how flights were
    chosen and ordered, where nobody gave an order.
    """

    model: Model
    effects: tuple[str, ...]
    flights: tuple[FollowedFlight, ...]
    parameters: tuple[ParameterTrend, ...]
    left: Array
    left_out: tuple[LeftOut, ...]
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Of the flights."""
        return tuple(f.flight.name for f in self.flights)

    @property
    def rotors(self) -> tuple[ParameterTrend, ...]:
        """The thrusts of single rotors that changed, the most significant first."""
        return tuple(p for p in (*self.changed, *self.scattered) if p.effect in ROTORS)

    @property
    def thrusts(self) -> Array:
        """Of the rotors (n, R), relative to the model's."""
        return np.array([p.values for p in self.parameters if p.effect in ROTORS]).reshape(-1, len(self.flights)).T

    @property
    def all_rotors(self) -> bool:
        """Whether what the thrusts of several rotors change by is common to all."""
        return len(self.rotors) > 1 and all_alike(self.thrusts)

    @property
    def moved_centre(self) -> MovedCentre | None:
        """What makes thrusts of several rotors that do not tilt change together; None where it does not."""
        if len(self.rotors) < 2 or self.model.vehicle.geometry()[0].tilts.any():
            return None
        return moved_centre(self.thrusts, self.model.vehicle)

    @property
    def by_part(self) -> bool:
        """Whether it is the health of parts that was followed."""
        return set(self.effects) <= set(PARTS) and len(self.effects) > 1

    @property
    def dates(self) -> tuple[str, ...]:
        """Of the flights, UTC; "" where a log has none."""
        stamps = [f.flight.start_ns for f in self.flights]
        return tuple(f"{datetime.fromtimestamp(ns / 1e9, UTC):%Y-%m-%d}" if ns > DATED else "" for ns in stamps)

    @property
    def at_once(self) -> tuple[int, int] | None:
        """Two flights that flew at the same time, by the calendars of their clocks: one flight in two logs. Those that
        begin with the very same stamp are a simulator's.
        """  # noqa: D205
        unlike = list({one.span[0]: k for k, one in enumerate(self.flights)}.values())
        pair = at_once([self.flights[k].span for k in unlike]) if all(self.dates) else None
        return None if pair is None else (unlike[pair[0]], unlike[pair[1]])

    @property
    def changed(self) -> tuple[ParameterTrend, ...]:
        """Parameters with a step or a drift, the most significant first."""
        found = [p for p in self.parameters if p.course.verdict in (Verdict.STEPS, Verdict.DRIFT)]
        return tuple(sorted(found, key=lambda p: _least(p.course)))

    @property
    def scattered(self) -> tuple[ParameterTrend, ...]:
        """Parameters that differ between flights and neither step nor drift, the most over their errors first."""
        found = [p for p in self.parameters if p.course.verdict is Verdict.SCATTERED]
        return tuple(sorted(found, key=lambda p: -p.course.scatter / max(float(np.median(p.errors)), 1e-300)))


def _least(course: Course) -> float:
    """The smallest probability of its steps or its drift."""
    return min([step.p for step in course.steps] + ([course.drift.p] if course.drift else []), default=1.0)


def trend(
    flights: Sequence[OpenFlight],
    model: Model,
    names: Sequence[str] = (),
    *,
    parts: bool = False,
    progress: Progress | None = None,
) -> Trend:
    """Fit `names` (else the effects of the model, `ROTORS` or `TRIMS`) to each flight and follow every parameter.

    With `parts` those of `PARTS` that the vehicle has, and the flights in order of date where all logs have one and no
    two overlap.

    On axes on which the motion does not plainly follow the commands, what answers to it could make is left out. Other
    effects of the model stay as they are; those that a flight does not allow are left out of all. Raises LogError for a
    flight of another vehicle, UsageError for fewer than two flights, or where none of the default effects can be
    fitted; FitError for a named effect that a flight does not allow.
    """
    if len(flights) < 2:
        raise UsageError(f"trend: got {len(flights)} flight, expected two or more, as they were flown")
    if parts and names:
        raise UsageError("--parts: says itself what is fitted, of each rotor, servo and arm; leave out --fit")
    for k, one in enumerate(flights[1:], 1):
        refuse_other_vehicle(one, flights[: min(k, 5)], "the first of them", model)
    if parts and (order := by_date([_span(one) for one in flights])) is not None:
        flights = [flights[k] for k in order]
    report = progress or silent
    choices = [_effects(flights, model, names, parts=parts)]
    if choices[0][0] == TRIMS and not names and all(_allows(one, model, ROTORS) for one in flights):
        choices.append(_effects(flights, model, ROTORS))
    answering = unfollowed_axes([timing_of(one, model) for one in flights])
    fits: list[list[FlightValues]] = [[] for _ in choices]
    for k, one in enumerate(flights):
        report(k / len(flights), f"fitting {one.records[0].flight}")
        for (chosen, alike, _), values in zip(choices, fits, strict=True):
            values.append(_values(one, alike, chosen, answering))
    best = len(choices) - 1 if _leaves_less(fits[-1], fits[0]) else 0
    return trend_of([followed_flight(one) for one in flights], fits[best], model, choices[best][2])


def _leaves_less(fits: Sequence[FlightValues], others: Sequence[FlightValues], clear: float = 10.0) -> bool:
    """Whether effects leave less than others in all, and on some flight clearly so.

    By the ratio of error energies, multiplied over the axes: twelve thrusts instead of four trims make 3 at most of
    sound flights, and 50 to 1000 of one of six seconds with a rotor that is 15 % weak.
    """
    energy, theirs = (np.array([one.left for one in each]) ** 2 for each in (fits, others))
    gain = np.where(energy > 0.0, np.log(np.maximum(theirs, 1e-30) / np.maximum(energy, 1e-30)), 0.0).sum(axis=1)
    return bool(gain.sum() > 0.0 and gain.max() > np.log(clear))


def at_once(spans: Sequence[tuple[int, int]]) -> tuple[int, int] | None:
    """Two of these flights, from and to [ns], that overlap; None where all are apart."""
    order = sorted(range(len(spans)), key=lambda k: spans[k])
    return next(((a, b) for a, b in pairwise(order) if spans[b][0] < spans[a][1]), None)


def by_date(spans: Sequence[tuple[int, int]]) -> list[int] | None:
    """The order of these flights, from and to [ns], by date; None where stamps are no dates: of no era, or of flights
    at the same time.
    """  # noqa: D205
    if at_once(spans) is not None or any(start <= DATED for start, _ in spans):
        return None
    return sorted(range(len(spans)), key=lambda k: spans[k])


def _span(one: OpenFlight) -> tuple[int, int]:
    start = one.flight.start_ns
    return start, start + int(1e9 * one.records[-1].time[-1])


def trend_of(
    flights: Sequence[FollowedFlight], fits: Sequence[FlightValues], model: Model, left_out: Sequence[LeftOut] = ()
) -> Trend:
    """The trend of flights that were fitted one by one, all with the same effects."""
    left = np.array([found.left for found in fits])
    left[:, ~np.isfinite(np.sum([one.noise for one in flights], axis=0))] = np.nan
    return Trend(model, fits[0].effects, tuple(flights), _followed(fits, model), left, tuple(left_out))


def flight_values(flight: OpenFlight, model: Model, names: Sequence[str] = ()) -> FlightValues:
    """What `trend` asks of each of its flights, of one flight: what answers the motion is seen to by its own commands.

    Raises as `trend`.
    """
    chosen, alike, _ = _effects([flight], model, names)
    return _values(flight, alike, chosen, unfollowed_axes([timing_of(flight, model)]))


def _values(one: OpenFlight, model: Model, names: tuple[str, ...], answering: Sequence[int]) -> FlightValues:
    try:
        found = fit(dataset(one.records, model, answering), model, names)
    except FitError as error:
        raise FitError(f"{one.records[0].flight}: {error}") from None
    std = np.sqrt(found.std**2 - found.dependence)  # gusts that outlast a block are in the scatter of the flights
    return FlightValues(names, found.theta, std, found.at_bound, rms(found.residual))


def followed_flight(one: OpenFlight) -> FollowedFlight:
    """A flight without its samples."""
    whole = one.flight
    about = one.records[0].flight, whole.path, whole.content_hash, whole.start_ns
    bare = Flight(*about, autopilot=whole.autopilot)
    noise = np.asarray(np.sum([r.noise for r in one.records], axis=0))
    samples = tuple(signature(whole).tolist())
    return FollowedFlight(bare, one.notes, noise, one.records[0].cutoff_hz, samples, _span(one))


def _effects(
    flights: Sequence[OpenFlight], model: Model, names: Sequence[str], *, parts: bool = False
) -> tuple[tuple[str, ...], Model, tuple[LeftOut, ...]]:
    """What is fitted on all flights, and beside what other effects of the model.

    Last, what nobody named and a flight does not allow, of the model, of `ROTORS` or of `TRIMS`.
    """
    asked, own = tuple(dict.fromkeys(find(name).name for name in names)), tuple(e.name for e in model.effects)
    fixed = model.vehicle.has_rotors and not model.vehicle.geometry()[0].tilts.any()
    usual = own or (ROTORS if fixed and all(_allows(one, model, ROTORS) for one in flights) else TRIMS)
    usual = tuple(dict.fromkeys((*own, *PARTS))) if parts else usual
    lacking: dict[str, LeftOut] = {}  # the first flight that does not allow an effect, and why
    for name, one in product((*asked, *usual), flights):
        reason = inapplicable(name, model, one.records)
        if reason is not None:
            lacking.setdefault(name, LeftOut(one.records[0].flight, reason))
    for name in asked:
        if name in lacking:
            raise FitError(f"{lacking[name].flight}: {lacking[name].reason}; leave it out of --fit")
    chosen = asked or tuple(name for name in (PARTS if parts else usual) if name not in lacking)
    if not chosen:
        first = lacking[PARTS[0] if parts else usual[0]]
        raise UsageError(f"trend: nothing to fit: {first.flight}: {first.reason}; name effects with --fit")
    require_force((*(name for name in own if name not in lacking), *chosen))
    left_out = tuple(one for name, one in lacking.items() if name in own or not asked)
    if parts:  # that a vehicle has no arms that tilt is no news
        left_out = tuple(one for one in left_out if one.reason.lack is not Lack.TILT or one.reason.effect in own)
    usable = model.without(one.reason.effect for one in left_out if one.reason.effect in own)
    return chosen, replace(usable, between_flights=None), left_out


def _allows(one: OpenFlight, model: Model, names: Sequence[str]) -> bool:
    """Whether effects can be fitted to a flight of the model's vehicle."""
    return not any(inapplicable(name, model, one.records) for name in names)


def _followed(fits: Sequence[FlightValues], model: Model) -> tuple[ParameterTrend, ...]:
    """Every parameter of the fits, one a flight, and its course."""
    theta, std = np.array([f.theta for f in fits]), np.array([f.std for f in fits])
    errors = np.sqrt(np.maximum(std**2 - (MISFIT * theta) ** 2, 0.0))
    parameters = [(name, p) for name in fits[0].effects for p in find(name).parameters(model.vehicle)]
    shown = [_shown(p, errors[:, k]) for k, (_, p) in enumerate(parameters)]
    out = []
    for k, (effect, p) in enumerate(parameters):
        found = course(theta[:, k], errors[:, k], max(sum(shown), 1))
        if not shown[k]:
            found = Course(Verdict.OPEN, np.full(len(fits), theta[:, k].mean()), found.scatter)
        stuck = tuple(i for i, f in enumerate(fits) if f"{effect}.{p.name}" in f.at_bound)
        out.append(ParameterTrend(effect, p.name, p.unit, theta[:, k], std[:, k], errors[:, k], found, stuck))
    return tuple(out)


def _shown(parameter: Parameter, errors: Array, unseen: float = 0.8) -> bool:
    """Whether the flights say more of a parameter than what is typical of its kind (the prior), times `unseen`."""
    return bool(np.median(errors) < unseen * parameter.scale)
