"""Opening logs for a model: flights, their contiguous stretches on one clock, and records ready to be compared."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from wrenchgap import flight
from wrenchgap.flight.check import Check, Finding, accepted_names, accepting, stop_where_bad
from wrenchgap.flight.checks import with_checks
from wrenchgap.flight.checks.command_rate import widest_spacing
from wrenchgap.flight.command_units import REMEDY
from wrenchgap.flight.errors import FitError, LogError, UsageError, WrenchgapError
from wrenchgap.flight.flight import Flight, Gap, Samples
from wrenchgap.flight.formats.headers import CRAZYFLIE
from wrenchgap.flight.memory import give_back
from wrenchgap.flight.repeats import Repeats
from wrenchgap.flight.row_kernels import runs
from wrenchgap.flight.unmeasured import Why, sentence, zero_axes
from wrenchgap.learn.data.checks import against_model, rates
from wrenchgap.learn.data.checks.frame import frame
from wrenchgap.learn.data.checks.impossible_commands import without_impossible_commands
from wrenchgap.learn.data.checks.vehicle import record_checks
from wrenchgap.learn.data.input_errors import input_error_notes, with_input_error
from wrenchgap.learn.data.measurement import Record, commands_of, measured_axes, names_of, prepare
from wrenchgap.learn.data.phases import never_flew, phase_checks, phases_of, times_left_out
from wrenchgap.learn.data.phases.phase import Phase, phase_names, used_samples
from wrenchgap.learn.data.read_options import MINIMUM_FLIGHT, ReadOptions, kept_within, times_outside
from wrenchgap.plant.command_curve import as_speeds
from wrenchgap.plant.model import Model
from wrenchgap.plant.state import Commands, rows
from wrenchgap.plant.vehicle import Vehicle


class NoFlight(LogError):
    """Nothing of a log is left to compare models on; `checks` are what was found in it besides."""

    def __init__(self, text: str, checks: tuple[Check, ...] = ()) -> None:
        super().__init__(text)
        self.checks = checks


Loader = Callable[..., Flight]
Part = tuple[Samples, Commands, str]
"""Samples with their commands, and `Record.source`."""
SAID = {
    "allocated": "no actuator commands in the log; allocated from the commanded wrench.",
    "none": "the model has no rotors; the commanded wrench is the nominal model.",
}
"""What a user should know of where the commands come from, by `Record.source`."""


@dataclass(frozen=True)
class OpenFlight:
    """A flight, its stretches on one clock, and notes that a user should read.

    `flown` are the parts of the stretches that are flight, `records` what was made of each of them. `phases` are the
    others: on the ground, take-off, ... (`learn.data.phases`); `left_out` are the times [s] that are not used although
    the log has them: such phases, or not asked for. `checks` are what was asked of it (docs/checks.md), `accept` the
    names of those that the user knows of. Notes are sentences, a `Finding` of each check, and a `TimeLeftOut` of each
    of those times.
    """

    flight: Flight
    samples: tuple[Samples, ...]
    flown: tuple[Samples, ...]
    records: tuple[Record, ...]
    left_out: tuple[Gap, ...]
    notes: tuple[object, ...]
    checks: tuple[Check, ...] = ()
    phases: tuple[Phase, ...] = ()
    accept: tuple[str, ...] = ()

    def __repr__(self) -> str:
        seconds = sum(float(r.time[-1] - r.time[0]) for r in self.records)
        return f"<OpenFlight {self.flight.name}: {seconds:.1f} s to analyse in {len(self.records)} stretches>"


Flights = OpenFlight | Sequence[OpenFlight]


def listed(flights: Flights, needed_by: str = "") -> list[OpenFlight]:
    """One flight or several, as a list. Raises UsageError for none, where something is `needed_by` a function."""
    found = [flights] if isinstance(flights, OpenFlight) else list(flights)
    if needed_by and not found:
        raise UsageError(f"{needed_by}: got no flights; expected one at least, see open_flights")
    return found


def open_flight(log: str | Path | Flight, model: Model, options: ReadOptions | None = None, **more: Any) -> OpenFlight:
    """One log for a model, as `open_flights` opens several."""
    return open_flights([log], model, options, **more)[0]


def opened(
    found: Flight,
    model: Model,
    options: ReadOptions | None = None,
    *,
    rate_hz: float | None = None,
    incomplete: bool = False,
    gate: bool = True,
    **more: Any,
) -> OpenFlight:
    """A flight in memory as `open_flights` gives it; `rate_hz` is that of the records (default as `prepare`).

    Of `options`, changed by `more`, those count that say nothing about files: `cutoff_hz`, `between`, `accept`, `keep`.

    With `incomplete` logs are opened too that hold no flight to compare models on: too short or without motion (there
    are no records then), or with a desired wrench alone, which is taken for the command. The notes say so. With
    `gate` a check that is bad and not among the names `accept` raises LogError.
    """
    options = (options or ReadOptions()).changed(**more)
    cutoff_hz, between, keep = options.low_pass_hz(model), options.between, options.keep
    found = flight.in_si(as_speeds(found, model.command, model.vehicle, model.name), _remedy(found, model))
    asked = _Asked(found.path.name, accepted_names(options.accept), gate)
    found, unlikely = without_impossible_commands(with_checks(found), model)
    asked.pass_((*(found.checks or ()), *unlikely, *rates(found, cutoff_hz, rotors=model.vehicle.has_rotors)))
    played, notes = _commanded(found, incomplete)
    try:
        resampled = flight.resample(played, require=_needed(played))
    except LogError as error:
        if not incomplete:
            raise
        why = (*found.notes, *notes, f"no measured wrench: {error}", *asked.findings(found))
        return OpenFlight(found, (), (), (), times_outside(between), why, asked.checks, accept=asked.accept)
    stretches, vehicle = resampled.samples, model.vehicle
    known = _sent(stretches, vehicle)
    phases = phases_of(known, vehicle, cutoff_hz, phase_names(keep, "keep"))
    asked.longest = max(map(len, stretches))
    give_back(asked.longest)
    asked.pass_((*frame(played, model.vehicle), *against_model(played, model, _flown(stretches, phases))))
    parts, left_out = _parts(kept_within(stretches, between, found), stretches, phases, vehicle, known)
    flown, records, short = [], [], []
    of_flight: dict[str, Any] = {"has_imu": played.imu is not None, "command_period": widest_spacing([played])}
    for part, sent, source in parts:
        try:
            made = prepare(part, vehicle, cutoff_hz=cutoff_hz, rate_hz=rate_hz, commands=(sent, source), imu=played.imu)
        except FitError as error:
            if not 0.0 < len(part) * part.dt * cutoff_hz < 12.0:
                raise
            short.append(str(error))
        else:
            flown.append(part)
            records.append(with_input_error(replace(made, **of_flight), played, vehicle))
    if not records and not (incomplete and short):
        said = never_flew(found.path.name, phases, model, found.notes, of_rotors=played.commanded is None)
        raise NoFlight(short[0] if short else said, asked.checks[len(found.checks or ()) :])
    asked.pass_((*record_checks(found, records, model, asked.checks), *phase_checks(phases)))
    told: list[object] = [*_unmeasured(found, model), *found.notes, *resampled.notes, *notes, *short]
    told += [*input_error_notes(found.name, records), *_sources(found, records), *asked.findings(found)]
    told += [*found.left_out, *times_left_out(found.name, between, left_out, phases, stretches)]
    cut = stretches, tuple(flown), tuple(records), (*times_outside(between), *left_out)
    return OpenFlight(found, *cut, tuple(dict.fromkeys(told)), asked.checks, phases, asked.accept)


def _remedy(found: Flight, model: Model) -> str:
    """What to do where a model cannot make newtons of the commands: take that of the vehicle that flew."""
    sent = 0 if found.actuators is None else found.actuators.rotor_speed.shape[1]
    own = len(model.vehicle.rotors) if model.vehicle.rotors is not None else sent
    other = f"{model.name} is of another vehicle: it has {own} rotors, the log commands {sent}"
    if found.firmware == CRAZYFLIE:
        columns = "the columns have the names of the Crazyflie's firmware: take its model with -m crazyflie"
        return f"{other}; {columns}" if sent != own else columns
    return f"{other}; {REMEDY}" if sent != own else REMEDY


@dataclass
class _Asked:
    """The checks of a flight as they come; the first bad one that is not accepted stops.

    `longest` are the samples of the longest stretch, after whose checks memory is given back.
    """

    where: str
    accept: tuple[str, ...]
    gate: bool
    checks: tuple[Check, ...] = ()
    longest: int = 0

    def pass_(self, found: Iterable[Check]) -> None:
        """Add checks; raise LogError where one of them stops. Roles have errors of their own."""
        self.checks += accepting(found, self.accept)
        give_back(self.longest)
        if self.gate:
            stop_where_bad(self.where, (check for check in self.checks if check.name != "roles"))

    def findings(self, found: Flight) -> list[Finding]:
        """The checks as notes."""
        return [Finding(found.name, check) for check in self.checks]


def _needed(played: Flight) -> tuple[str, ...]:
    """Without commands there is no clock, nor without the IMU where there is one."""
    return ("actuators" if played.commanded is None else "commanded", *(() if played.imu is None else ("imu",)))


def _commanded(found: Flight, incomplete: bool) -> tuple[Flight, list[str]]:
    """The flight with something that was commanded, and a note where that is an assumption."""
    if found.commanded is not None or found.actuators is not None:
        return found, []
    if incomplete and found.desired is not None:
        note = f"{found.name}: only a desired wrench in the log; taken as what was commanded."
        return replace(found, commanded=found.desired), [note]
    raise LogError(
        f"{found.path.name}: no topic plays the role 'commanded' or 'actuators', so there is nothing to compare "
        f"the measurement with; map one with --topic {found.command_option}"
    )


def _sent(stretches: Sequence[Samples], vehicle: Vehicle) -> list[Part]:
    """Stretches with their commands; none where these are not the vehicle's, which is said where it is prepared."""
    try:
        return [(samples, *commands_of(samples, vehicle)) for samples in stretches]
    except FitError:
        return []


