"""What `explain` found, in words and in plain types, and how it does on flights that it has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight import so3
from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.comparison import Comparison, compare
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.data.prediction import Predictor
from wrenchgap.learn.diagnose import timing
from wrenchgap.learn.diagnose.timing import Timing
from wrenchgap.learn.identify.explain import Candidate, Explanation, Member
from wrenchgap.plant.model import Model
from wrenchgap.replay.present.design import next_flight

Array = NDArray[np.float64]

CONCENTRATED = 0.7
"""Share of what is left in the worst tenth of the time that is worth saying."""
BEYOND = 1.15
"""A flight lies outside when its 95th percentile exceeds the fitted maximum by this factor."""


@dataclass(frozen=True)
class Range:
    """How far a quantity went: `maximum` over the fitted flights, `percentile` (95th) over a validation flight."""

    quantity: str
    unit: str
    maximum: float
    percentile: float

    @property
    def outside(self) -> bool:
        """Whether the validation flight left what was fitted."""
        return self.percentile > BEYOND * self.maximum


def ranges(fitted: Sequence[Record], unseen: Sequence[Record]) -> list[Range]:
    """Tilt, body rate, speed and force of both sides; tilt and speed only where all logs have a pose."""
    posed = all(r.has_pose for r in (*fitted, *unseen))
    out = []
    for quantity, unit, values in _quantities(posed):
        known = np.concatenate([values(r) for r in fitted])
        new = np.concatenate([values(r) for r in unseen])
        out.append(Range(quantity, unit, float(np.max(known)), float(np.percentile(new, 95))))
    return out


def _quantities(posed: bool) -> list[tuple[str, str, Any]]:
    always = [
        ("body rate", "rad/s", lambda r: np.linalg.norm(r.state_kept.omega_B, axis=1)),
        ("commanded force", "N", lambda r: np.linalg.norm(r.commanded[:, :3], axis=1)),
        ("commanded torque", "Nm", lambda r: np.linalg.norm(r.commanded[:, 3:], axis=1)),
    ]
    with_pose = [
        ("tilt", "deg", lambda r: np.degrees(so3.tilt_angle(r.state_kept.quat_EB))),
        ("speed", "m/s", lambda r: np.linalg.norm(r.state_kept.velocity_E, axis=1)),
    ]
    return with_pose + always if posed else always


@dataclass(frozen=True)
class Validation:
    """The fitted model on flights that were not fitted: `comparison` of nominal, given and fitted model."""

    comparison: Comparison
    ranges: tuple[tuple[str, tuple[Range, ...]], ...]

    @property
    def warnings(self) -> list[str]:
        """One sentence for each quantity that left the fitted range, and for axes that got worse."""
        return [*self._worse(), *self._outside()]

    def _worse(self) -> list[str]:
        given, fitted = self.comparison.evaluations[-2].pooled.rms, self.comparison.evaluations[-1].pooled.rms
        lost = (fitted > 1.1 * given) & (fitted > 1.5 * self.comparison.noise)
        axes = [f"{AXES[k]} ({given[k]:.2g} to {fitted[k]:.2g})" for k in np.flatnonzero(lost)]
        return [f"on the unseen flights the error of {', '.join(axes)} grows with what was named."] if axes else []

    def _outside(self) -> list[str]:
        return [
            f"{flight} lies outside what was fitted: {r.quantity} {r.percentile:.3g} {r.unit} "
            f"(fitted up to {r.maximum:.3g}); the result may not carry over."
            for flight, listed in self.ranges
            for r in listed
            if r.outside
        ]

    @property
    def falls(self) -> Array:
        """Fraction (6,) of the given model's rms that the fitted model takes off."""
        return fall(self.comparison)


def fall(comparison: Comparison) -> Array:
    """Fraction (6,) of rms taken off from the first to the last model."""
    return comparison.falls(comparison.evaluations[-1])


