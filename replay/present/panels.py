"""Results as the viewer's panels take them: plain data with the words that a panel shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.comparison import Stretch
from wrenchgap.learn.diagnose.failure_map import Dependence
from wrenchgap.learn.identify import staircase as steps
from wrenchgap.learn.identify.staircase import Basis
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import ModelEffect
from wrenchgap.replay.present.notes import not_tried
from wrenchgap.replay.present.numbers import parameters_in_words, row, share, unit_of
from wrenchgap.replay.present.staircase import label
from wrenchgap.replay.present.where import dependence_in_words
from wrenchgap.viewer.analysis import (
    Candidate,
    Compensated,
    Installed,
    Named,
    NextFlight,
    Ranking,
    Reflown,
    Stair,
    Staircase,
    Value,
)
from wrenchgap.viewer.scene import Motion

if TYPE_CHECKING:
    from wrenchgap.learn import Design, Explanation
    from wrenchgap.replay.compensation.replay import Replay
    from wrenchgap.replay.counterfactual.counterfactual import Counterfactual

PATH_POINTS = 600
"""Points of a designed trajectory that are drawn."""
GHOST_RATE = 50.0
"""Instants per second of a ghost [Hz], about."""
TITLES = {
    Basis.HELD_OUT: "{}, held-out time",
    Basis.UNSEEN: "{} (held out)",
    Basis.FITTED: "{} (fitted to it)",
    Basis.RAW: "{}",
}


def staircase(case: steps.Staircase) -> Staircase:
    """The error step by step."""
    flights = case.flights[0] if len(case.flights) == 1 else f"{len(case.flights)} other flights"
    held_out = case.basis in (Basis.HELD_OUT, Basis.UNSEEN)
    return Staircase(TITLES[case.basis].format(flights), tuple(map(_stair, case.stairs)), _stair(case.noise), held_out)


def _stair(one: steps.Stair) -> Stair:
    return Stair(label(one), one.rms, one.in_all)


def installed(item: ModelEffect, vehicle: Vehicle) -> Installed:
    """An effect of the model, its values, and where they come from."""
    rows = enumerate(zip(item.effect.parameters(vehicle), item.theta, strict=True))
    values = tuple(
        Value(p.name, p.unit, float(v), None if item.std is None else float(item.std[k]), p.low, p.high, p.scale)
        for k, (p, v) in rows
    )
    logs = [file for file, _ in item.provenance.logs]
    source = f"fitted on {', '.join(logs)}" if logs else item.provenance.method or "as given"
    return Installed(item.name, values, source)


def ranking(found: Explanation, flight: str, model: str) -> Ranking:
    """What is missing in a model on a flight, and the evidence."""
    from wrenchgap.replay.present import explanation  # here: others need not wait for it

    named, candidates = [], []
    for m in found.members:
        alike = tuple(r.name for r in m.alike)
        named.append(Named(m.name, found.confidence(m), m.share, m.significance, _values(found, m.name), alike))
    indistinct = {name for n in named for name in n.alike}
    for c in found.ranking:
        chosen, implausible = c.name in found.effects, "implausible" if c.implausible else ""
        mark = "chosen" if chosen else "alike" if c.name in indistinct else implausible
        words = parameters_in_words(c.values, found.model.vehicle)
        candidates.append(Candidate(c.name, c.score, c.significance, c.reduction, words, mark))
    lacking = not_tried(found.untried).items()
    return Ranking(
        flight,
        model,
        str(found.verdict),
        explanation.summary(found),
        tuple(named),
        tuple(candidates),
        found.separable,
        explanation.open_in_words(found),
        tuple(f"{', '.join(names)}: {reason}" for reason, names in lacking),
    )


def _values(found: Explanation, name: str) -> tuple[Value, ...]:
    rows = zip(found.fit.parameters, found.fit.theta, found.fit.std, strict=True)
    return tuple(
        Value(p.name, p.unit, float(v), float(std), p.low, p.high, p.scale) for (n, p), v, std in rows if n == name
    )


def next_flight(found: Design, names: tuple[str, ...]) -> NextFlight:
    """The designed flight, as it is drawn and saved."""
    from wrenchgap.plant import trajectory_file  # here: others need not wait for them
    from wrenchgap.replay.present import design

    time = np.linspace(0.0, found.trajectory.duration, PATH_POINTS)
    reference = found.trajectory.at(time)
    return NextFlight(
        names,
        found.separable,
        design.sentence(found),
        () if found.separable else design.advice(found),
        ", ".join(map(str, found.segments)),
        time,
        reference.position_E,
        reference.quat_ED,
        trajectory_file.dumps(design.finished(found, "_or_".join(names))),
    )


def quantity(found: Dependence) -> str:
    """How the error depends on a quantity."""
    return f"{found.label} ({dependence_in_words(found) if found.score > 0.0 else 'no significant dependence'})"


def doing(stretch: Stretch) -> str:
    """On which axis the error is largest in a stretch, and what the vehicle was doing there."""
    known = (("tilt {:.0f} deg", stretch.tilt_deg), ("{:.2f} rad/s", stretch.rate), ("{:.2f} m/s", stretch.speed))
    return ", ".join([stretch.axis.replace("_", " "), *(form.format(v) for form, v in known if v is not None)])


def compensated(done: Replay) -> Compensated:
    """The mismatch of each output before and after the correction, and how much of it was withheld."""
    from wrenchgap.replay.present import replay  # here: others need not wait for it

    steps_ = done.steps
    before, after = (np.mean(np.abs(m), axis=0) for m in (steps_.mismatch_before, steps_.mismatch_after))
    heads = [f"{axis} [{unit_of(AXES.index(axis))}]" for axis in done.outputs]
    rows = tuple(zip(heads, row(before), row(after), strict=True))
    withheld = float(np.mean(steps_.beta > 0.5))
    fading = np.exp(-done.dt / done.settings.decay_time)
    sentences = [
        f"{len(done)} steps of {1e3 * done.dt:.3g} ms; more than half of the correction is withheld in "
        f"{share(withheld)} of them. a = exp(-dt / tau_d) = {fading:.3f}.",
        *(f"{count} steps: {words}" for words, count in steps_.trouble.items()),
        *replay.notes(done),
    ]
    return Compensated(rows, tuple(sentences))


def reflown(found: Counterfactual, name: str) -> Reflown:
    """The re-simulated flight as it is drawn, and its tracking errors beside the recorded ones; `name` of the GP."""
    from wrenchgap.replay.present import counterfactual  # here: others need not wait for it

    state, commands = found.changed.flown.state, found.changed.flown.commands
    every = max(1, round(1.0 / (GHOST_RATE * found.inference.recording.dt)))
    motion = Motion(
        state.time[::every],
        state.position_E[::every],
        state.quat_EB[::every],
        None if commands.tilt is None else commands.tilt[::every],
        f"compensated by {name}" if found.change.process is not None else "re-simulated, nothing changed",
    )
    runs = [found.tracking[key] for key in ("recorded", "null_run", "counterfactual")]
    attitude = np.degrees(np.arcsin(np.clip([r.attitude_rms for r in runs], 0.0, 1.0)))
    numbers = {f"attitude {axis}, RMS [deg]": attitude[:, k] for k, axis in enumerate("xyz")}
    numbers["position, RMS [cm]"] = np.array([100 * r.position_rms for r in runs])
    numbers["position, max [cm]"] = np.array([100 * r.position_max for r in runs])
    rows = tuple((name, f"{a:.2f}", f"{b:.2f}", f"{c:.2f}") for name, (a, b, c) in numbers.items())
    bound = (
        f"With nothing changed the re-simulated flight is at most {found.null_run.attitude_deg_max:.2f} deg and "
        f"{100 * found.null_run.position_m_max:.1f} cm off the recorded one: this null-run error bounds the accuracy "
        "of what follows."
    )
    return Reflown(motion, rows, (bound, *counterfactual.notes(found)))
