"""A calibration: what was trimmed, by how much, how flights differ, and what that did on held-out time."""

from typing import Any

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.identify.calibrate import Calibration, Fate
from wrenchgap.plant.history import Outcome
from wrenchgap.replay.present import addition, fitted_effects, numbers
from wrenchgap.replay.present.addition import apart, differences, effects_json, limits, trial_json, verdict
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.notes import of_flights, sentences
from wrenchgap.replay.present.numbers import entries, label, number, row, unit
from wrenchgap.replay.present.tables import Line, Part, before_after, first_only, note_lines, table

FATES = {
    Fate.KEPT: "kept",
    Fate.NO_HELP: "no help on held-out time",
    Fate.UNSURE: "left out: helps, but its size may be nothing",
    Fate.ONE_FLIGHT: "helps within flights, not on flights left out whole",
    Fate.AT_LIMIT: "left out: a value at the limit of what is plausible says that the cause is another one",
    Fate.HIDES: "left out: with it a weak rotor would not be found any more",
    Fate.UNTRIED: "not tried",
}
LEGEND = (
    "+-: one standard deviation; has the scatter between flights, and of the thrust the mass's tolerance   scatter: by "
    "how much flights differ beyond their own errors"
)


def parts(found: Calibration) -> list[Part]:
    """The summary, values, what was considered, the error before and after, notes."""
    rows = [
        (t.effect, FATES[t.fate] + (f": {t.reason.reason}" if t.reason else ""), number(t.t, 2)) for t in found.tried
    ]
    considered = table("what was considered", ("effect", "", "t"), rows, left=2)
    out = [*brief(found), considered]
    if found.added is not None:
        out += [Line(LEGEND, "dim"), Line()]
        if (trial := found.added.trial) is not None:
            title = f"on held-out time of these flights, filtered at {found.flights[0].records[0].cutoff_hz:g} Hz"
            out.append(before_after(title, trial.before, trial.after, trial.rms_reduction, trial.noise))
        if len(found.names) > 1:
            out.append(by_flight("each flight, on its held-out time", found.names, found.before, found.after))
        if found.unseen:
            names, before, after = zip(*found.unseen, strict=True)
            out.append(by_flight("flights that were not fitted", names, np.array(before), np.array(after)))
    return [*out, *note_lines(notes(found))]


def brief(found: Calibration) -> list[Part]:
    """The summary, values at their limits, and the values."""
    lines = [Line(text, "bold") for text in (*summary(found), *apart(found.apart))]
    lines += note_lines(crashed(found), "warning")
    if found.added is None:
        return [*lines, Line()]
    return [*lines, *note_lines(limits(found.added), "warning"), Line(), values(found)]


def summary(found: Calibration) -> list[str]:
    """What was changed and what it brought, in a sentence or two."""
    count = f"{len(found.names)} flight{'s' if len(found.names) > 1 else ''}"
    same = f"{found.given.name} stays as it is, and what is written is a copy"
    if (hidden := found.hidden) is not None:
        rotor = numbers.user_name(hidden.parameter, found.given.vehicle)
        lost = f"{rotor} with {numbers.size_in_words(-hidden.change, '1')} less thrust"
        return [
            f"Not calibrated: put into these flights, {lost} is found with {found.given.name}, and not with what helps "
            f"on held-out time; {same}.",
            "These flights do not carry what was fitted. Log motor commands and IMU faster, or fly with excitation.",
        ]
    if found.added is None:
        return [f"Nothing helps on held-out time of {count}: {same}."]
    told, trial = f"Calibrated on {count}: {', '.join(found.effects)}.", found.added.trial
    largest = fitted_effects.largest_of(found.model, found.effects)
    if largest and trial is not None and trial.outcome is not Outcome.BETTER:
        largest = f"Not established: {largest[0].lower()}{largest[1:]}"
    return [
        told if trial is None else f"{told} On held-out time {verdict(trial)}.",
        *([largest] if largest else []),
    ]


def crashed(found: Calibration) -> list[str]:
    """Flights that are no healthy ones."""
    ended = [(f, p.event) for f in found.flights for p in f.phases if p.name == "crash" and p.event is not None]
    return [
        f"{f.flight.name} crashed at {at:.1f} s: no healthy flight, and its cause may be in what is fitted. Calibrate "
        "on flights that went well."
        for f, at in ended
    ]


