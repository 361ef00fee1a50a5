"""What the command line asks of a counterfactual, and what it shows and writes of one."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wrenchgap import flight
from wrenchgap.compensate.lbfgs import NotCompiled
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.model_file import tool_version
from wrenchgap.plant.simulation.tracking import Tracking
from wrenchgap.replay.compensation import compensators as compensating
from wrenchgap.replay.counterfactual import counterfactual as resimulated
from wrenchgap.replay.counterfactual.counterfactual import CHANGED, NULL_RUN, Counterfactual
from wrenchgap.replay.present import learning
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.notes import sentence, sentences
from wrenchgap.replay.present.numbers import UNIT_HEADS, capitalised, entries, row, share, unmeasured
from wrenchgap.replay.present.tables import NOTES, Line, Part, note_lines, reductions, table
from wrenchgap.replay.present.verdicts import margin_in_words, observer_in_words, observer_json


def notes(result: Counterfactual) -> tuple[str, ...]:
    """What a reader must know before relying on the numbers, of the result, the GP, and the flight."""
    log, model = result.inference.recording.flight, result.inference.model
    found = [_sentence(one, log.name, model.name) for one in result.caveats]
    if (process := result.change.process) is not None:
        found += learning.of_process(compensating.caveats(process, model, log))
    return tuple(dict.fromkeys((*found, *sentences(result.inference.recording.notes))))


def _sentence(caveat: resimulated.Caveat, flight: str, model: str) -> str:
    match caveat:
        case resimulated.ReferenceEnds():
            return f"{flight}: the reference covers only a part of the re-simulation; its ends are held."
        case resimulated.ControlLost(run, lost):
            return f"{flight}{_WHERE.get(run, f', {run}:')} {lost}; the re-simulation ends there"
        case resimulated.NullRunOff(off):
            return (
                f"{flight}: the null run is {off.attitude_deg_max:.2f} deg and {100 * off.position_m_max:.1f} cm off "
                f"the recorded flight at most (goal {resimulated.ATTITUDE_GOAL_DEG} deg, "
                f"{100 * resimulated.POSITION_GOAL_M:.0f} cm): IMU and odometry disagree, or the log is too coarse"
            )
        case resimulated.WeakLaw(axes):
            return (
                f"{flight}: the control law of {model} explains less than {100 * resimulated.EXPLAINED_GOAL:.0f} % of "
                f"the recorded {', '.join(axes)}: there the re-simulated feedback is unreliable; set [controller] to "
                "the gains of the flight"
            )
        case resimulated.CompensationHarms(before, after):
            return (
                f"with this compensation the attitude error grows from {before:.3f} to {after:.3f} deg (norm of the "
                "axes' means): do not fly it; see what `wrenchgap learn --validate` says of the GP"
            )
        case resimulated.FlownPlainly(reason):
            return f"{flight}: re-simulated in plain numpy, which takes a hundred times as long as compiled: {reason}."
        case NotCompiled():
            return sentence(caveat)


_WHERE = {NULL_RUN: ": in the null run", CHANGED: ":"}


def parts(result: Counterfactual) -> list[Part]:
    """The tracking errors, the null run, the disturbance."""
    null, size = result.null_run, result.inference.size
    off = [
        ("attitude [deg]", f"{null.attitude_deg_max:.3f}", f"{null.attitude_deg_rms:.3f}"),
        ("position [mm]", f"{1e3 * null.position_m_max:.2f}", f"{1e3 * null.position_m_rms:.2f}"),
    ]
    first = table("null run: nothing changed, against the recorded odometry", ("", "largest", "rms"), off)
    sizes = {"mean": size.mean, "rms": size.rms, f"rms above {size.fast_hz:g} Hz": size.rms_fast, "max": size.largest}
    disturbance = [(f"disturbance, {name}", *row(values)) for name, values in sizes.items()]
    explained = ("command explained by the control law", *(share(float(s)) for s in result.inference.explained))
    second = table("what the model does not explain", ("", *UNIT_HEADS), [*disturbance, explained])
    checked = [] if result.margin is None else [Line(margin_in_words(result.margin))]
    process = result.change.process
    checked += [Line(words) for words in [observer_in_words(process)] if words] if process is not None else []
    return [*brief(result), first, second, *checked, *note_lines(notes(result)[NOTES:])]


def brief(result: Counterfactual) -> list[Part]:
    """The attitude error with and without the change, what the null run bounds, notes, and the tracking errors."""
    words = "; ".join(result.change.words)
    names = {"recorded": "recorded", "null_run": "null run", "counterfactual": words}
    if result.uncompensated is not result.null:
        names["uncompensated"] = "the same, not compensated"
    before = "uncompensated" if result.uncompensated is not None else "null_run"
    heads = ("", "mean x", "y", "z", "median x", "y", "z", "mean |p|", "largest")
    third = table("tracking error: |e_R| per axis [deg], distance from the reference [mm]", heads)
    errors = {key: _errors(one) for key, one in result.tracking.items()}
    rows = [(names[key], values) for key, values in errors.items() if names.get(key)]
    for name, values in [*rows, *((f"instead: {name}", _errors(one)) for name, one in result.baselines.items())]:
        third.add_row(name, *(f"{v:.3f}" for v in values[:6]), *(f"{v:.1f}" for v in values[6:]))
    if words:
        # of an axis that hardly errs any change is large in per cent
        least = np.repeat([resimulated.WORSE_DEG, 0.0], (6, 2))
        falls = 1.0 - errors["counterfactual"] / np.where(errors[before] > least, errors[before], np.nan)
        third.add_row("change", *reductions(falls))
    norms = {key: float(np.linalg.norm(one[:3])) for key, one in errors.items()}
    said = (
        [
            f"{capitalised(words)}: attitude error {norms[before]:.2f} to {norms['counterfactual']:.2f} deg "
            "(norm of the axes' means)."
        ]
        if words
        else []
    )
    said.append(null_run_in_words(result))
    lines = [Line(text, "bold" if k == 0 else "") for k, text in enumerate(said)]
    return [*lines, *note_lines(notes(result)[:NOTES]), Line(), third]


def _errors(one: Tracking) -> Array:
    """Mean and median of |e_R| per axis as angles [deg], mean and largest distance [mm]: (8,)."""
    sines = np.concatenate((one.attitude_mean, one.attitude_median))
    return np.array([*np.degrees(np.arcsin(np.minimum(sines, 1.0))), 1e3 * one.position_mean, 1e3 * one.position_max])


def null_run_in_words(result: Counterfactual) -> str:
    """What the null run bounds."""
    null = result.null_run
    return (
        f"With nothing changed the re-simulated flight is at most {null.attitude_deg_max:.2f} deg and "
        f"{100 * null.position_m_max:.1f} cm off the recorded one: this null-run error bounds the accuracy of what "
        "follows."
    )


def tracking_rows(result: Counterfactual) -> list[tuple[str, ...]]:
    """Names and tracking errors of the recorded flight, the null run and the re-simulation, as the page has them."""
    runs = [result.tracking[key] for key in ("recorded", NULL_RUN, CHANGED)]
    attitude = np.degrees(np.arcsin(np.clip([r.attitude_rms for r in runs], 0.0, 1.0)))
    numbers = {f"attitude {axis}, RMS [deg]": attitude[:, k] for k, axis in enumerate("xyz")}
    numbers["position, RMS [cm]"] = np.array([100 * r.position_rms for r in runs])
    numbers["position, max [cm]"] = np.array([100 * r.position_max for r in runs])
    return [(name, *(f"{v:.2f}" for v in values)) for name, values in numbers.items()]


def write_log(
    result: Counterfactual, path: Path, inputs: Sequence[Mapping[str, str]] = (), *, force: bool = False
) -> None:
    """The re-flight as MCAP, with the disturbance, the compensator's decisions and where it all comes from."""
    null = result.null_run
    metadata = {
        "command": "counterfactual",
        "version": tool_version(),
        "changes": "; ".join(result.change.words) or "nothing",
        "null_run": f"{null.attitude_deg_max:.4f} deg, {null.position_m_max:.5f} m at most",
    }
    metadata |= {f"{i['role']}": f"{i['file']} {i['sha256']}" for i in inputs}
    flight.write(result.log, path, extra=result.series, metadata=metadata, force=force)


