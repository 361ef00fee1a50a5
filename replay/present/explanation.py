"""What `explain` found: the verdict in sentences, tables, JSON."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from wrenchgap.flight.flight import AXES, GRAVITY
from wrenchgap.learn.data.comparison import Validation
from wrenchgap.learn.posterior.classes import Class
from wrenchgap.learn.posterior.explain import Explanation, Verdict
from wrenchgap.learn.posterior.members import Member
from wrenchgap.learn.posterior.table import Candidate
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.replay.present import comparison, left, named, settle, timing
from wrenchgap.replay.present.design import design_command
from wrenchgap.replay.present.notes import sentences, too_short
from wrenchgap.replay.present.numbers import (
    AXIS_HEADS,
    entries,
    parameters_in_words,
    share,
    unit_of,
    unmeasured,
    values_json,
)
from wrenchgap.replay.present.tables import (
    INTERVAL_LEGEND,
    Line,
    Part,
    Table,
    before_after,
    note_lines,
    parameters,
    reductions,
    styled,
    table,
)
from wrenchgap.replay.present.untried import not_tried, reason

if TYPE_CHECKING:
    import pandas as pd

MOST = 10
"""Candidates shown."""
HALF = 0.5
"""Weight of nothing missing below which that is not said."""
MUCH = 0.05
"""Share of the weight that is left, as rms, from which on turbulence alone is not believed."""
MOST_CLASSES = 3
"""Classes that are put in words."""


def parts(found: Explanation) -> list[Part]:
    """Timing, verdict, members, classes, candidates, errors before and after."""
    out: list[Part] = []
    for one in found.timing:
        out += [Line(text, "dim") for text in timing.certain_offsets(one)]
        out += note_lines(timing.warnings(one), "warning")
    out += note_lines(short(found), "warning")
    out += [Line(summary(found), "bold"), Line()]
    if found.members:
        out += [members(found), Line(MEMBERS_LEGEND, "dim"), Line()]
    out += [Line(words) for words in open_in_words(found)] + [Line()]
    out.append(ranking(found))
    out += [Line(RANKING_LEGEND, "dim"), Line()]
    if found.fit.snapshot:
        fitted = parameters(found.fit.snapshot, "fitted together", found.model.vehicle)
        out += [fitted, Line(INTERVAL_LEGEND, "dim"), Line()]
    rows = [("rms before", found.rms_before), ("rms after", found.rms_after), ("sensor noise", found.noise)]
    behind = "".join(f", filtered at {f.records[0].cutoff_hz:g} Hz" for f in found.flights[:1])
    out.append(before_after(f"held-out time of the given logs{behind}", rows, found.reduction))
    if tested := found.validation:
        rows, title = [("rms before", tested.before), ("rms after", tested.after)], ", ".join(tested.comparison.flights)
        out.append(before_after(f"unseen: {title}", rows, tested.reduction))
        out += note_lines(validation_warnings(tested), "warning")
    lacking = not_tried(found.untried).items()
    out += [Line(f"not tried: {', '.join(names)}: {why}", "dim") for why, names in lacking]
    return [*out, *note_lines(sentences(note for f in found.flights for note in f.notes))]


def short(found: Explanation) -> list[str]:
    """A warning where hardly any flight was left to judge by."""
    records = [r for f in found.flights for r in f.records]
    seconds = sum(float(r.time[-1] - r.time[0]) for r in records)
    return too_short(seconds) if records else []


def validation_warnings(tested: Validation) -> list[str]:
    """One sentence for axes that got worse, and for each quantity that left the fitted range."""
    out = []
    if tested.worse:
        before, after = tested.comparison.evaluations[-2].pooled.rms, tested.after
        rows = [(a, AXES.index(a)) for a in tested.worse]
        listed = ", ".join(f"{a} ({before[k]:.2g} to {after[k]:.2g})" for a, k in rows)
        out.append(f"on the unseen flights the error of {listed} grows with the named effects.")
    return out + [
        f"{flight} lies outside what was fitted: {r.quantity} {r.percentile:.3g} {r.unit} (fitted up to "
        f"{r.maximum:.3g}); the result may not carry over."
        for flight, r in tested.outside
    ]


def summary(found: Explanation) -> str:
    """The verdict in plain words."""
    fitted = (named.with_values(found.fit, found.model, m.name) for m in found.members)
    members = [
        f"{said}, confidence {100 * found.confidence(m):.0f} %" for said, m in zip(fitted, found.members, strict=True)
    ]
    names = " and ".join(members)
    residual = _largest_residual(found)
    if found.verdict is Verdict.NOTHING:
        return " ".join(filter(None, (_nothing(found), named.nearest(found), _turbulent(found), residual)))
    if found.verdict is Verdict.UNKNOWN:
        partly = f"Partly explained by {names}; more is missing than the catalogue can explain." if names else ""
        if short(found) and not names:
            return " ".join(
                filter(None, ("Too short to tell what is missing.", named.nearest(found, at_all=True), residual))
            )
        none = "Something is missing, but no effect of the catalogue explains it."
        return " ".join(filter(None, (partly or none, left.clue(found), residual)))
    groups = "; ".join(" or ".join(group) for group in found.groups)
    alike = f"Indistinguishable on these logs: {groups}." if groups else ""
    said = f"Explained by {names}."
    first = (alike, f"As one of them: {said[0].lower()}{said[1:]}") if found.verdict is Verdict.GROUP else (said, alike)
    return " ".join(filter(None, (*first, _turbulent(found), residual)))


def _nothing(found: Explanation) -> str:
    """Nothing is named; but not that nothing is missing, where most of the weight says that something is."""
    sets = found.posterior.sets
    none = sum(s.weight for s in sets if not s.names)
    likeliest = next((s for s in sets if s.names), None)
    if none >= HALF or likeliest is None:
        return "Nothing is missing that these logs can show."
    small = "something" if found.open.any() else "something small"
    names = " + ".join(likeliest.names)
    return (
        f"Nothing is established: nothing is missing ({100 * none:.0f} % of the weight), or {small}, most "
        f"likely {names} ({100 * likeliest.weight:.0f} %); fly longer, or with excitation, to tell."
    )


def _turbulent(found: Explanation) -> str:
    """Axes on which more than noise is left that nothing predicts."""
    axes = [axis for axis, left in zip(AXES, found.open, strict=True) if left]
    if not axes:
        return ""
    words = "more than noise is left, as turbulence leaves it: nothing that was logged predicts it."
    force = found.rms_after[:3][np.isfinite(found.rms_after[:3])]
    of_weight = float(force.max(initial=0.0)) / (found.model.vehicle.body.mass * GRAVITY)
    if of_weight > MUCH:
        words += (
            f" It is {share(of_weight)} of the weight: look at clocks, units and frames (`wrenchgap inspect`) first."
        )
    return f"Open: on {', '.join(axes)} {words}"


def _largest_residual(found: Explanation) -> str:
    after, noise = found.rms_after, found.noise
    axis = int(np.nanargmax(after / np.maximum(noise, 1e-30)))
    size = f"{after[axis]:.2g} {unit_of(axis)} rms"
    return f"Largest remaining error: {AXES[axis]}, {size} (sensor noise {noise[axis]:.2g})."


def what_next(
    found: Explanation, model: str, paths: Sequence[str], options: str = "", to_design: str = ""
) -> list[Line]:
    """The commands that follow from the verdict, for the model and the logs as the user named them.

    `options` are those with which the logs were read, `to_design` those of them that `wrenchgap design` knows; with a
    space before them.
    """
    out = [f"to separate {' from '.join(g)}: {design_command(g, model, paths, to_design)}" for g in found.separable]
    model, logs = shlex.quote(model), shlex.join(paths) + options
    add = f"wrenchgap add {' '.join(found.effects)} -m {model} --from {logs} -o fitted.toml"
    if found.verdict is Verdict.UNKNOWN and short(found) and not found.effects:
        out.append("next: give a longer flight")
    elif found.verdict is Verdict.UNKNOWN:
        out.append(f"next: wrenchgap where {logs} -m {model}: something is missing that the catalogue does not hold")
        out += [f"the named effects can be added all the same: {add}"] if found.effects else []
    elif found.effects:
        out.append(f"next: {add}")
    return [Line(text) for text in out]


MEMBERS_LEGEND = (
    "confidence: weight of the sets of effects that name it, in any of its forms, or one of its group, less "
    "what its own evidence leaves to chance   share: of the error energy that "
    "returns without it   group: indistinguishable from it here   nearest other: and by how many standard errors it "
    "fits worse"
)
RANKING_LEGEND = (
    "* named   = indistinguishable from one that is   score: share of the error energy that is gone   F, M: change of "
    "rms on held-out time   t: paired over blocks of time, significant above 3"
)


def open_in_words(found: Explanation) -> tuple[str, ...]:
    """Classes of sets with their weights, and what would settle which of them is true, a sentence each."""
    sets = [settle.in_words(c) for c in found.classes[:MOST_CLASSES] if c.weight >= settle.LIGHT]
    return (*sets, *(line.text for line in settle.lines(found.posterior.settle)))


def members(found: Explanation) -> Table:
    """The effects that were named: confidence, size, and what comes nearest in their place."""
    out = table("named", "effect", "confidence", "share", "t", "group", "nearest other", left=1)
    for column in out.columns[-2:]:
        column.justify = "left"
    for m in found.members:
        group = ", ".join(f"{r.name} ({share(r.weight)})" for r in m.alike)
        others = [r for r in m.rivals if not r.alike]
        far = f"{others[0].name} ({others[0].separation:.1f})" if others else "-"
        sure = f"{100 * found.confidence(m):.0f} %"
        out.add_row(m.name, sure, share(m.share), f"{m.significance:.1f}", group or "-", far)
    return out


def _together(candidate: Candidate) -> str:
    """Its name, with those of its companions."""
    return " + ".join(candidate.names)


def ranking(found: Explanation) -> Table:
    """Candidates, each by itself, best first; those that are named or indistinguishable from a named one are marked."""
    out = table("each effect by itself", "", "effect", "score", *AXIS_HEADS, "t", "parameters", left=2)
    out.columns[-1].justify = "left"
    alike = {name for m in found.members for r in m.alike for name in r.names}
    for k, candidate in enumerate(found.ranking):
        mark = "*" if candidate.name in found.effects else "=" if candidate.name in alike else ""
        if k >= MOST and not mark:
            continue
        limit = styled(" (implausible: at its limit)" if candidate.implausible else "", "red")
        numbers = (f"{candidate.score:.3f}", *reductions(candidate.reduction), f"{candidate.significance:.1f}")
        words = styled(parameters_in_words(candidate.values, found.model.vehicle)) + limit
        out.add_row(mark, _together(candidate), *numbers, words, style="bold" if mark == "*" else "")
    return out


def to_json(found: Explanation) -> dict[str, Any]:
    """The body of the `explain` schema."""
    fitted = {s.effect: s.values for s in found.fit.snapshot}
    ranked = [_candidate_json(c) for c in found.ranking]
    return {
        "verdict": str(found.verdict),
        "effects": list(found.effects),
        "groups": [list(group) for group in found.groups],
        "members": [_member_json(found, m) for m in found.members],
        "left": left.to_json(found),
        "ranking": ranked,
        "axes": list(AXES),
        "summary": summary(found),
        "fitted": [{"effect": name, "parameters": values_json(fitted.get(name, ()))} for name in found.effects],
        "steps": [{"on": [], "chosen": _first(found), "alike": [], "candidates": ranked}],
        "classes": [class_json(c, found.model.vehicle) for c in found.classes],
        "settle": settle.to_json(found.posterior.settle),
        "firm": list(found.firm),
        "open": [axis for axis, left in zip(AXES, found.open, strict=True) if left],
        "air": None if found.air is None else entries(found.air, "wind_E", "std"),
        "dropped": [],
        "not_tried": [{"effect": u.effect, "lack": str(u.lack), "reason": reason(u)} for u in found.untried],
        **entries(found, "rms_before", "rms_after", "noise"),
        "unmeasured": unmeasured(found.noise),
        "validation": None if found.validation is None else _validation_json(found.validation),
        "flights": [f.records[0].flight for f in found.flights],
        "timing": [timing.to_json(one) for one in found.timing],
        "cutoff_hz": found.flights[0].records[0].cutoff_hz if found.flights else None,
        "notes": sentences(note for f in found.flights for note in f.notes),
    }


def _first(found: Explanation) -> str | None:
    """The best candidate by itself that is named."""
    return next((c.name for c in found.ranking if c.name in found.effects), None)


def class_json(one: Class, vehicle: Vehicle) -> dict[str, Any]:
    """One entry of `classes`."""
    return {
        "weight": one.weight,
        "sets": [{"effects": list(s.names), "weight": s.weight} for s in one.sets],
        "established": [{"effect": name, "parameters": one.sets[0].values(vehicle)[name]} for name in one.established],
        "settle": settle.to_json(one.settle),
    }


def _member_json(found: Explanation, member: Member) -> dict[str, Any]:
    rivals = [{**entries(r, "effect=name", "separation", "cosine", "alike", "weight")} for r in member.rivals]
    return {
        "effect": member.name,
        "probability": found.confidence(member),
        **entries(member, "share", "significance", "evidence"),
        "group": [member.name, *(r.name for r in member.alike)],
        "rivals": rivals,
    }


def _candidate_json(candidate: Candidate) -> dict[str, Any]:
    names = ("effect=name", "heldout_fall=reduction", "score", "parameters=values", "evidence", "significance")
    return {**entries(candidate, *names, "companions", "implausible"), "parameters": values_json(candidate.values)}


def _validation_json(tested: Validation) -> dict[str, Any]:
    body = comparison.to_json(tested.comparison)
    ranges = [(flight, [{**vars(r), "outside": r.outside} for r in found]) for flight, found in tested.ranges]
    listed = [{"flight": flight, "ranges": found} for flight, found in ranges]
    return {**body, "fall": tested.reduction, "ranges": listed, "warnings": validation_warnings(tested)}


def to_frame(found: Explanation) -> pd.DataFrame:
    """One row for each candidate of the first step: effect, score, t, evidence, reduction by axis, parameters."""
    import pandas as pd  # here: others need not wait for it

    rows = []
    for c in found.ranking:
        numbers = entries(c, "score", "t=significance", "evidence")
        axes = {f"reduction.{axis}": float(v) for axis, v in zip(AXES, c.reduction, strict=True)}
        words = {"parameters": parameters_in_words(c.values)}
        rows.append({"effect": c.name, "named": c.name in found.effects, **numbers, **axes, **words})
    return pd.DataFrame(rows)