def _flown(stretches: Sequence[Samples], phases: Sequence[Phase]) -> list[Samples]:
    """The stretches without what is left out, for checks; all of it where nothing remains of a vehicle that moves.

    Commands in another unit look as if something else carried it, and it is the check that shall say so.
    """
    parts = [
        rows(samples, slice(a, b))
        for samples in stretches
        for a, b in runs(used_samples(samples.time, phases))
        if (b - a) * samples.dt >= MINIMUM_FLIGHT
    ]
    return parts if parts or not any(p.name == "held" for p in phases) else list(stretches)


def _parts(
    stretches: Sequence[Samples],
    every: Sequence[Samples],
    phases: Sequence[Phase],
    vehicle: Vehicle,
    sent: Sequence[Part],
) -> tuple[list[Part], list[Gap]]:
    """Stretches cut to the flight that an analysis uses, for `MINIMUM_FLIGHT` at least, and the times in between.

    `every` are all stretches of the flight, `sent` those whose commands are known. The parts come with their commands
    and `Record.source`.
    """
    flown, left_out = [], []
    for samples in stretches:
        known = next((one[1:] for one in sent if one[0] is samples), None)
        commands, source = commands_of(samples, vehicle) if known is None else known
        used = [slice(a, b) for a, b in runs(used_samples(samples.time, phases))]
        if used == [slice(0, len(samples))]:
            flown.append((samples, commands, source))
            continue
        long = [r for r in used if (r.stop - r.start) * samples.dt >= MINIMUM_FLIGHT]
        flown += [(rows(samples, r), commands.take(r), source) for r in long]
        # Samples just outside the first and the last stretch belong to the ground that these begin or end on.
        begin = -np.inf if samples.time[0] <= every[0].time[0] else samples.time[0] - samples.dt
        end = np.inf if samples.time[-1] >= every[-1].time[-1] else samples.time[-1] + samples.dt
        edges = [begin, *(t for r in long for t in (samples.time[r.start], samples.time[r.stop - 1])), end]
        inner = [r.start > 0 for r in long] + [not long or long[-1].stop < len(samples)]
        left_out += [Gap(float(a), float(b)) for a, b, out in zip(edges[::2], edges[1::2], inner, strict=True) if out]
    return flown, left_out