def to_json(result: Counterfactual) -> dict[str, Any]:
    """The body of the JSON (docs/json.md, wrenchgap.counterfactual/1)."""
    inference, lost = result.inference, result.changed.flown.lost
    r, size = inference.recording, inference.size
    return {
        "flight": r.flight.name,
        "model": inference.model.name,
        "changes": list(result.change.words),
        "start_s": float(r.time[r.first]),
        "null_run": result.null_run,
        "tracking": {name: _tracking_json(one) for name, one in result.tracking.items()},
        "baselines": {name: _tracking_json(one) for name, one in result.baselines.items()},
        "axes": list(AXES),
        "disturbance": entries(size, "mean", "rms", "rms_above_10_hz=rms_fast", "max_abs=largest", "pull_rms=rms_pull"),
        "unmeasured": unmeasured(r.record.noise),
        "stability_margin": None if result.margin is None else min(result.margin.least, 1e6),
        "observer": None if result.change.process is None else observer_json(result.change.process),
        "controller_explained": inference.explained,
        "lost": None if lost is None else f"{lost}; the re-simulation ends there",
        "notes": list(notes(result)),
    }


def _tracking_json(one: Tracking) -> dict[str, Any]:
    attitude = entries(one, "mean_abs=attitude_mean", "median_abs=attitude_median", "rms=attitude_rms")
    position = entries(one, *(f"{name}=position_{name}" for name in ("mean", "median", "rms", "max")))
    return {"attitude_error": attitude, "position_error_m": position, "duration_s": one.duration}


