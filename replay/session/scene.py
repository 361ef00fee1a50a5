"""What the viewer draws of a flight: what was recorded, made once, and what models say of it, made for each model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array, ReferenceSeries
from wrenchgap.learn.data.comparison import Evaluation
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.plant.actuation import actuation
from wrenchgap.plant.controller import attitude_error
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.replay.compensation.source import at_stamps
from wrenchgap.replay.present.notes import sentences, warnings
from wrenchgap.viewer.scene import Scene, Series, Stretch

XYZ = ("x", "y", "z")
FLOORS = {"deg": 0.01, "mm": 0.1, "rad/s": 1e-3, "rotor speed": 0.1}
"""The least range of the other plots, by unit, and of rotor speeds [rad/s]: below what sensors resolve."""


def recorded(one: OpenFlight, vehicle: Vehicle, rate_hz: float = 50.0) -> Scene:
    """A flight without any model: poses, reference, actuators, commanded and measured wrenches, tracking errors.

    At about `rate_hz` instants a second: more than a screen shows, and than the filter lets through.
    """
    parts = [slice(0, None, max(1, round(1.0 / (rate_hz * s.dt)))) for s in one.samples]
    time = np.concatenate([s.time[part] for s, part in zip(one.samples, parts, strict=True)])
    reference = one.flight.reference
    position, quat = (None, None) if reference is None else _reference(reference, time)
    scene = Scene(
        name=one.records[0].flight,
        time=time,
        position_E=_joined(one, parts, "position_E", (0.0, 0.0, 0.0)),
        quat_EB=_joined(one, parts, "quat_EB", (1.0, 0.0, 0.0, 0.0)),
        reference_position_E=position,
        quat_ED=quat,
        tilt=_tilt(time, one.records, vehicle),
        thrust=_thrust(time, one.records, vehicle),
        wrenches={
            "commanded": _at(time, one.records, [r.commanded for r in one.records]),
            "measured": _at(time, one.records, [r.measured for r in one.records]),
            **_desired(time, one.records),
        },
        floors=_floors(vehicle),
        gaps=_gaps(one),
        notes=tuple(sentences(one.notes)),
        warnings=tuple(warnings(one.notes)),
    )
    pose = one.samples[0].position_E is not None
    rates = _joined(one, parts, "omega_B", (0.0, 0.0, 0.0))
    omega = Series("body rate", "rad/s", time, dict(zip(XYZ, rates.T, strict=True)), floor=FLOORS["rad/s"])
    return replace(scene, series=(*_tracking(scene, pose), *_actuators(scene, one.records, vehicle), omega))


def _floors(vehicle: Vehicle) -> dict[str, float]:
    """The least range of plots of forces [N] and torques [Nm]: 0.1 % of the weight, and of weight times arm.

    The arm is that of the farthest rotor, for a vehicle without rotors its radius of gyration.
    """
    body = vehicle.body
    weight = body.mass * GRAVITY
    arm = float(np.sqrt(np.trace(body.inertia) / body.mass))
    if vehicle.arms is not None and len(vehicle.arms):
        arm = float(np.linalg.norm(vehicle.arms.position_B - body.com_B, axis=1).max())
    return {"N": 1e-3 * weight, "Nm": 1e-3 * weight * arm}


def _gaps(one: OpenFlight) -> tuple[Stretch, ...]:
    """What the log does not cover, and the phases of it that are left out."""
    gaps = [
        Stretch(float(before.time[-1]), float(after.time[0]), "gap")
        for before, after in zip(one.samples, one.samples[1:], strict=False)
    ]
    gaps += [Stretch(p.start, p.stop, f"{p.name}, left out") for p in one.phases if p.left_out]
    return tuple(sorted(gaps, key=lambda gap: gap.start))


def predicted(
    scene: Scene,
    one: OpenFlight,
    models: Mapping[str, Evaluation],
    *,
    residual_of: str,
    worst: Sequence[Stretch] = (),
    notes: Sequence[str] = (),
) -> Scene:
    """A recorded flight with what `models` say of it alone; `residual_of` names the wrench to compare with."""
    wrenches = {name: _at(scene.time, one.records, found.predictions) for name, found in models.items()}
    sigma = {n: _at(scene.time, one.records, found.sigma) for n, found in models.items() if found.sigma is not None}
    return replace(
        scene,
        wrenches={**scene.wrenches, **wrenches},
        sigma=sigma,
        residual_of=residual_of,
        series=(*scene.series, *_sigmas(scene.time, sigma)),
        worst=tuple(worst),
        notes=tuple(dict.fromkeys((*notes, *scene.notes))),
    )


def _joined(one: OpenFlight, parts: Sequence[slice], name: str, unknown: Sequence[float]) -> Array:
    """A quantity of all stretches; `unknown` where a stretch lacks it."""
    values = []
    for samples, part in zip(one.samples, parts, strict=True):
        given = getattr(samples, name)
        values.append(np.tile(unknown, (len(samples), 1))[part] if given is None else given[part])
    return np.concatenate(values)


def _at(time: Array, records: Sequence[Record], values: Sequence[Array]) -> Array:
    """What is known at the compared samples of every record, linear between them, at `time`; nan outside."""
    return at_stamps(time, [(r.time, v) for r, v in zip(records, values, strict=True)])


def _desired(time: Array, records: Sequence[Record]) -> dict[str, Array]:
    """The wrench before any compensation, where the log tells it from the command."""
    known = [(r.time, r.desired) for r in records if r.desired is not None]
    if not known or all(np.allclose(r.desired, r.commanded) for r in records if r.desired is not None):
        return {}
    return {"desired": at_stamps(time, known)}


def _tilt(time: Array, records: Sequence[Record], vehicle: Vehicle) -> Array | None:
    """Angles of all arms as commanded (logged or allocated), None where the model has no arms."""
    known = [(r.state.time, r.commands.tilt) for r in records if r.commands.tilt is not None]
    if vehicle.arms is None or not known:
        return None
    return at_stamps(time, known)


def _thrust(time: Array, records: Sequence[Record], vehicle: Vehicle) -> Array | None:
    known = [r for r in records if r.commands.tilt is not None and r.commands.rotor_speed is not None]
    if vehicle.rotors is None or not known:
        return None
    return at_stamps(time, [(r.state.time, actuation(vehicle, r.commands).thrust) for r in known])


def _reference(reference: ReferenceSeries, time: Array) -> tuple[Array, Array]:
    """Position (K, 3) and attitude (K, 4) of the reference at `time`; nan where it is not logged."""
    knots = reference.time
    position = np.stack([np.interp(time, knots, column) for column in reference.position_E.T], axis=1)
    quat = so3.interpolate(time, knots, reference.quat_ED)
    missing = (time < knots[0]) | (time > knots[-1])
    for gap in reference.gaps:
        missing |= (time > gap.start) & (time < gap.stop)
    position[missing], quat[missing] = np.nan, np.nan
    return position, quat


def _tracking(scene: Scene, pose: bool) -> tuple[Series, ...]:
    """Attitude error e_R, as the angle whose sine it is, and position error, where pose and reference are logged."""
    if scene.reference_position_E is None or scene.quat_ED is None or not pose:
        return ()
    known = np.asarray(np.isfinite(scene.quat_ED).all(axis=1))
    angle = np.full((len(scene.time), 3), np.nan)
    e = attitude_error(scene.quat_EB[known], scene.quat_ED[known])
    angle[known] = np.degrees(np.arcsin(np.clip(e, -1.0, 1.0)))
    position = 1e3 * (scene.position_E - scene.reference_position_E)
    return (
        Series("attitude error", "deg", scene.time, dict(zip(XYZ, angle.T, strict=True)), floor=FLOORS["deg"]),
        Series("position error", "mm", scene.time, dict(zip(XYZ, position.T, strict=True)), floor=FLOORS["mm"]),
    )


def _actuators(scene: Scene, records: Sequence[Record], vehicle: Vehicle) -> tuple[Series, ...]:
    """Tilts and rotor speeds as logged, under the names that the model file has for arms and rotors."""
    found = []
    if scene.tilt is not None:
        tilt = np.degrees(scene.tilt).T
        arms = {vehicle.named("arm", i) or f"arm {i}": values for i, values in enumerate(tilt)}
        found.append(Series("tilt", "deg", scene.time, arms, "Actuators", FLOORS["deg"]))
    known = [(r.state.time, r.commands.rotor_speed) for r in records if r.commands.rotor_speed is not None]
    if known:
        speed = at_stamps(scene.time, known).T
        rotors = {vehicle.named("rotor", i) or f"rotor {i}": values for i, values in enumerate(speed)}
        found.append(Series("rotor speed", "rad/s", scene.time, rotors, "Actuators", FLOORS["rotor speed"]))
    return tuple(found)


def _sigmas(time: Array, sigma: Mapping[str, Array]) -> tuple[Series, ...]:
    """The standard deviations themselves, forces and torques apart, of the axes that are known."""
    found = []
    for name, values in sigma.items():
        for kind, unit, part in (("force", "N", values[:, :3]), ("torque", "Nm", values[:, 3:])):
            known = {axis: part[:, i] for i, axis in enumerate(XYZ) if np.isfinite(part[:, i]).any()}
            if known:
                found.append(Series(f"sigma of {name} {kind}", unit, time, known, "Compensation"))
    return tuple(found)