def values(found: Calibration) -> Part:
    """One row for each parameter."""
    rows = []
    for first, p in zip(first_only(p.effect for p in found.trimmed), found.trimmed, strict=True):
        sizes = (number(p.value, 4), number(p.std, 2), number(p.scatter, 2))
        rows.append((first, label(p.name, found.model.vehicle), *sizes, unit(p.unit)))
    heads = ("effect", "parameter", "value", "+-", "scatter", "unit")
    return table(f"effects of {found.model.name}", heads, rows, left=2, texts=(-1,))


def by_flight(title: str, names: Any, before: Array, after: Array) -> Part:
    """Two rows for each flight."""
    pairs = zip(names, before, after, strict=True)
    rows = [r for name, old, new in pairs for r in ((name, "before", *row(old)), ("", "after", *row(new)))]
    return table(title, ("flight", "rms", *numbers.UNIT_HEADS), rows, left=2)


def notes(found: Calibration) -> list[str]:
    """What was assumed, what only a balance says, what readers repaired."""
    own = []
    if found.given.vehicle.tolerances.mass is None:
        own.append(
            "The model file gives the mass without a tolerance: thrust, mass and inertia scaled together change "
            "nothing that an IMU sees, so the thrust is as sure as the mass. Weigh it, and write the mass as "
            "{ value = ..., tolerance = ... }."
        )
    if len(found.names) == 1:
        own.append("One flight does not show by how much flights differ: later ones may by more than these intervals.")
    if found.added is not None and found.added.between_flights is not None:
        own.append(differences(found.added.between_flights))
    if found.lags and (axes := [AXES[k] for k in found.following]) and len(axes) < len(AXES):
        own.append(
            f"{', '.join(found.lags)}: judged on {', '.join(axes)} alone, where the motion follows the commands; taken "
            "to be the same on the others, which show no lag here."
        )
    return [*own, *sentences(found.given.notes), *of_flights(found.flights)]


def to_json(found: Calibration) -> dict[str, Any]:
    """The body of the `calibrate` schema."""
    added, none = found.added, {"lack": None, "reason": None}
    return {
        "summary": summary(found),
        "flights": list(found.names),
        "axes": list(AXES),
        "unmeasured": numbers.unmeasured(np.sum([r.noise for f in found.flights for r in f.records], axis=0)),
        "cutoff_hz": found.flights[0].records[0].cutoff_hz,
        "effects": effects_json(found.model.snapshot),
        "tried": [
            entries(one, "effect", "fate", "t") | (entries(one.reason, "lack", "reason") if one.reason else none)
            for one in found.tried
        ],
        "parameters": found.trimmed,
        "rms_before": found.before,
        "rms_after": found.after,
        "hidden_rotor": found.hidden,
        "unseen": [{"flight": n, "rms_before": b, "rms_after": a} for n, b, a in found.unseen],
        "held_out": None if added is None else trial_json(added.trial),
        "between_flights": None if added is None else added.between_flights,
        "at_bound": [] if added is None else list(added.fit.at_bound),
        "notes": [*apart(found.apart), *crashed(found), *([] if added is None else limits(added)), *notes(found)],
    }


def of_axes(found: Calibration) -> dict[str, Array]:
    """Scatter between flights and held-out time, where something was changed."""
    return {} if found.added is None else addition.of_axes(found.added)


def of_parameters(found: Calibration) -> list[dict[str, Any]]:
    """What was trimmed, with the scatter between flights."""
    return [entries(p, "effect", "parameter=name", "value", "std", "scatter", "unit") for p in found.trimmed]


def frame(found: Calibration) -> list[dict[str, Any]]:
    """One row for each parameter: effect, name, unit, value, std, scatter."""
    return [entries(p, "effect", "name", "unit", "value", "std", "scatter") for p in found.trimmed]


def picture(found: Calibration) -> style.Picture:
    """The error by axis before and after; raises UsageError where nothing was changed."""
    if found.added is None:
        raise UsageError("calibrate: nothing helped on held-out time, so there is nothing to draw; leave out --figure")
    return addition.picture(found.added)
