"""Numbers of a vehicle that contradict one another, commands that it cannot follow, and what records say of it.

All of a vehicle's mass is within its arms and rotors, so no moment of inertia exceeds m (L + r)^2, L the longest arm,
r the rotor's radius; and motors sit at the ends of the arms, so none is next to nothing. The drag torque of a rotor
over its thrust, kappa, is the radius times C_Q / C_T: between a fortieth and three radii for any propeller that flies
(C_T, C_Q of small propellers: Brandt and Selig, AIAA 2011-1255). Its thrust coefficient C_T = c_f / (rho pi R^4) is
about 0.01; a c_f per rpm^2 is a ninetieth of that, one per (1/s)^2 forty times as much.

Single commands that cannot be true are left out, and said. Of the records: weight, and whether the actuators agree
with the commanded wrench.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.check import Check, Level
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.flight.stamps import thinned
from wrenchgap.learn.data.checks.early_response import early_response
from wrenchgap.learn.data.errors import force_and_torque, length, rms
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.data.prediction import predict
from wrenchgap.plant.actuation import nominal_wrench
from wrenchgap.plant.effects.com_offset import span
from wrenchgap.plant.model import Model
from wrenchgap.plant.state import Commands
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import WrenchModel, about_com


@dataclass(frozen=True)
class VehicleRanges:
    """Within which ranges numbers of a vehicle that flies are."""

    least_gyration: float = 0.015
    """Moment of inertia over m L^2, L the rms length of the arms, below which nothing that flies is."""
    small_gyration: float = 0.03
    """The same below which hardly anything is."""
    kappa: tuple[float, float] = (0.025, 3.0)
    """Drag torque per thrust over the rotor's radius."""
    thrust_coefficient: tuple[float, float] = (0.0015, 0.1)
    """C_T = T / (rho pi R^2 (Omega R)^2); the vehicles that we have are at 0.007 to 0.021."""
    air_density: float = 1.225
    """Density of air at sea level [kg/m^3]."""


RANGES = VehicleRanges()


def vehicle_checks(model: Model) -> Iterator[Check]:
    """Inertia against mass and arms, kappa and c_f against the radius."""
    vehicle = model.vehicle
    if not vehicle.has_rotors:
        return
    yield _inertia(vehicle)
    yield _kappa(vehicle)
    if model.command is None:  # a curve from commands to newtons leaves c_f free
        yield _thrust(vehicle)


def _inertia(vehicle: Vehicle) -> Check:
    arms, rotors = vehicle.geometry()
    body = vehicle.body
    lengths = np.linalg.norm(arms.position_B - body.com_B, axis=1)
    usual, reach = float(np.sqrt(np.mean(lengths**2))), float(lengths.max() + rotors.radius.max())
    moments = np.linalg.eigvalsh(body.inertia)
    least, most = float(moments[0] / (body.mass * usual**2)), float(moments[-1] / (body.mass * reach**2))
    listed = ", ".join(f"{m:.3g}" for m in moments)
    described = f"vehicle.inertia {listed} kg m^2 with {body.mass:.3g} kg and arms of {usual:.3g} m"
    wrong = "correct it in the model"
    if most > 1.0:
        limit = body.mass * reach**2
        words = f"{described}: no mass within {reach:.3g} m has more than {limit:.3g} kg m^2; {wrong}"
        return Check("inertia", "bad", words)
    if least < RANGES.least_gyration:
        if RANGES.small_gyration < 1000.0 * least and 1000.0 * most < 1.0:
            wrong = f"is vehicle.mass in grams? it is read as {body.mass:.3g} kg; {wrong}"
        words = f"{described}: {least:.2g} of m L^2, expected at least {RANGES.least_gyration:g}; {wrong}"
        return Check("inertia", "bad", words)
    if least < RANGES.small_gyration:
        return Check("inertia", "warn", f"{described}: only {least:.2g} of m L^2; is it in kg m^2?")
    return Check("inertia", "ok", f"{described}: plausible.")


def _kappa(vehicle: Vehicle) -> Check:
    _, rotors = vehicle.geometry()
    kappa, radius = np.abs(rotors.kappa), rotors.radius
    share = kappa / radius
    if np.any(rotors.kappa < 0.0):
        words = "kappa is negative: which way a rotor turns says spin, and a negative kappa turns it over"
        return Check("kappa", "warn", f"{words}; write kappa without its sign in the model, and spin with it")
    if np.all(kappa == 0.0):
        return Check("kappa", "warn", "kappa is zero: rotors make no drag torque, and yaw is not predicted.")
    worst = _farthest(share, RANGES.kappa)
    described = f"kappa {kappa[worst]:.3g} m is {share[worst]:.2g} of the rotor's radius {radius[worst]:.3g} m"
    low, high = RANGES.kappa
    if low < share[worst] < high:
        return Check("kappa", "ok", f"{described}.")
    instead = kappa[worst] / rotors.c_f[worst]
    hint = ""
    if low < instead / radius[worst] < high:
        hint = f": it looks like the torque coefficient [N m s^2]; kappa is that over c_f, {instead:.3g} m"
    limits = f"expected {low:g} to {high:g}"
    return Check("kappa", "bad", f"{described}, {limits}{hint}; correct vehicle.rotor.kappa in the model")


