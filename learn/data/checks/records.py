"""Commands beyond what the model says is possible, and what the records of a flight say of the model.

Single commands that cannot be true are left out, and said. Of the records: weight, and whether the actuators agree
with the commanded wrench.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.masking import MASKING, without
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.flight.row_kernels import lengths
from wrenchgap.flight.stamps import thinned
from wrenchgap.learn.data.errors import force_and_torque, length, rms
from wrenchgap.learn.data.measurement import Record
from wrenchgap.plant.actuation import nominal_wrench
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import GRAVITY
from wrenchgap.plant.wrench_model import about_com


@dataclass(frozen=True)
class RecordThresholds:
    """From when on commands are impossible, and records contradict the model."""

    rows: int = 20_000
    """Of a record, evenly spread, on which logged actuators are compared with the logged wrench."""
    other: float = 0.25
    """Of the weight: rms force by which h(u) and a commanded wrench differ beyond what a vehicle and its model do."""
    factor: tuple[float, float] = (0.5, 2.0)
    """On h(u) that a wrong c_f may explain: the thrust's unit and the weight are asked elsewhere."""
    speed_margin: float = 1.2
    """Times a rotor's `speed_max` beyond which no command is one."""
    force_margin: float = 3.0
    """Times the force of all rotors at `speed_max` beyond which no command is one."""
    many: float = 0.3
    """Share of the samples up to which they are left out where all are far from the others."""
    far: float = 3.0
    """How many times what three quarters of the others are counts as far."""


RECORDS = RecordThresholds()


EXPLAINED = ("rotors", "rotor-speed-unit", "tilt-unit", "wrench-frame", "force-unit")
"""Checks that, where bad, say why both differ, with a mend of their own."""


def record_checks(
    flight: Flight, records: Sequence[Record], model: Model, said: Sequence[Check] = ()
) -> tuple[Check, ...]:
    """All of them; `said` are the checks of the flight before."""
    if not records:
        return ()
    known = any(check.level == "bad" and check.name in EXPLAINED for check in said)
    return (*_counts(flight, model), *_weight(records, model), *_actuation(flight, records, model, known=known))


def _counts(flight: Flight, model: Model) -> list[Check]:
    vehicle, actuators = model.vehicle, flight.actuators
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


def _weight(records: Sequence[Record], model: Model) -> list[Check]:
    weight = model.vehicle.body.mass * GRAVITY
    found = []
    for name in ("measured", "commanded"):
        if name == "measured" and not all(r.measured_axes[2] for r in records):
            continue
        force = np.concatenate([getattr(r, name)[:, :3] for r in records])
        median = float(np.median(length(force)))
        words = f"Median {name} force is {median:.3g} N, the model's weight {weight:.3g} N ({median / weight:.3f})"
        if 0.95 < median / weight < 1.05:
            found.append(Check("weight", "ok", f"{words}."))
        elif 0.7 < median / weight < 1.3:
            remedy = "check the mass, or expect thrust_scale to be found." if name == "commanded" else "fast flight?"
            found.append(Check("weight", "warn", f"{words}: {remedy}"))
        else:
            level = "warn" if 0.5 < median / weight < 2.0 else "bad"
            found.append(Check("weight", level, f"{words}: another vehicle, unit or mass? correct vehicle.mass."))  # type: ignore[arg-type]
    return found


def _actuation(flight: Flight, records: Sequence[Record], model: Model, *, known: bool) -> list[Check]:
    """h(u) of the logged actuators against the logged W_cmd; `known`: why they differ has been said."""
    if flight.commanded is None or any(r.source != "logged" for r in records):
        return []
    vehicle = model.vehicle
    sent = [r.commands.take(thinned(len(r.commands.wrench_B), RECORDS.rows)) for r in records]
    made = np.concatenate([about_com(vehicle.body, nominal_wrench(vehicle, commands)) for commands in sent])
    logged = np.concatenate([commands.wrench_B for commands in sent])
    (force, torque), (whole, turn) = (force_and_torque(rms(wrench)) for wrench in (made - logged, logged))
    words = f"h(u) of the logged actuators differs from the logged W_cmd by {force:.3g} N and {torque:.3g} Nm rms"
    weight = vehicle.body.mass * GRAVITY
    if not known and _misfit_up_to_a_factor(made[:, :3], logged[:, :3]) > RECORDS.other * weight:
        share = f"{100.0 * force / weight:.0f} % of the weight"
        ask = f"is {vehicle.name} the model of this vehicle? Else correct its arms, tilt signs and order of rotors"
        return [Check("actuation", "bad", f"{words}, {share}, and neither c_f nor a unit explains it: {ask}")]
    if force > 0.1 * whole or torque > 0.5 * max(turn, 1e-9):
        remedy = "check order of rotors, spin, c_f and tilt signs in the model file, or saturation."
        return [Check("actuation", "warn", f"{words}: {remedy}")]
    return [Check("actuation", "ok", f"{words}.")]


def _misfit_up_to_a_factor(made: Array, logged: Array) -> float:
    """Rms [N] by which forces (K, 3) differ after the factor on `made` that brings them closest (`RECORDS.factor`)."""
    best = float(np.sum(made * logged)) / max(float(np.sum(made**2)), 1e-12)
    return float(np.sqrt(np.mean(length(np.clip(best, *RECORDS.factor) * made - logged) ** 2)))


def _some(beyond: NDArray[np.bool_], size: Array) -> bool:
    """Whether some samples (N,) of these sizes are wrong: few of them, or many that are nowhere near the others."""
    share = float(beyond.mean())
    if share <= MASKING.rare:
        return share > 0.0
    return share <= RECORDS.many and float(size[beyond].min()) > RECORDS.far * float(np.percentile(size[~beyond], 75))


def without_impossible_commands(flight: Flight, model: Model) -> tuple[Flight, tuple[Check, ...]]:
    """The flight without single commands that its vehicle cannot follow; what is beyond all the time is a unit."""
    vehicle = model.vehicle
    if not vehicle.has_rotors:
        return flight, ()
    _, rotors = vehicle.geometry()
    found: list[Check] = []
    sent = flight.actuators
    if sent is not None and sent.rotor_speed.shape[1] == len(rotors):
        beyond = np.any(np.abs(sent.rotor_speed) > RECORDS.speed_margin * rotors.speed_max, axis=1)
        if _some(beyond, np.max(np.abs(sent.rotor_speed), axis=1)):
            flight = without(flight, "actuators", beyond, "beyond speed_max", split=False)
            words = f"actuators: {int(beyond.sum())} sample(s) beyond {RECORDS.speed_margin:g} times"
            found.append(Check("spikes", "warn", f"{words} vehicle.rotor.speed_max: left out."))
    if flight.commanded is not None:
        size = lengths(flight.commanded.wrench_B[:, :3])
        most = RECORDS.force_margin * float(np.sum(rotors.c_f * rotors.speed_max**2))
        beyond = (size > most) & (size > 10.0 * np.percentile(size, 95))
        if _some(beyond, size):
            flight = without(flight, "commanded", beyond, "beyond all rotors", split=False)
            words = f"commanded: {int(beyond.sum())} sample(s) beyond {most:.3g} N, {RECORDS.force_margin:g} times"
            found.append(Check("spikes", "warn", f"{words} all rotors: left out."))
    return flight, tuple(found)
