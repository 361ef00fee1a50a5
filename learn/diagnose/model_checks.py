"""A log against a model: whether the vehicle weighs what the model says, and whether its actuators agree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wrenchgap import flight
from wrenchgap.flight.checks import Check
from wrenchgap.flight.errors import UsageError, WrenchgapError
from wrenchgap.flight.inspection import Inspection
from wrenchgap.flight.result import Result
from wrenchgap.flight.roles import parse_source
from wrenchgap.flight.unmeasured import axis_names
from wrenchgap.learn.data.errors import force_and_torque, length, rms
from wrenchgap.learn.data.measurement import CUTOFF_HZ
from wrenchgap.learn.data.opening import OpenFlight, open_flight
from wrenchgap.learn.diagnose.timing import FlightTiming, timing, timing_of
from wrenchgap.plant.actuation import nominal_wrench
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import GRAVITY
from wrenchgap.plant.wrench_model import about_com


@dataclass(frozen=True, repr=False)
class LogReport(Result):
    """What is in a log: `inspection`, what the model's numbers say of it, and the timing of its topics.

    `model_checks` is empty without a model, `timing` None where no topic plays a role; `shifts` [s] moved stamps.
    """

    inspection: Inspection
    model_checks: tuple[Check, ...]
    timing: FlightTiming | None
    shifts: Mapping[str, float]
    notes: tuple[str, ...]


def inspect(
    path: str | Path,
    model: Model | None = None,
    *,
    topics: Mapping[str, str] | None = None,
    shifts: Mapping[str, float] | None = None,
    cutoff_hz: float = CUTOFF_HZ,
    unmeasured: Iterable[str] = (),
) -> LogReport:
    """Look at a log, against a model where one is given. Raises LogError for what is no log, UsageError for topics."""
    path, wanted, moves = Path(path), dict(topics or {}), dict(shifts or {})
    absent = axis_names([*axis_names(unmeasured), *(model.unmeasured if model is not None else ())])
    seen = _with_topics_of(path, wanted, model, absent)
    moved = None if seen.flight is None else flight.shifted(seen.flight, moves)
    found = None if moved is None else timing(moved)
    against: tuple[Check, ...] = ()
    if model is not None:
        against, opened = _checks(path, model, topics=wanted, cutoff_hz=cutoff_hz, shifts=moves, unmeasured=absent)
        found = found if opened is None else timing_of(opened, model)
    return LogReport(seen, against, found, moves, tuple(seen.notes if moved is None else moved.notes))


def _with_topics_of(
    path: Path, topics: Mapping[str, str], model: Model | None, unmeasured: tuple[str, ...]
) -> Inspection:
    """`flight.inspect` with the model file's topics, where the log has them."""
    plain = flight.inspect(path, topics, unmeasured=unmeasured)
    if model is None or not model.topics:
        return plain
    have = {topic.topic for topic in plain.topics}
    preferred = {role: text for role, text in model.topics.items() if parse_source(text).topic in have}
    wanted = {**preferred, **topics}
    return flight.inspect(path, wanted, unmeasured=unmeasured) if wanted != dict(topics) else plain


def _checks(path: Path, model: Model, **how: Any) -> tuple[tuple[Check, ...], OpenFlight | None]:
    """What a model says about a log, and the flight; a log that cannot be used with it is itself a finding."""
    try:
        opened = open_flight(path, model, **how)
    except UsageError:
        raise
    except WrenchgapError as error:
        return (Check("model", "bad", str(error)),), None
    return (*_counts(opened, model), *_weight(opened, model), *_actuation(opened, model)), opened


def _counts(opened: OpenFlight, model: Model) -> list[Check]:
    vehicle, actuators = model.vehicle, opened.flight.actuators
    rotors = 0 if vehicle.rotors is None else len(vehicle.rotors)
    tilts = 0 if vehicle.arms is None else int(vehicle.arms.tilts.sum())
    described = f"{vehicle.name} has {rotors} rotors and {tilts} tilting arms"
    if actuators is None:
        missing = "allocated from the commanded wrench" if rotors else "the commanded wrench is the nominal model"
        return [Check("actuators", "ok", f"{described}; none are logged: {missing}.")]
    logged = f"the log has {actuators.rotor_speed.shape[1]} rotor speeds and {actuators.tilt.shape[1]} tilt angles"
    if not rotors:
        return [Check("actuators", "warn", f"{logged}, but the model file has no arms: they are not used.")]
    return [Check("actuators", "ok", f"{described}; {logged}.")]


def _weight(opened: OpenFlight, model: Model) -> list[Check]:
    weight = model.vehicle.body.mass * GRAVITY
    found = []
    for name in ("measured", "commanded"):
        if name == "measured" and not all(r.measured_axes[2] for r in opened.records):
            continue
        force = np.concatenate([getattr(r, name)[:, :3] for r in opened.records])
        median = float(np.median(length(force)))
        words = f"Median {name} force is {median:.3g} N, the model's weight {weight:.3g} N ({median / weight:.3f})"
        if 0.95 < median / weight < 1.05:
            found.append(Check("weight", "ok", f"{words}."))
        elif 0.7 < median / weight < 1.3:
            remedy = "check the mass, or expect thrust_scale to be found." if name == "commanded" else "fast flight?"
            found.append(Check("weight", "warn", f"{words}: {remedy}"))
        else:
            found.append(Check("weight", "bad", f"{words}: another vehicle, unit or mass; correct vehicle.mass."))
    return found


def _actuation(opened: OpenFlight, model: Model) -> list[Check]:
    """h(u) of the logged actuators against the logged W_cmd."""
    if opened.flight.commanded is None or any(r.source != "logged" for r in opened.records):
        return []
    vehicle = model.vehicle
    made = np.concatenate([about_com(vehicle.body, nominal_wrench(vehicle, r.commands)) for r in opened.records])
    logged = np.concatenate([r.commands.wrench_B for r in opened.records])
    (force, torque), (whole, turn) = (force_and_torque(rms(wrench)) for wrench in (made - logged, logged))
    words = f"h(u) of the logged actuators differs from the logged W_cmd by {force:.3g} N and {torque:.3g} Nm rms"
    if force > 0.1 * whole or torque > 0.5 * max(turn, 1e-9):
        remedy = "check order of rotors, spin, c_f and tilt signs in the model file, or saturation."
        return [Check("actuation", "warn", f"{words}: {remedy}")]
    return [Check("actuation", "ok", f"{words}.")]