def _farthest(values: Array, limits: tuple[float, float]) -> int:
    """Which of positive numbers (N,) is farthest from the middle of a range, by ratios."""
    return int(np.argmax(np.abs(np.log(np.maximum(values, 1e-30)) - np.log(np.sqrt(limits[0] * limits[1])))))


def _thrust(vehicle: Vehicle) -> Check:
    _, rotors = vehicle.geometry()
    disc = RANGES.air_density * np.pi * rotors.radius**4
    coefficient = rotors.c_f / disc
    worst = _farthest(coefficient, RANGES.thrust_coefficient)
    found, c_f = float(coefficient[worst]), float(rotors.c_f[worst])
    described = (
        f"c_f {c_f:.3g} N s^2 with a radius of {rotors.radius[worst]:.3g} m is a thrust coefficient of {found:.2g}"
    )
    low, high = RANGES.thrust_coefficient
    if low < found < high:
        return Check("thrust-coefficient", "ok", f"{described}.")
    units = {"rpm^2": (30.0 / np.pi) ** 2, "revolutions per second, squared": (0.5 / np.pi) ** 2}
    unit = next((unit for unit, k in units.items() if low < found * k < high), None)
    hint = "" if unit is None else f": it looks like newtons per {unit}; in N s^2 it is {c_f * units[unit]:.3g}"
    words = f"{described}, expected {low:g} to {high:g}{hint}; correct vehicle.rotor.c_f or radius in the model"
    return Check("thrust-coefficient", "warn", words)


@dataclass(frozen=True)
class RecordThresholds:
    """From when on commands are impossible, and records contradict the model."""

    rows: int = 20_000
    """Of a record, evenly spread, on which logged actuators are compared with the logged wrench."""
    other: float = 0.25
    """Of the weight: rms force by which h(u) and a commanded wrench differ beyond what a vehicle and its model do."""
    factor: tuple[float, float] = (0.5, 2.0)
    """On h(u) that a wrong c_f may explain: the thrust's unit and the weight are asked elsewhere."""
    torque: float = 0.002
    """Of the weight at the rotors' distance: torque by which they may differ in any case, as by a centre of mass that
    is off by so much of the arm. Two exchanged columns of tilt make 0.04 and more, a model whose rotors are one place
    on 0.004 in a gentle flight, what a simulator logs 1e-4: half of this tells them apart as well, twice just so."""
    odd_rotor: float = 0.04
    """Share of its thrust by which one rotor's logged speed may be off: 2 % of speed, as coarse throttle steps are."""
    unexplained: float = 0.1
    """Share of what h(u) and the logged wrench differ by, squared, that a single rotor may leave to be its cause."""
    followed: float = 2.0
    """Times as much of the measured wrench as the logged one that h(u) may leave, force or torque. It is 1.00 on ten
    flights with no or one of four defects where columns are as sent; on a sound vehicle steps, offsets, noise and an
    eccentricity of 1.7 deg make 2.7 to 300. Of 1.2 low-passed columns (1.3, 1.9) are told too; of 4 steps are not."""


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
    found = (*_counts(flight, model), *_weight(records, model), *_actuation(flight, records, model, known=known))
    return (*found, *early_response(flight, model, records))


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


OTHER_WEIGHT = "another vehicle, unit or mass? correct vehicle.mass."
"""How the words of a weight end that no effect is expected to explain."""