def of_axes(result: Counterfactual) -> dict[str, Any]:
    """The disturbance that was inferred, and the share of the command that the control law explains."""
    names = ("mean", "rms", "rms_above_10_hz=rms_fast", "max_abs=largest")
    return {**entries(result.inference.size, *names), "controller_explained": result.inference.explained}


def frame(result: Counterfactual) -> list[dict[str, Any]]:
    """One row for each run, baselines too: |e_R| by axis, a sine, and the distance from the reference [m]."""
    rows = []
    for name, one in {**result.tracking, **result.baselines}.items():
        sines = {"mean": one.attitude_mean, "rms": one.attitude_rms}
        axes = {f"attitude_{k}.{axis}": float(v[n]) for k, v in sines.items() for n, axis in enumerate("xyz")}
        rows.append({"run": name, **axes, **entries(one, "position_mean", "position_rms", "position_max", "duration")})
    return rows


COLOURS = {"recorded": "0.6", "null run": style.MEASURED, "changed": "tab:blue", "not compensated": "tab:orange"}


def picture(result: Counterfactual) -> style.Picture:
    """Axes (4, 1), over time: attitude error about x, y, z of the body, and the distance from the reference."""
    words = "; ".join(result.change.words) or "nothing changed"
    title = f"{result.inference.recording.flight.name}, re-simulated: {style.shortened(words, 90)}"
    return style.Picture((4, 1), (11.0, 8.2), lambda axes: _draw(result, axes), title=title, share=True)


def _draw(result: Counterfactual, axes: Any) -> None:
    panels = axes[:, 0]
    runs = {"recorded": result.inference.recording.tracking_errors, "null run": result.null.tracking_errors}
    if result.uncompensated is not None and result.uncompensated is not result.null:
        runs["not compensated"] = result.uncompensated.tracking_errors
    if result.changed is not result.null:
        runs["changed"] = result.changed.tracking_errors
    for name, errors in runs.items():  # the last on top
        angles = np.degrees(np.arcsin(np.clip(errors.attitude, -1.0, 1.0)))
        width = 1.8 if name == "recorded" else 0.9
        for panel, values in zip(panels, (*angles.T, errors.position), strict=True):
            style.curve(panel, errors.time, values, COLOURS[name], name, width)
    for panel, axis in zip(panels, "xyz", strict=False):
        panel.axhline(0.0, color="0.5", lw=0.6)
        style.labelled(panel, f"attitude error\nabout {axis}", "deg")
    panels[3].set_ylim(0.0, None)
    style.labelled(panels[3], "distance from\nthe reference", "m")
    style.legend(panels[0])
    style.over_time(axes, "time in flight")
