"""What a replay has to say: a summary, a table for other tools, series for a log, and a figure."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from wrenchgap.compensate.uncertainty import default_filter
from wrenchgap.flight import Named, write
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.data.measurement import names_of
from wrenchgap.learn.identify.learning import CAUTION
from wrenchgap.plant.mismatch import output_indices
from wrenchgap.plant.model_file import content_hash, tool_version
from wrenchgap.replay.compensation.replay import Replay
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.learning import of_process
from wrenchgap.replay.present.notes import sentences
from wrenchgap.replay.present.numbers import UNIT_HEADS, by_axis, number, row, share, unit_of
from wrenchgap.replay.present.tables import NOTES, Line, Part, note_lines, reductions, table

PERCENTILES = {"p5": 5, "p50": 50, "p95": 95, "max": 100}
"""Of sigma and beta over the steps, by their names in the JSON [%]."""


def summarise(replay: Replay) -> dict[str, Any]:
    """A replay in numbers, by the keys of its JSON.

    Arrays are (6,) over `AXES` or (L,) over the outputs of the GP, in N and Nm. `held_back` (beta above 0.5),
    `accepted` and `near_singular` are shares of the steps. `measured_minus_logged` and `measured_minus_predicted` are
    mean absolute errors behind the filter on both sides, nan where nothing was measured.
    """
    steps, real_min = replay.steps, replay.conditioning.real_min
    size = np.abs(steps.correction)
    before, after = np.abs(steps.mismatch_before), np.abs(steps.mismatch_after)
    solve = 1e3 * steps.solve_time
    return {
        "source": replay.source,
        "steps": len(replay),
        "duration": float(replay.time[-1] - replay.time[0]),
        "restarts": replay.restarts,
        "correction_mean_abs": size.mean(axis=0),
        "correction_max_abs": size.max(axis=0),
        "accepted": float(steps.accepted.mean()),
        "iterations_mean": float(steps.iterations.mean()),
        "sigma": {name: float(np.percentile(steps.sigma, p)) for name, p in PERCENTILES.items()},
        "sigma_threshold": replay.sigma_threshold,
        "beta": {name: float(np.percentile(steps.beta, p)) for name, p in PERCENTILES.items()},
        "held_back": float((steps.beta > 0.5).mean()),
        "outputs": replay.outputs,
        "error_before_mean_abs": before.mean(axis=0),
        "error_after_mean_abs": after.mean(axis=0),
        "error_before_max_abs": before.max(axis=0),
        "error_after_max_abs": after.max(axis=0),
        "error_fall": 1.0 - after.mean(axis=0) / np.maximum(before.mean(axis=0), 1e-12),
        "measured_minus_logged": _mean_abs(replay.measured - replay.logged_filtered),
        "measured_minus_predicted": _mean_abs(replay.measured - replay.predicted),
        "eigenvalue_min": float(real_min.min()),
        "near_singular": float((real_min < CAUTION.nearly_singular).mean()),
        "saturation": None if replay.saturation is None else asdict(replay.saturation),
        "saturation_logged": None if replay.saturation_logged is None else asdict(replay.saturation_logged),
        "solve_mean_ms": float(solve.mean()),
        "solve_p99_ms": float(np.percentile(solve, 99)),
        "solve_max_ms": float(solve.max()),
        "trouble": steps.trouble,
    }


def _mean_abs(residual: Array) -> Array:
    """Mean absolute value (6,) of what is known; nan where nothing is, and on axes that were not measured."""
    known = np.isfinite(residual).any(axis=1)
    return np.abs(residual[known]).mean(axis=0) if known.any() else np.full(residual.shape[1], np.nan)


def parts(replay: Replay) -> list[Part]:
    """The answer, wrenches, steps, notes."""
    summary = summarise(replay)
    steps = table("Steps", ("what", "value"), _lines(summary, sigma_unit(replay)), left=2)
    return [*brief(replay), steps, *note_lines(notes(replay)[NOTES:])]


def brief(replay: Replay) -> list[Part]:
    """How much of the predicted error the correction takes out, warnings, notes on the GP, and the wrenches."""
    summary = summarise(replay)
    before, after = summary["error_before_mean_abs"], summary["error_after_mean_abs"]
    errors = np.full((2, len(AXES)), np.nan)
    errors[:, output_indices(summary["outputs"])] = before, after
    sizes = {
        "correction": summary["correction_mean_abs"],
        "  its maximum": summary["correction_max_abs"],
        "predicted error before": errors[0],
        "predicted error after": errors[1],
        "measured - logged command, filtered": summary["measured_minus_logged"],
        "measured - model and GP, filtered": summary["measured_minus_predicted"],
    }
    title = f"{replay.flight.name}: compensation of the {replay.source} wrench"
    wrenches = table(title, ("mean |.|", *UNIT_HEADS), [(name, *row(values)) for name, values in sizes.items()])
    rounding = 1e-9 * np.max(np.abs(replay.steps.commanded), initial=0.0)  # of which no share says anything
    falls = reductions(1.0 - np.asarray(after) / np.where(np.asarray(before) > rounding, before, np.nan))
    changes = ", ".join(f"{axis} {fall}" for axis, fall in zip(summary["outputs"], falls, strict=True))
    first = (
        f"Predicted change of the mean error with the compensation: {changes}. It is accepted in "
        f"{share(summary['accepted'])} of the steps, and withheld as too uncertain {share(summary['held_back'])} of "
        "the time."
    )
    cautions = [*note_lines(warnings(summary), "warning"), *note_lines(notes(replay)[:NOTES])]
    return [Line(first, "bold"), *cautions, Line(), wrenches]


def sigma_unit(replay: Replay) -> str:
    """Unit of `Steps.sigma`: that of the outputs, or relative where it is the largest of forces and torques."""
    chosen = default_filter(replay.gp, 1.0, None, None, replay.settings.normalise)
    if np.any(chosen.scale != 1.0):
        return "0: at the data, 1: far from it"
    return " or ".join(dict.fromkeys(unit_of(int(k)) for k in output_indices(replay.outputs)))


def warnings(summary: dict[str, Any]) -> tuple[str, ...]:
    """What a user should not overlook, one sentence each."""
    out = []
    if summary["near_singular"] > 0:
        smallest = f"{summary['eigenvalue_min']:.2f}"
        out.append(
            f"I + dmu/dW is nearly singular in {share(summary['near_singular'])} of the commands (smallest real "
            f"eigenvalue {smallest}, expected above {CAUTION.nearly_singular:.2f}): the GP predicts no "
            "more wrench from more command; excite the command on its own in the training flight."
        )
    if summary["accepted"] < 0.99:
        out.append(f"in {share(1 - summary['accepted'])} of the steps no correction solves the problem.")
    for message, count in summary["trouble"].items():
        out.append(f"{count} step(s): {message}")
    if summary["saturation"] is not None and summary["saturation_logged"] is not None:
        for name, count in summary["saturation"].items():
            more = count - summary["saturation_logged"][name]
            if name != "held" and more > 0:
                out.append(f"{name.replace('_', ' ')} would be limited in {more} more of {summary['steps']} commands.")
    return tuple(out)


def _lines(summary: dict[str, Any], unit: str) -> list[tuple[str, str]]:
    sigma, beta = (" / ".join(row(summary[name].values())) for name in ("sigma", "beta"))
    solve = [f"{summary[f'solve_{name}_ms']:.2f}" for name in ("mean", "p99", "max")]
    times = f"{' / '.join(solve)} ms, {summary['iterations_mean']:.1f} evaluations"
    steps = f"{summary['steps']}, {summary['duration']:.2f} s, {summary['restarts']}"
    lines = [
        ("steps, duration, restarts after gaps", steps),
        ("accepted", share(summary["accepted"])),
        (f"sigma [{unit}] 5 / 50 / 95 / 100 %", f"{sigma}, threshold {number(summary['sigma_threshold'])}"),
        ("beta 5 / 50 / 95 / 100 %", beta),
        ("correction withheld (beta > 0.5)", f"{share(summary['held_back'])} of the time"),
        ("smallest real eigenvalue of I + dmu/dW", number(summary["eigenvalue_min"])),
        ("solve time mean / p99 / max", times),
    ]
    if summary["saturation"] is not None and summary["saturation_logged"] is not None:
        for name, count in summary["saturation"].items():
            what = "arms without thrust" if name == "held" else f"{name.replace('_', ' ')} limited"
            lines.append((what, f"{count} commands, {summary['saturation_logged'][name]} without correction"))
    return lines


def to_json(replay: Replay) -> dict[str, Any]:
    """The content of the command's JSON; see docs/json.md."""
    summary, known = summarise(replay), np.asarray(np.isfinite(replay.measured).any(axis=0))
    return {
        "axes": list(AXES),
        "unmeasured": list(names_of(known)) if known.any() else [],
        "flight": replay.flight.name,
        "settings": asdict(replay.settings),
        **summary,
        "warnings": list(warnings(summary)),
        "notes": list(notes(replay)),
    }