def validate(flights: Sequence[OpenFlight], fitted_on: Sequence[OpenFlight], given: Model, fitted: Model) -> Validation:
    """Given and fitted model on unseen flights."""
    predictors = [Predictor("given", given.wrench_model), Predictor("explained", fitted.wrench_model)]
    known = [r for f in fitted_on for r in f.records]
    listed = tuple((f.records[0].flight, tuple(ranges(known, f.records))) for f in flights)
    return Validation(compare(flights, given, predictors), listed)


def timing_first(found: Timing) -> list[str]:
    """Offsets between the sensor topics of one flight, before any physics: a line each, where they are certain."""
    return [f"timing, {found.flight}: {timing.sentence(o)}" for o in found.sensors if o.certain]


def sentence(explanation: Explanation) -> str:
    """The verdict in plain words."""
    named = " and ".join(_member(explanation, m) for m in explanation.members)
    left = _left(explanation)
    if explanation.verdict == "nothing":
        return f"Nothing is missing that these logs can show. {left}"
    if explanation.verdict == "unknown":
        partly = f"Partly explained by {named}; more is missing than the catalogue can explain." if named else ""
        none = "Something is missing, but no effect of the catalogue explains it."
        return " ".join(filter(None, (partly or none, _clue(explanation), left)))
    groups = "; ".join(" or ".join(group) for group in explanation.groups)
    untold = f" These logs cannot tell apart: {groups}." if groups else ""
    return f"Explained by {named}.{untold} {left}"


def _member(explanation: Explanation, member: Member) -> str:
    """Name with values, and how sure."""
    return f"{_with_values(explanation, member.name)}, {100 * explanation.probability(member):.0f} % sure"


def _clue(explanation: Explanation) -> str:
    """What is known about what is not in the catalogue."""
    clues = []
    if explanation.swing is not None:
        words = explanation.swing.words
        clues.append(f"{words[:1].upper()}{words[1:]}.")
    if explanation.depends is not None and explanation.depends.chosen:
        inputs = " and ".join(g.label for g in explanation.depends.chosen[:3])
        share = f"{100 * explanation.depends.explained:.0f} % of it can be predicted from"
        clues.append(f"What is left depends on {inputs} ({share} them on held-out time).")
    if explanation.concentrated > CONCENTRATED:
        share = f"{100 * explanation.concentrated:.0f} %"
        clues.append(f"{share} of what is left sits in a tenth of the time: see `wrenchgap where`.")
    return " ".join(clues)


def _with_values(explanation: Explanation, name: str) -> str:
    """The effect with its parameters, or of many the three largest, as far as they are comparable with the largest."""
    values = parameters(explanation).get(name, [])
    shown = values
    if len(values) > 3:
        typical = {p.name: p.scale for owner, p in explanation.fit.parameters if owner == name}
        by_size = sorted(values, key=lambda row: -abs(row[1]) / typical[row[0]])
        largest = abs(by_size[0][1]) / typical[by_size[0][0]]
        shown = [row for row in by_size[:3] if abs(row[1]) / typical[row[0]] > 0.3 * largest]
    if not shown:
        return name
    words = ", ".join(f"{n} {v:.3g} {u if u != '1' else ''}".strip() for n, v, _, u in shown)
    return f"{name} ({words})"


def _left(explanation: Explanation) -> str:
    after, noise = explanation.rms_after, explanation.noise
    axis = int(np.argmax(after / np.maximum(noise, 1e-30)))
    unit = "N" if axis < 3 else "Nm"
    return f"Largest remaining error: {AXES[axis]}, {after[axis]:.2g} {unit} rms (sensor noise {noise[axis]:.2g})."


def what_next(explanation: Explanation, source: str, logs: str) -> list[str]:
    """The commands that follow from the verdict."""
    out = [f"to tell {' from '.join(g)}: {next_flight(g, source, [logs])}" for g in explanation.groups]
    if explanation.full:
        out.append("the search ended at its limit of effects: add these, then explain with the new model, for more")
    add = f"wrenchgap add {' '.join(explanation.effects)} -m {source} --from {logs} -o fitted.toml"
    if explanation.verdict == "unknown":
        out.append(f"next: wrenchgap where {logs} -m {source}: something is missing that has no name here")
        return [*out, f"what is named can be added all the same: {add}"] if explanation.effects else out
    return [*out, f"next: {add}"] if explanation.effects else out