def _sources(found: Flight, records: Sequence[Record]) -> list[str]:
    """What a user should know of where the commands come from."""
    return [f"{found.name}: {words}" for source, words in SAID.items() if source in {r.source for r in records}]


def _unmeasured(found: Flight, model: Model) -> list[str]:
    """One line on axes that were not measured; a LogError where that leaves nothing of the wrench."""
    absent = flight.unmeasured_axes(found)
    if not absent:
        return []
    known = measured_axes(model.vehicle, tuple(absent))
    said = sentence(found.name, absent, names_of(known))
    if not known.any():
        raise LogError(
            f"{said} No axis of the wrench is left to compare; have the motion from the odometry instead, with "
            "--topic imu=none"
        )
    return [said]


def distinct(flights: Sequence[OpenFlight]) -> list[OpenFlight]:
    """The same flights with names that differ: two logs may be called alike in two folders."""
    seen: dict[str, int] = {}
    out = []
    for item in flights:
        name = item.flight.name
        seen[name] = seen.get(name, 0) + 1
        if seen[name] > 1:
            name = f"{name} ({seen[name]})"
            records = tuple(replace(r, flight=name) for r in item.records)
            item = replace(item, flight=replace(item.flight, name=name), records=records)
        out.append(item)
    return out


def open_flights(
    logs: Sequence[str | Path | Flight],
    model: Model,
    options: ReadOptions | None = None,
    *,
    rate_hz: float | None = None,
    incomplete: bool = False,
    gate: bool = True,
    load: Loader = flight.load,
    **more: Any,
) -> list[OpenFlight]:
    """Logs (or flights in memory) for a model, read as `options` say, changed by `more`; with names that differ.

    Topics are those of the model file where the log has them, overridden by the options'. Commands may be wrenches,
    actuators or both; motion may come from an IMU or, failing that, from the odometry. `rate_hz`, `incomplete` and
    `gate` are those of `opened`; `load` reads as `flight.load` does. Raises LogError for the same flight twice
    (`flight.repeats`), UsageError for an unknown axis or phase.
    """
    options = (options or ReadOptions()).changed(**more)
    found: list[OpenFlight] = []
    absent = options.unmeasured_axes(model)
    declared: dict[str, Any] = {"unmeasured": absent} if absent else {}
    declared |= {} if options.budget is None else {"budget": options.budget}
    repeats = Repeats()
    for log in logs:
        raw = log if isinstance(log, Flight) else load(log, options.topics, preferred=model.topics, **declared)
        if len(logs) > 1:
            repeats.refuse(raw, "" if isinstance(log, Flight) else str(log))
        zero = zero_axes(raw)  # of an IMU that reads nothing else the checks say more
        raw = flight.without_axes(raw, (zero if len(zero) < 6 else {}) | dict.fromkeys(absent, Why.DECLARED))
        found.append(
            opened(options.shifted(raw, model), model, options, rate_hz=rate_hz, incomplete=incomplete, gate=gate)
        )
    return distinct(found)


def checks_against(
    log: Path | Flight, model: Model, options: ReadOptions
) -> tuple[tuple[Check, ...], OpenFlight | None]:
    """What a model says about a log, and the flight; a log that cannot be used with it is itself a finding."""
    try:
        opened = open_flight(log, model, options, gate=False)
    except UsageError:
        raise
    except NoFlight as error:  # which a bad check may explain
        return (*error.checks, Check("model", "bad", str(error))), None
    except WrenchgapError as error:
        return (Check("model", "bad", str(error)),), None
    alone = len(opened.flight.checks or ())
    return opened.checks[alone:], opened