def notes(replay: Replay) -> tuple[str, ...]:
    """What a user should know of the log, the command and the GP."""
    found = [*of_process(replay.caveats), *sentences(replay.notes)]
    if replay.computed_from is not None:
        found.append(
            f"{replay.flight.name}: no commanded wrench in the log; computed from {replay.computed_from} with the "
            "model's geometry."
        )
    return tuple(dict.fromkeys(found))


def of_axes(replay: Replay) -> dict[str, Array]:
    """The correction, and what was measured against the command and against the model."""
    names = ("correction_mean_abs", "correction_max_abs", "measured_minus_logged", "measured_minus_predicted")
    summary = summarise(replay)
    return {name: summary[name] for name in names}


def frame(replay: Replay) -> dict[str, Any]:
    """One row for each step: time, wrenches as `desired.force_x` etc., then sigma, beta, cost, iterations, accepted.

    `desired` is the wrench that went in, `commanded` the one that would have come out, `logged` the command of the
    log, `predicted` and `predicted_new` the model with the GP at `logged` and at `commanded`.
    """
    columns: dict[str, Any] = {"time": replay.time}
    for name, values in _wrenches(replay).items():
        columns |= by_axis(name, values)
    return columns | _scalars(replay)


def write_log(replay: Replay, path: Path, *, force: bool) -> Path:
    """The flight as it was flown, and under /replay/ what the compensation would have done. Equal runs, equal bytes."""
    wrenches = {"command" if name == "commanded" else name: v for name, v in _wrenches(replay).items()}
    scalars = {name: np.asarray(v, dtype=float) for name, v in _scalars(replay).items()}
    extra = tuple(Named(f"/replay/{name}", replay.time, v) for name, v in (wrenches | scalars).items())
    metadata = {
        "command": "replay",
        "version": tool_version(),
        "log": replay.flight.path.name,
        "log_sha256": replay.flight.content_hash,
        "model": replay.model.name,
        "model_sha256": content_hash(replay.model),
        "gp_logs": json.dumps([asdict(log) for log in replay.gp.provenance.logs]),
        "source": replay.source,
        "settings": json.dumps(asdict(replay.settings)),
    }
    return write(replay.flight, path, extra, metadata, force)


