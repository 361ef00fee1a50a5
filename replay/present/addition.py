"""Effects put into a model and taken out: tables and JSON."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from wrenchgap.flight.checks import motion
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.identify.add import Addition
from wrenchgap.learn.identify.bias_and_trim import FlightsApart
from wrenchgap.learn.identify.fit import Fit
from wrenchgap.plant.history import Outcome, Snapshot, Trial
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.notes import sentences
from wrenchgap.replay.present.numbers import change, entries, parameter_rows, quantity, unit_of, unmeasured, user_name
from wrenchgap.replay.present.tables import INTERVAL_LEGEND, Line, Part, before_after, note_lines, parameters


def parts(added: Addition) -> list[Part]:
    """The answer, what was fitted together, its values, the error before and after."""
    out = brief(added)
    if added.refitted:
        out.append(Line(f"already in {added.given.name}, fitted anew: {', '.join(added.refitted)}"))
    if added.together:
        out.append(Line(f"fitted together with what {added.given.name} has: {', '.join(added.together)}"))
    out += [Line(INTERVAL_LEGEND, "dim"), Line()]
    behind = f"filtered at {added.flights[0].records[0].cutoff_hz:g} Hz"
    if (trial := added.trial) is None:
        title = f"on the fitted logs, {behind}"
        out.append(before_after(title, added.rms_before, added.rms_after, added.reduction))
    else:
        title = f"on held-out time of these logs, {behind}"
        out.append(before_after(title, trial.before, trial.after, trial.rms_reduction, trial.noise))
    return [*out, *note_lines(notes(added))]


def brief(added: Addition) -> list[Part]:
    """What was added and what it does on held-out time, values at their limits, and the values."""
    names = " and ".join(e.name for e in added.model.effects if e.name not in added.together)
    trial = added.trial
    title = f"effects of {added.model.name}"
    if trial is None:
        first = Line(f"Added {names}, fitted on all of the logs: nothing was held out to judge it by.", "bold")
    else:
        look = "bold yellow" if trial.outcome is Outcome.WORSE else "bold"
        first = Line(f"Added {names}. On held-out time {verdict(trial)}.", look)
    worse = trial is not None and trial.outcome is Outcome.WORSE
    kept = [f"{added.given.name} without it predicts these flights better: keep that model"] * worse
    warned = note_lines([*kept, *limits(added), *alike(added.fit, added.model.vehicle), *mixed(added)], "warning")
    return [first, *warned, Line(), parameters(added.fit.snapshot, title, added.model.vehicle)]


OUTCOMES = {Outcome.BETTER: "better", Outcome.WORSE: "worse", Outcome.UNCLEAR: "no significant change"}


def verdict(trial: Trial) -> str:
    """What a change of the model did on time that was not fitted."""
    return f"{OUTCOMES[trial.outcome]}: error energy {change(trial.change)}, t {trial.t:.1f}"


ALIKE = 0.95
"""Cosine beyond which two parameters do the same on some flights: the variance of each is ten times its own."""


def cosine(fit: Fit, first: int, second: int) -> float:
    """Of what two unknowns of a fit do to the prediction, axes weighed as in the fit: at one they do the same."""
    return motion.cosine(*(fit.jacobian[:, :, k] * fit.axis_weights for k in (first, second)))


def alike(fit: Fit, vehicle: Vehicle, most: float = ALIKE) -> list[str]:
    """Parameters of two effects that do the same on these flights, by a cosine beyond `most`, and are less than two
    standard deviations from zero: their sum is known, not each.
    """  # noqa: D205
    unsure = np.flatnonzero(np.abs(fit.theta) < 2.0 * fit.std)
    out = []
    for i, j in itertools.combinations(unsure, 2):
        (first, one), (second, other) = fit.parameters[i], fit.parameters[j]
        if first != second and abs(cosine(fit, int(i), int(j))) > most:
            names = (f"{e} {user_name(p.name, vehicle)}" for e, p in ((first, one), (second, other)))
            how = "what they do together is known, not each of them."
            out.append(f"{' and '.join(names)} do the same on these flights: {how} Add {first} or {second}, not both")
    return out


def mixed(added: Addition, most: float = 5.0) -> list[str]:
    """Above `most` times the noise of the sensors is left: values that stand for other effects too."""
    if (trial := added.trial) is None:
        return []
    times = trial.after / trial.noise
    axis = int(np.nanargmax(times))
    if times[axis] < most:
        return []
    size = f"{trial.after[axis]:.2g} {unit_of(axis)}"
    return [
        f"{size} are left of {AXES[axis]}, {times[axis]:.0f} times the noise "
        "of the sensors: where that is another effect, these values stand for it too, and their +- do not cover it; "
        "`wrenchgap explain` says what goes with them."
    ]


def limits(added: Addition) -> list[str]:
    """Parameters that ended where no physical value is plausible any more."""
    return [
        f"{'.'.join(user_name(part, added.model.vehicle) for part in name.split('.'))} ended at the limit of what is "
        "plausible; see docs/effects"
        for name in added.fit.at_bound
    ]


def notes(added: Addition) -> list[str]:
    """What was assumed, repaired or left out."""
    own = [] if added.between_flights is None else [differences(added.between_flights)]
    return [
        *own,
        *sentences([*added.given.notes, *(note for f in added.flights for note in f.notes)]),
    ]


def apart(found: Sequence[FlightsApart], most: int = 5) -> list[str]:
    """That flights do not agree on a constant, in a sentence with the means of `most` of them; none where they do."""
    said = []
    for one in found[:1]:
        means = zip(one.names[:most], one.means, strict=False)
        listed = ", ".join(f"{quantity(mean, unit_of(one.axis))} in {name}" for name, mean in means)
        said.append(
            f"The flights do not agree: on {AXES[one.axis]} what is left on average is {listed}; explain them one by "
            "one, or use `wrenchgap changed`."
        )
    return said


def differences(scatter: Array) -> str:
    """By how much flights differ on average, in words."""
    sizes = ", ".join(f"{AXES[k]} {v:.2g} {unit_of(k)}" for k, v in enumerate(scatter) if v > 0.0)
    return (
        f"Later flights may differ on average by {sizes} (one standard deviation): from what these differ by, and two "
        "that differ as flights usually do. `explain` grants that much to any flight."
    )


def to_json(added: Addition) -> dict[str, Any]:
    """The body of the `add` schema."""
    return {
        "axes": list(AXES),
        "effects": effects_json(added.model.snapshot),
        "refitted": list(added.refitted),
        **entries(added, "rms_before", "rms_after", "at_bound=fit.at_bound"),
        "unmeasured": unmeasured(np.sum([r.noise for f in added.flights for r in f.records], axis=0)),
        "between_flights": added.between_flights,
        "held_out": trial_json(added.trial),
        "cutoff_hz": added.flights[0].records[0].cutoff_hz,
        "notes": [*limits(added), *notes(added)],
    }


def trial_json(trial: Trial | None) -> dict[str, Any] | None:
    """Errors on time that was not fitted, six each; None where all was fitted."""
    if trial is None:
        return None
    names = ("rms_before=before", "rms_after=after", "noise", "fall=rms_reduction", "outcome", "change", "t")
    return {**entries(trial, *names), "verdict": verdict(trial)}


def effects_json(effects: Sequence[Snapshot]) -> list[dict[str, Any]]:
    """Effects with their values."""
    return [{"effect": e.effect, "parameters": e.values} for e in effects]


def model_table(model: Model) -> Part:
    """A model's effects."""
    return parameters(model.snapshot, f"effects of {model.name}", model.vehicle)