def _weight(records: Sequence[Record], model: Model) -> list[Check]:
    weight = model.vehicle.body.mass * GRAVITY
    found = []
    for name in ("measured", "commanded"):
        if name == "measured" and not all(r.measured_axes[2] for r in records):
            continue
        median = float(np.median(length(np.concatenate([getattr(r, name)[:, :3] for r in records]))))
        share = median / weight
        words = f"Median {name} force is {median:.3g} N, the model's weight {weight:.3g} N ({share:.3f})"
        unsure = model.vehicle.tolerances.thrust if name == "commanded" else None
        if abs(share - 1.0) < max(0.05, unsure or 0.0):
            found.append(Check("weight", "ok", f"{words}."))
        elif 0.7 < share < 1.3:
            other = (
                f"; the model knows its thrust to {100.0 * unsure:.2g} %"
                if unsure
                else ", or expect thrust_scale to be found"
            )
            remedy = f"check the mass{other}." if name == "commanded" else "fast flight?"
            found.append(Check("weight", "warn", f"{words}: {remedy}"))
        else:
            usual = 1.5 if name == "commanded" else 2.0  # what is measured of fast flight may be more
            level: Level = "warn" if 1.0 / usual < share < usual else "bad"
            found.append(Check("weight", level, f"{words}: {OTHER_WEIGHT}"))
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
    best = float(np.sum(made[:, :3] * logged[:, :3])) / max(float(np.sum(made[:, :3] ** 2)), 1e-12)
    apart = length(np.clip(best, *RECORDS.factor) * made[:, :3] - logged[:, :3])  # but for a factor (a wrong c_f)
    if not known and float(np.sqrt(np.mean(apart**2))) > RECORDS.other * weight:
        share = f"{100.0 * force / weight:.0f} % of the weight"
        ask = f"is {vehicle.name} the model of this vehicle? Else correct its arms, tilt signs and order of rotors"
        return [Check("actuation", "bad", f"{words}, {share}, and neither c_f nor a unit explains it: {ask}")]
    if not known and (one := _odd_rotor(vehicle, sent, made - logged)) is not None:
        rotor, factor = vehicle.rotor_name(one[0]), one[1]
        says = f"the logged speed of {rotor} alone makes it, {factor:.3f} times the one that the wrench needs"
        ask = f"correct the scale of {rotor} in the log or its c_f in the model; else it is found to be weak or strong"
        return [Check("actuation", "bad", f"{words}: {says}: {ask}")]
    unlike, varies = (float(np.linalg.norm(w[:, 3:].std(axis=0))) for w in (made - logged, logged))
    reach = float(np.max(length(vehicle.geometry()[0].position_B)))
    if not known and unlike > max(varies, RECORDS.torque * weight * reach):
        ask = "columns of the log are exchanged, or arms, tilt signs and order of rotors of the model are others"
        return [Check("actuation", "bad", f"{words}, which varies more than all of the commanded torque: {ask}")]
    nominal, common = WrenchModel(vehicle, ()), float(np.clip(best, *RECORDS.factor))
    by_wrench = force_and_torque(rms(np.concatenate([r.measured - r.commanded for r in records])))
    by_actuators = force_and_torque(rms(np.concatenate([r.measured - common * predict(r, nominal) for r in records])))
    if not known and np.any(by_actuators > RECORDS.followed * by_wrench):
        left = " against ".join(f"{f:.3g} N and {t:.3g} Nm" for f, t in (by_wrench, by_actuators))
        says = "what is found missing may be off in a column of the log or in the model file, and not on the vehicle"
        return [Check("actuation", "warn", f"{words}, and the vehicle followed W_cmd ({left} are left): {says}.")]
    if force > 0.1 * whole or torque > 0.5 * max(turn, 1e-9):
        remedy = "check order of rotors, spin, c_f and tilt signs in the model file, or saturation."
        return [Check("actuation", "warn", f"{words}: {remedy}")]
    return [Check("actuation", "ok", f"{words}.")]


def _odd_rotor(vehicle: Vehicle, sent: Sequence[Commands], apart: Array) -> tuple[int, float] | None:
    """The rotor of which a wrong scale alone makes that h(u) is `apart` (N, 6) from the logged wrench, and the factor
    on its speed; None where no rotor does.
    """  # noqa: D205
    if vehicle.rotors is None or any(commands.rotor_speed is None for commands in sent):
        return None
    count = len(vehicle.rotors.c_f)
    scale = np.array([1.0] * 3 + [1.0 / span(vehicle)] * 3)  # torques as forces at the rotors
    left, found = apart * scale, []
    whole = float(np.sum(left**2))
    for rotor in range(count):
        only = np.arange(count) == rotor
        alone = [replace(c, rotor_speed=np.asarray(c.rotor_speed) * only) for c in sent]
        own = np.concatenate([about_com(vehicle.body, nominal_wrench(vehicle, commands)) for commands in alone])
        own *= scale
        share = float(np.sum(own * left)) / max(float(np.sum(own**2)), 1e-30)
        found.append((float(np.sum((left - share * own) ** 2)), rotor, share))
    rest, rotor, share = min(found)
    if rest > RECORDS.unexplained * whole or not RECORDS.odd_rotor < abs(share) < 1.0:
        return None
    return rotor, float(1.0 / np.sqrt(1.0 - share))