def _wrenches(replay: Replay) -> dict[str, Array]:
    return {
        "desired": replay.wrench,
        "commanded": replay.steps.commanded,
        "logged": replay.logged,
        "measured": replay.measured,
        "predicted": replay.predicted,
        "predicted_new": replay.predicted_new,
        "correction": replay.steps.correction,
        "optimum": replay.steps.optimum,
    }


def _scalars(replay: Replay) -> dict[str, Any]:
    steps = replay.steps
    return {name: getattr(steps, name) for name in ("sigma", "beta", "cost", "iterations", "accepted")}


REPLAYED, AS_FLOWN, WITH, SIGMA = "tab:orange", "tab:blue", "tab:green", "tab:red"


def picture(replay: Replay) -> style.Picture:
    """A row for each output, and one for the uncertainty filter.

    Axes are (L + 1, 2) for the L outputs of the Gaussian process. Rows of outputs: wrenches on the left, the correction
    with its band on the right. Last row: sigma with its threshold, and beta.
    """
    rows = len(replay.outputs) + 1
    title = f"{replay.flight.name}: compensation of the {replay.source} wrench, model {replay.model.name}; *: filtered"
    return style.Picture((rows, 2), (14.0, 2.1 * rows + 0.8), lambda axes: _draw(replay, axes), title=title, share=True)


def _draw(replay: Replay, axes: Any) -> None:
    gp, optimum = replay.gp, replay.steps.optimum  # no band for a process that looks at more than the command
    bands = None if gp.settings.inputs else gp.std(replay.wrench + optimum)
    for place, k in enumerate(map(int, output_indices(replay.outputs))):
        _wrench_panel(axes[place, 0], replay, k)
        _correction(axes[place, 1], replay, k, None if bands is None else bands[:, place])
    sigma, beta = axes[-1]
    style.curve(sigma, replay.time, replay.steps.sigma, style.MEASURED, "sigma, the largest of the outputs")
    if np.isfinite(replay.sigma_threshold):
        label = "threshold: half of the optimum is withheld"
        sigma.axhline(replay.sigma_threshold, color=style.WARNING, lw=1.0, ls="--", label=label)
    sigma.set_ylim(min(0.0, float(replay.steps.sigma.min())), None)
    style.labelled(sigma, "sigma", sigma_unit(replay))
    style.curve(beta, replay.time, 100.0 * replay.steps.beta, style.MEASURED)
    beta.set_ylim(-3.0, 103.0)
    style.labelled(beta, "beta: share of the\noptimum that is withheld", "%")
    for panel in (*axes[0], sigma):
        style.legend(panel)
    style.over_time(axes)


def _wrench_panel(panel: Any, replay: Replay, k: int) -> None:
    drawn = (
        (replay.wrench, style.COMMANDED, replay.source),
        (replay.steps.commanded, REPLAYED, "with correction"),
        (replay.measured, style.MEASURED, "measured*"),
        (replay.predicted, AS_FLOWN, "predicted*"),
        (replay.predicted_new, WITH, "predicted with correction*"),
    )
    for values, colour, name in drawn:
        if np.isfinite(values[:, k]).any():
            style.curve(panel, replay.time, values[:, k], colour, name)
    style.labelled(panel, *style.QUANTITIES[k])


def _correction(panel: Any, replay: Replay, k: int, std: Array | None) -> None:
    """The optimum, and what the filter lets through of it with the standard deviation of the prediction."""
    correction = replay.steps.correction[:, k]
    style.curve(panel, replay.time, replay.steps.optimum[:, k], "0.3", "optimum", 1.4)
    style.curve(panel, replay.time, correction, REPLAYED, "correction (optimum after the uncertainty filter)")
    if std is not None:
        low, high = correction - std, correction + std
        panel.fill_between(replay.time, low, high, color=SIGMA, alpha=0.25, lw=0, label="± sigma of the GP", zorder=1)
    name, unit = style.QUANTITIES[k]
    style.labelled(panel, f"correction of\n{name}", unit)