def of_axes(added: Addition) -> dict[str, Array]:
    """On the fitted flights, and where there is some on held-out time."""
    fitted = entries(added, "rms_before", "rms_after", "reduction")
    if added.trial is None:
        return fitted
    names = ("held_out_before=before", "held_out_after=after", "held_out_reduction=rms_reduction", "noise")
    return {**fitted, **entries(added.trial, *names)}


def of_parameters(added: Addition) -> list[dict[str, Any]]:
    """All that were fitted together."""
    return parameter_rows(added.fit.snapshot)


def frame(added: Addition) -> list[dict[str, Any]]:
    """One row for each parameter: effect, name, value, std, unit."""
    return [{"effect": s.effect, **vars(v)} for s in added.fit.snapshot for v in s.values]


def picture(added: Addition) -> style.Picture:
    """Axes (1, 2): bars of forces and of torques, on time that was not fitted, where there is any."""
    where = "on the fitted logs" if added.trial is None else "on held-out time of these logs"
    title = f"{', '.join(e.name for e in added.model.effects)} in {added.given.name}: error {where}"
    return style.Picture((1, 2), (10.0, 3.8), lambda axes: _draw(added, axes[0]), title=title)


def _draw(added: Addition, panels: Any) -> None:
    before, after, noise = added.rms_before, added.rms_after, None
    if added.trial is not None:
        before, after, noise = added.trial.before, added.trial.after, added.trial.noise
    bars_by_axis(panels, [("before", "0.6", before), ("after", style.MODELS[0], after)], noise)
    for k in np.flatnonzero(np.isfinite(after)):
        words = change(float(after[k] / max(before[k], 1e-30)) - 1.0)
        look = {"ha": "center", "fontsize": style.SMALL, "color": style.MODELS[0]}
        place = (k % 3 + 0.2, float(after[k]))
        panels[k // 3].annotate(words, place, (0, 2), textcoords="offset points", **look)


def bars_by_axis(panels: Any, rows: list[tuple[str, str, Array]], noise: Array | None) -> None:
    """Groups of bars over x, y, z for force and torque: `rows` of (name, colour, rms (6,)), `noise` (6,) as lines."""
    for panel, part, kind, unit in zip(panels, (slice(3), slice(3, 6)), ("force", "torque"), ("N", "Nm"), strict=True):
        own = [(name, colour, values[part]) for name, colour, values in rows]
        style.bars(panel, own, None if noise is None else noise[part])
        panel.set_ylim(0.0, None)
        panel.set_xticks(range(3), [f"{kind} {axis}" for axis in "xyz"], fontsize=style.USUAL)
        style.labelled(panel, f"{kind} error, rms", unit)
        style.grid(panel, without="x")
        style.legend(panel)
