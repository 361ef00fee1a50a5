"""The counterfactual: a recorded flight, flown again with something changed.

What the model M does not explain is inferred from the log (`learn.identify.disturbance`) and carried into the re-flight
(`replay.counterfactual.reflight`) as functions of time: a disturbance d(t), the pilot's residual e(t), the allocation's residual a(t).

    W_des = law(state, reference) + e(t)  ->  compensator  ->  W_cmd  ->  allocation + a(t)  ->  plant + d(t)

As long as nothing is changed, the state is the recorded one, the law plus e(t) gives the recorded command, and the
plant plus d(t) gives the recorded motion. The error of this null run against the recorded *odometry* tells how well the
flight was understood, not how well a loop can hide it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap import flight
from wrenchgap.flight import so3
from wrenchgap.flight.flight import AXES, Flight
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.recorded_motion import CUTOFF_HZ
from wrenchgap.learn.data.recording import Recording, read_recording
from wrenchgap.learn.identify.disturbance import Inference, infer
from wrenchgap.plant.closed_loop import Report
from wrenchgap.plant.controller import ControllerGains, attitude_error
from wrenchgap.plant.model import Model
from wrenchgap.plant.trajectory import Recorded, Reference
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.replay.counterfactual.reflight import Compensates, Reflight, as_flight, refly

Array = NDArray[np.float64]

ATTITUDE_GOAL_DEG, POSITION_GOAL_M = 0.5, 0.02
"""Largest error of a null run with which a counterfactual can be believed."""

EXPLAINED_GOAL = 0.5
"""Share of the command's variance below which the control law is called a guess."""


def null_error(inference: Inference, null: Reflight) -> dict[str, float]:
    """How far the null run is from the recorded odometry: attitude [deg] and position [m], largest and rms."""
    odometry, state = inference.recording.odometry, null.flown.state
    inside = (odometry.time >= state.time[0] - 1e-6) & (odometry.time <= state.time[-1] + 1e-6)
    stamps = odometry.time[inside]
    position = np.stack([np.interp(stamps, state.time, c) for c in state.position_E.T], axis=-1)
    quat = so3.interpolate(stamps, state.time, state.quat_EB)
    angle = np.degrees(np.linalg.norm(so3.log(so3.multiply(so3.conjugate(odometry.quat_EB[inside]), quat)), axis=-1))
    distance = np.linalg.norm(position - odometry.position_E[inside], axis=-1)
    return {
        "attitude_deg_max": float(angle.max()),
        "attitude_deg_rms": float(np.sqrt(np.mean(angle**2))),
        "position_m_max": float(distance.max()),
        "position_m_rms": float(np.sqrt(np.mean(distance**2))),
        "duration_s": len(state.time) * inference.recording.dt,
    }


def tracking(time: Array, position_E: Array, quat_EB: Array, reference: Reference) -> dict[str, Any]:
    """Tracking errors of N samples: e_R per axis (see `plant.controller`) and distance from the reference."""
    e = np.abs(attitude_error(so3.matrix(quat_EB), so3.matrix(reference.quat_ED)))
    distance = np.linalg.norm(position_E - reference.position_E, axis=-1)
    return {
        "attitude_error": {
            "mean_abs": e.mean(axis=0).tolist(),
            "median_abs": np.median(e, axis=0).tolist(),
            "rms": np.sqrt(np.mean(e**2, axis=0)).tolist(),
        },
        "position_error_m": {
            "mean": float(distance.mean()),
            "median": float(np.median(distance)),
            "rms": float(np.sqrt(np.mean(distance**2))),
            "max": float(distance.max()),
        },
        "duration_s": float(time[-1] - time[0]),
    }


def tracking_of(inference: Inference, flown: Reflight | None = None) -> dict[str, Any]:
    """Tracking errors of a re-flight, or of the recorded flight by its odometry."""
    r = inference.recording
    if flown is not None:
        state, rows = flown.flown.state, slice(r.first, r.first + len(flown.flown.state.time))
        return tracking(state.time, state.position_E, state.quat_EB, r.reference.take(rows))
    times, odometry = r.time[r.window], r.odometry
    inside = (odometry.time >= times[0] - 1e-6) & (odometry.time <= times[-1] + 1e-6)
    stamps = odometry.time[inside]
    assert r.flight.reference is not None
    asked = Recorded(r.flight.reference, start=0.0).at(stamps)
    return tracking(stamps, odometry.position_E[inside], odometry.quat_EB[inside], asked)


@dataclass(frozen=True)
class Change:
    """What is different in the re-flight; nothing by default.

    plant        effects and vehicle that fly
    gains        of the control law
    believed     vehicle that controller and allocation assume
    compensator  in the loop
    beside       others to compare it with, by name, each flown in its place
    words        the same for tables and provenance
    """

    plant: Model | None = None
    gains: ControllerGains | None = None
    believed: Vehicle | None = None
    compensator: Compensates | None = None
    beside: tuple[tuple[str, Compensates], ...] = ()
    words: tuple[str, ...] = ()