def not_tried(explanation: Explanation) -> dict[str, list[str]]:
    """Effects that these logs or this model do not allow, by reason."""
    by_reason: dict[str, list[str]] = {}
    for name, reason in explanation.inapplicable.items():
        by_reason.setdefault(reason.removeprefix(f"effect {name} ").replace(f"effect {name} ", ""), []).append(name)
    return by_reason


def parameters(explanation: Explanation) -> dict[str, list[tuple[str, float, float, str]]]:
    """(parameter, value, std, unit) of the chosen effects as fitted together, by effect."""
    fit = explanation.fit
    out: dict[str, list[tuple[str, float, float, str]]] = {}
    for (name, p), value, std in zip(fit.parameters, fit.theta, fit.std, strict=True):
        out.setdefault(name, []).append((p.name, float(value), float(std), p.unit))
    return out


def to_json(explanation: Explanation, validation: Validation | None) -> dict[str, Any]:
    """The body of the `explain` schema."""
    fitted = parameters(explanation)
    return {
        "verdict": explanation.verdict,
        "effects": list(explanation.effects),
        "groups": [list(group) for group in explanation.groups],
        "members": [_one_member(explanation, m) for m in explanation.members],
        "left": _what_is_left(explanation),
        "ranking": [_candidate(c) for c in explanation.ranking],
        "axes": list(AXES),
        "summary": sentence(explanation),
        "fitted": [{"effect": name, "parameters": _named(fitted.get(name, []))} for name in explanation.effects],
        "steps": [
            {
                "on": list(step.on),
                "chosen": step.chosen,
                "alike": [{"effect": name, "cosine": cosine} for name, cosine in step.alike],
                "candidates": [_candidate(c) for c in step.candidates],
            }
            for step in explanation.steps
        ],
        "dropped": list(explanation.dropped),
        "not_tried": [{"effect": name, "reason": reason} for name, reason in explanation.inapplicable.items()],
        "rms_before": explanation.rms_before,
        "rms_after": explanation.rms_after,
        "noise": explanation.noise,
        "validation": None if validation is None else _validation(validation),
    }


def _one_member(explanation: Explanation, member: Member) -> dict[str, Any]:
    rivals = [
        {
            "effect": r.name,
            "separation": r.separation,
            "cosine": r.cosine,
            "alike": r.alike,
            "worthy": r.candidate.worthy,
            "score": r.candidate.score,
        }
        for r in member.rivals
    ]
    return {
        "effect": member.name,
        "probability": explanation.probability(member),
        "share": member.share,
        "significance": member.significance,
        "evidence": member.evidence,
        "group": [member.name, *(r.name for r in member.alike)],
        "rivals": rivals,
    }


def _what_is_left(explanation: Explanation) -> dict[str, Any]:
    swinging, depends = explanation.swing, explanation.depends
    return {
        "over_noise": explanation.left,
        "in_worst_tenth": explanation.concentrated,
        "swing": None if swinging is None else {**swinging.__dict__, "words": swinging.words},
        "depends_on": None if depends is None else depends.to_json(),
    }


def _candidate(candidate: Candidate) -> dict[str, Any]:
    return {
        "effect": candidate.name,
        "heldout_fall": candidate.falls,
        "score": candidate.score,
        "parameters": _named(candidate.values()),
        "evidence": candidate.evidence,
        "significance": candidate.significance,
        "implausible": list(candidate.implausible),
    }


def _named(values: Sequence[tuple[str, float, float, str]]) -> list[dict[str, Any]]:
    return [{"name": n, "value": v, "std": s, "unit": u} for n, v, s, u in values]


def _validation(validation: Validation) -> dict[str, Any]:
    body = validation.comparison.to_json()
    listed = [
        {"flight": flight, "ranges": [{**r.__dict__, "outside": r.outside} for r in found]}
        for flight, found in validation.ranges
    ]
    return {**body, "fall": validation.falls, "ranges": listed, "warnings": validation.warnings}
