"""A working session for the viewer: logs opened for a model, on the clock of their gap-free stretches.

What is recorded stays; the working model changes, and every scene (what the viewer draws of a flight) is made anew from
it. One class each does the analysis: where the model fails, effects, compensation.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

import wrenchgap as wg
from wrenchgap.flight import LogError, so3
from wrenchgap.flight.budget import Budget
from wrenchgap.flight.flight import Array, ReferenceSeries
from wrenchgap.flight.inspection import Channel, channels_of
from wrenchgap.flight.stamps import interpolated
from wrenchgap.learn.data.comparison import compare
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.data.opening import Flights, OpenFlight, listed
from wrenchgap.learn.data.prediction import Predictor
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.learn.process.predictors import predictors
from wrenchgap.plant.actuation import actuation
from wrenchgap.plant.controller import attitude_error
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.replay.compensation.source import at_stamps
from wrenchgap.replay.present.notes import sentences, warnings
from wrenchgap.replay.session.effects import SessionEffects
from wrenchgap.replay.session.panels.allocation import AllocationPanel
from wrenchgap.replay.session.panels.compensation import CompensationPanel, SessionCompensation
from wrenchgap.replay.session.panels.effects import EffectsPanel
from wrenchgap.replay.session.panels.failure import FailurePanel, SessionFailures
from wrenchgap.replay.session.panels.ready import ReadyPanel
from wrenchgap.replay.session.saving import SaveFolder
from wrenchgap.replay.session.working_model import WorkingModel
from wrenchgap.viewer.session import Capabilities, MakePanel, PathsAhead, Report, Scene, Series, Stretch

if TYPE_CHECKING:
    from wrenchgap.replay.session.panels.changed import SessionComparisons

PREDICTED = "predicted"
"""The wrench of the current model, in a scene."""
UNSAVED = "MODEL"
"""What a model is called in the commands of a report while no file says the same."""


class LogSession:
    """Implements `viewer.session.Session` for flights that were opened for a model, and where given a GP.

    `gp_name` is what the GP is called on the page; `against` are other models whose predictions are shown beside;
    models and trajectories that are saved on the page go into `folder`, without one the page offers them as downloads.
    `budget` is that of reading a log again for its channels (`flight.budget`); `first` is a tab before all others.
    """

    def __init__(
        self,
        flights: Flights,
        model: Model,
        gp: GaussianProcess | None = None,
        *,
        gp_name: str = "GP",
        against: Sequence[Model] = (),
        folder: SaveFolder | None = None,
        budget: Budget | str | None = None,
        first: MakePanel | None = None,
        saved: bool = True,
    ) -> None:
        self.working = WorkingModel(listed(flights), model, gp, saved=saved)
        self._budget = budget
        self.vehicle, self.flights = model.vehicle, tuple(self.working.flights)
        found, notes = predictors(model, against)
        self._against = found[len(found) - len(against) :]
        self._notes = (*self.working.notes, *notes)
        self.failures = SessionFailures(self.working)
        self.effects = SessionEffects(self.working, folder)
        self.compensations = SessionCompensation(self.working, gp_name)
        self.comparisons: SessionComparisons | None = None
        panels: list[MakePanel] = [
            partial(FailurePanel, failures=self.failures),
            partial(EffectsPanel, effects=self.effects),
            partial(ReadyPanel, working=self.working),
            partial(AllocationPanel, working=self.working),
            partial(CompensationPanel, compensations=self.compensations),
        ]
        if len(self.flights) > 1:
            from wrenchgap.replay.session.panels import changed  # here: one flight need not wait for it

            self.comparisons = changed.SessionComparisons(self.working)
            panels.insert(2, partial(changed.ChangedPanel, comparisons=self.comparisons))
        self.capabilities = Capabilities(panels, first, self.channels, self.report)
        self._recorded: dict[str, Scene] = {}

    @property
    def model(self) -> Model:
        """The current model."""
        return self.working.model

    def scene(self, flight: str) -> Scene:
        """The flight of this name, with what the current model says of it, and the last replay on it."""
        with self.working.lock:
            made = self.working.cached(("scene", flight), lambda: self._made(flight))
            return replace(made, series=(*made.series, *self.compensations.series(flight)))

    def channels(self, flight: str) -> Mapping[str, Channel]:
        """Everything in the log of a flight, by name."""
        found = self.working.flight(flight).flight
        return channels_of(found.path, found, self._budget)

    def report(self, flight: str, progress: Report) -> str:
        """The HTML report: the current model fitted on the flight, tested on all others. Takes minutes.

        A GP belongs to the model that it was learnt on, and is left out once that has changed.
        """
        from wrenchgap.replay.present.report import Repetition, page

        working, model, one = self.working, self.model, self.working.flight(flight)
        fitted = {sha for effect in model.effects for _, sha in effect.provenance.logs}
        others = [o for n, o in working.flights.items() if n != flight and o.flight.content_hash not in fitted]
        name = str(model.path) if working.saved and model.path is not None else UNSAVED
        words = ["wrenchgap", "report", str(one.flight.path), "-m", name]
        words += ["--validate", *(str(o.flight.path) for o in others)] if others else []
        gp = working.gp if model is working.opened_model else None
        made = wg.report(one, model, validate=others, gp=gp, progress=progress)
        return page(made, Repetition.of(made, name, shlex.join([*words, "-o", "report.html"])))

    def _made(self, name: str) -> Scene:
        one, predictor = self.working.flight(name), self.working.predictor
        if name not in self._recorded:
            self._recorded[name] = recorded(one, self.vehicle)
        scene, result = self._recorded[name], compare([one], self.model, [predictor, *self._against])
        evaluation, *others = result.evaluations
        models = {other.name: other for other in others}
        trivial = not predictor.model.effects and predictor.gp is None  # the nominal model predicts the command
        if not trivial:
            models = {PREDICTED: evaluation, **models}
        wrenches = {n: _at(scene.time, one.records, found.predictions) for n, found in models.items()}
        sigma = {n: _at(scene.time, one.records, f.sigma) for n, f in models.items() if f.sigma is not None}
        return replace(
            scene,
            ahead=cache(partial(_ahead, one, self.model, predictor)),
            wrenches={**scene.wrenches, **wrenches},
            sigma=sigma,
            residual_of="commanded" if trivial else PREDICTED,
            series=(*scene.series, *_sigmas(scene.time, sigma)),
            worst=tuple(Stretch(s.start, s.stop, f"worst {s.axis.replace('_', ' ')}") for s in evaluation.worst),
            notes=tuple(dict.fromkeys((*sentences((*self._notes, *result.notes)), *scene.notes))),
        )


def _ahead(one: OpenFlight, model: Model, predictor: Predictor) -> PathsAhead | None:
    """Where predictions lead; None where the log has no pose, or is too short."""
    from wrenchgap.replay.prediction import paths_ahead, stretches_of  # here: the page stands before it is there

    try:
        stretches = stretches_of(one, model.vehicle)
    except LogError:
        return None
    usable, _ = predictor.usable(model, one.records)
    found = paths_ahead(stretches, usable)
    return found and PathsAhead(*found)


XYZ = ("x", "y", "z")
FLOORS = {"deg": 0.01, "mm": 0.1, "rad/s": 1e-3, "rotor speed": 0.1}
"""The least range of the other plots, by unit, and of rotor speeds [rad/s]: below what sensors resolve."""


def recorded(one: OpenFlight, vehicle: Vehicle, rate_hz: float = 50.0) -> Scene:
    """A flight without any model: poses, reference, actuators, commanded and measured wrenches, tracking errors.

    At about `rate_hz` instants a second: more than a screen shows, and than the filter lets through.
    """
    parts = [slice(0, None, max(1, round(1.0 / (rate_hz * s.dt)))) for s in one.samples]
    time = np.concatenate([s.time[part] for s, part in zip(one.samples, parts, strict=True)])
    reference, records = one.flight.reference, one.records
    position, quat = (None, None) if reference is None else _reference(reference, time)
    commands = [(r.state.time, r.commands) for r in records]
    tilts = [(t, c.tilt) for t, c in commands if c.tilt is not None]
    rotors = [(t, c) for t, c in commands if c.tilt is not None and c.rotor_speed is not None]
    thrusts = [] if vehicle.rotors is None else [(t, actuation(vehicle, c).thrust) for t, c in rotors]
    desired = [(r, r.desired) for r in records if r.desired is not None]
    told = not all(np.allclose(values, r.commanded) for r, values in desired)  # before any compensation
    scene = Scene(
        name=one.records[0].flight,
        time=time,
        position_E=_joined(one, parts, "position_E", (0.0, 0.0, 0.0)),
        quat_EB=_joined(one, parts, "quat_EB", (1.0, 0.0, 0.0, 0.0)),
        reference_position_E=position,
        quat_ED=quat,
        tilt=at_stamps(time, tilts) if tilts and vehicle.arms is not None else None,
        thrust=at_stamps(time, thrusts) if thrusts else None,
        wrenches={
            "commanded": _at(time, records, [r.commanded for r in records]),
            "measured": _at(time, records, [r.measured for r in records]),
            **({"desired": at_stamps(time, [(r.time, values) for r, values in desired])} if told else {}),
        },
        floors=_floors(vehicle),
        gaps=_gaps(one),
        notes=tuple(sentences(one.notes)),
        warnings=tuple(warnings(one.notes)),
    )
    pose = one.samples[0].position_E is not None
    rates = _joined(one, parts, "omega_B", (0.0, 0.0, 0.0))
    omega = Series("body rate", "rad/s", time, dict(zip(XYZ, rates.T, strict=True)), floor=FLOORS["rad/s"])
    return replace(scene, series=(*_tracking(scene, pose), *_actuators(scene, records, vehicle), omega))


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


def _reference(reference: ReferenceSeries, time: Array) -> tuple[Array, Array]:
    """Position (K, 3) and attitude (K, 4) of the reference at `time`; nan where it is not logged."""
    knots = reference.time
    position = interpolated(time, knots, reference.position_E)
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
        arms = {vehicle.arm_name(i): values for i, values in enumerate(tilt)}
        found.append(Series("tilt", "deg", scene.time, arms, "Actuators", FLOORS["deg"]))
    known = [(r.state.time, r.commands.rotor_speed) for r in records if r.commands.rotor_speed is not None]
    if known:
        speed = at_stamps(scene.time, known).T
        rotors = {vehicle.rotor_name(i): values for i, values in enumerate(speed)}
        found.append(Series("rotor speed", "rad/s", scene.time, rotors, "Actuators", FLOORS["rotor speed"]))
    return tuple(found)


def _sigmas(time: Array, sigma: Mapping[str, Array]) -> tuple[Series, ...]:
    """The standard deviations themselves, forces and torques apart, of the axes that are known."""
    found = []
    for name, values in sigma.items():
        for kind, unit, part in (("force", "N", values[:, :3]), ("torque", "Nm", values[:, 3:])):
            known = {axis: part[:, i] for i, axis in enumerate(XYZ) if np.isfinite(part[:, i]).any()}
            if known:
                found.append(Series(f"sigma of {name} {kind}", unit, time, known, "Correction"))
    return tuple(found)