@dataclass(frozen=True, repr=False)
class Counterfactual(Result):
    """An inference, its null run, and the re-flight with the change (the null run itself where nothing changed).

    `uncompensated` is the re-flight with all of the change but its compensator: what the compensated one is to be
    compared with. It is the null run where nothing else was changed, None where no compensator flew. `beside` are the
    re-flights with other compensators in its place.
    """

    inference: Inference
    null: Reflight
    changed: Reflight
    change: Change
    uncompensated: Reflight | None = None
    beside: tuple[tuple[str, Reflight], ...] = ()

    @cached_property
    def null_run(self) -> dict[str, float]:
        """Errors of the null run, see `null_error`."""
        return null_error(self.inference, self.null)

    @cached_property
    def tracking(self) -> dict[str, dict[str, Any]]:
        """Tracking errors of the recorded flight, the null run, the uncompensated one if any, the counterfactual."""
        flown = {"null_run": self.null, "uncompensated": self.uncompensated, "counterfactual": self.changed}
        of = {name: tracking_of(self.inference, one) for name, one in flown.items() if one is not None}
        return {"recorded": tracking_of(self.inference), **of}

    @cached_property
    def baselines(self) -> dict[str, dict[str, Any]]:
        """Tracking errors with the other compensators, by name."""
        return {name: tracking_of(self.inference, one) for name, one in self.beside}

    @cached_property
    def content(self) -> dict[str, Any]:
        """The result as it goes into JSON (docs/json.md, wrenchgap.counterfactual/1)."""
        r = self.inference.recording
        return {
            "flight": r.flight.name,
            "model": self.inference.model.name,
            "changes": list(self.change.words),
            "start_s": float(r.time[r.first]),
            "null_run": self.null_run,
            "tracking": self.tracking,
            "baselines": self.baselines,
            "axes": list(AXES),
            "disturbance": self.inference.statistics,
            "controller_explained": self.inference.explained.tolist(),
            "lost": self.changed.flown.stopped or None,
            "notes": list(self.notes),
        }

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader must know before believing the numbers."""
        r, found = self.inference.recording, [*self.inference.recording.notes]
        null, explained = self.null_run, self.inference.explained
        if self.null.flown.stopped:
            found.append(f"{r.flight.name}: in the null run {self.null.flown.stopped}")
        if null["attitude_deg_max"] > ATTITUDE_GOAL_DEG or null["position_m_max"] > POSITION_GOAL_M:
            found.append(
                f"{r.flight.name}: the null run is {null['attitude_deg_max']:.2f} deg and "
                f"{100 * null['position_m_max']:.1f} cm off the recorded flight at most (goal {ATTITUDE_GOAL_DEG} deg, "
                f"{100 * POSITION_GOAL_M:.0f} cm): IMU and odometry disagree, or the log is too coarse"
            )
        weak = [axis for axis, share in zip(AXES, explained, strict=True) if share < EXPLAINED_GOAL]
        if weak:
            found.append(
                f"{r.flight.name}: the control law of {self.inference.model.name} explains less than "
                f"{100 * EXPLAINED_GOAL:.0f} % of the recorded {', '.join(weak)}: there the re-flight's feedback is a "
                "guess; set [controller] to the gains that flew"
            )
        if self.changed.flown.stopped and self.changed is not self.null:
            found.append(f"{r.flight.name}: {self.changed.flown.stopped}")
        found += [f"{r.flight.name}, {name}: {one.flown.stopped}" for name, one in self.beside if one.flown.stopped]
        return tuple(dict.fromkeys(found))

    @property
    def log(self) -> Flight:
        """The re-flight as a flight on the recorded time base."""
        return as_flight(self.inference, self.changed)

    @property
    def series(self) -> tuple[flight.Named, ...]:
        """What is written beside the flight: disturbance, and what a compensator did."""
        time, steps = self.changed.flown.state.time, self.changed.steps
        named = [
            flight.Named("/disturbance", time, self.changed.flown.disturbance),
            flight.Named("/correction", time, self.changed.commanded - self.changed.desired),
        ]
        for what in ("sigma", "beta", "cost", "iterations") if steps else ():
            values = np.array([float(getattr(step, what)) for step in steps])
            named.append(flight.Named(f"/{what}", time, values))
        return tuple(named)


def counterfactual(
    recording: Recording,
    model: Model,
    change: Change | None = None,
    *,
    cutoff_hz: float = CUTOFF_HZ,
    progress: Report | None = None,
) -> Counterfactual:
    """Infer, fly the null run, and fly again with the change."""
    change = change or Change()
    report = progress or (lambda fraction, words: None)

    def stage(begin: float, end: float, words: str) -> Report:
        return lambda fraction, _: report(begin + (end - begin) * fraction, words)

    inference = infer(recording, model, cutoff_hz=cutoff_hz, progress=stage(0.0, 0.3, "inferring the disturbance"))
    null = refly(inference, progress=stage(0.3, 0.5, "null run"))

    def fly(compensator: Compensates | None, begin: float, end: float, words: str = "counterfactual") -> Reflight:
        return refly(
            inference,
            change.plant,
            gains=change.gains,
            believed=change.believed,
            compensator=compensator,
            progress=stage(begin, end, words),
        )

    others = any(item is not None for item in (change.plant, change.gains, change.believed))
    plain = fly(None, 0.5, 0.6) if others else null
    share = 0.4 / (1 + len(change.beside))
    beside = tuple((name, fly(one, 1.0 - share, 1.0, name)) for name, one in change.beside)
    if change.compensator is None:
        return Counterfactual(inference, null, plain, change, beside=beside)
    changed = fly(change.compensator, 0.6, 0.6 + share)
    return Counterfactual(inference, null, changed, change, plain, beside)


__all__ = ["Change", "Counterfactual", "counterfactual", "null_error", "read_recording", "tracking", "tracking_of"]
