"""What a replay has to say: a summary, a table for other tools, series for a log, and a figure."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wrenchgap.compensate.uncertainty import default_filter
from wrenchgap.flight import Named, write
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.data.measured_axes import names_of
from wrenchgap.learn.identify.learning import NEARLY_SINGULAR
from wrenchgap.plant.mismatch import output_indices
from wrenchgap.plant.model_file import content_hash, tool_version
from wrenchgap.replay.compensation.replay import Replay
from wrenchgap.replay.compensation.summary import Summary, summarise
from wrenchgap.replay.present.documents import atomic, write_csv
from wrenchgap.replay.present.figures import save
from wrenchgap.replay.present.learning import of_process
from wrenchgap.replay.present.notes import sentences
from wrenchgap.replay.present.numbers import UNIT_HEADS, number, row, share, unit_of
from wrenchgap.replay.present.tables import Part, note_lines, table

if TYPE_CHECKING:
    import pandas as pd


def parts(replay: Replay) -> list[Part]:
    """Wrenches, steps, notes, warnings."""
    summary = summarise(replay)
    wrenches = table(f"{replay.flight.name}: compensation of the {summary.source} wrench", "mean |.|", *UNIT_HEADS)
    wrenches.add_row("correction", *row(summary.correction_mean_abs))
    wrenches.add_row("  its maximum", *row(summary.correction_max_abs))
    before, after = summary.error_before_mean_abs, summary.error_after_mean_abs
    for name, values in (("predicted error before", before), ("predicted error after", after)):
        cells = np.full(len(AXES), np.nan)
        cells[output_indices(summary.outputs)] = values
        wrenches.add_row(name, *row(cells))
    wrenches.add_row("measured - logged command, filtered", *row(summary.measured_minus_logged))
    wrenches.add_row("measured - model and GP, filtered", *row(summary.measured_minus_predicted))
    steps = table("Steps", "what", "value", left=2)
    for what, value in _lines(summary, sigma_unit(replay)):
        steps.add_row(what, value)
    lines = [*note_lines(notes(replay)), *note_lines(warnings(summary), "warning")]
    return [wrenches, steps, *lines]


def sigma_unit(replay: Replay) -> str:
    """Unit of `Steps.sigma`: that of the outputs, or relative where it is the largest of forces and torques."""
    chosen = default_filter(replay.gp, 1.0, None, None, replay.settings.normalise)
    if np.any(chosen.scale != 1.0):
        return "0: at the data, 1: far from it"
    return " or ".join(dict.fromkeys(unit_of(int(k)) for k in output_indices(replay.outputs)))


def warnings(summary: Summary) -> tuple[str, ...]:
    """What a user should not overlook, one sentence each."""
    out = []
    if summary.near_singular > 0:
        out.append(
            f"I + dmu/dW is nearly singular in {share(summary.near_singular)} of the commands (smallest real "
            f"eigenvalue {summary.eigenvalue_min:.2f}, expected above {NEARLY_SINGULAR:.2f}): the GP predicts no "
            "more wrench from more command; excite the command on its own in the training flight."
        )
    if summary.accepted < 0.99:
        out.append(f"in {share(1 - summary.accepted)} of the steps no correction solves the problem.")
    for message, count in summary.trouble.items():
        out.append(f"{count} step(s): {message}")
    if summary.saturation is not None and summary.saturation_logged is not None:
        for name, count in summary.saturation.items():
            more = count - summary.saturation_logged[name]
            if name != "held" and more > 0:
                out.append(f"{name.replace('_', ' ')} would be limited in {more} more of {summary.steps} commands.")
    return tuple(out)


def _lines(summary: Summary, unit: str) -> list[tuple[str, str]]:
    sigma, beta = (" / ".join(row(values)) for values in (summary.sigma, summary.beta))
    solve = (summary.solve_mean_ms, summary.solve_p99_ms, summary.solve_max_ms)
    times = f"{' / '.join(f'{ms:.2f}' for ms in solve)} ms, {summary.iterations_mean:.1f} evaluations"
    lines = [
        ("steps, duration, restarts after gaps", f"{summary.steps}, {summary.duration:.2f} s, {summary.restarts}"),
        ("accepted", share(summary.accepted)),
        (f"sigma [{unit}] 5 / 50 / 95 / 100 %", f"{sigma}, threshold {number(summary.sigma_threshold)}"),
        ("beta 5 / 50 / 95 / 100 %", beta),
        ("correction withheld (beta > 0.5)", f"{share(summary.held_back)} of the time"),
        ("smallest real eigenvalue of I + dmu/dW", number(summary.eigenvalue_min)),
        ("solve time mean / p99 / max", times),
    ]
    if summary.saturation is not None and summary.saturation_logged is not None:
        for name, count in summary.saturation.items():
            what = "arms without thrust" if name == "held" else f"{name.replace('_', ' ')} limited"
            lines.append((what, f"{count} commands, {summary.saturation_logged[name]} without correction"))
    return lines


def to_json(replay: Replay) -> dict[str, Any]:
    """The content of the command's JSON; see docs/json.md."""
    summary = summarise(replay)
    names = ("p5", "p50", "p95", "max")
    numbers = asdict(summary) | {
        "sigma": dict(zip(names, summary.sigma, strict=True)),
        "beta": dict(zip(names, summary.beta, strict=True)),
        "error_fall": 1.0 - summary.error_after_mean_abs / np.maximum(summary.error_before_mean_abs, 1e-12),
    }
    return {
        "axes": list(AXES),
        "unmeasured": _unmeasured(replay),
        "flight": replay.flight.name,
        "settings": asdict(replay.settings),
        **numbers,
        "warnings": list(warnings(summary)),
        "notes": list(notes(replay)),
    }


def _unmeasured(replay: Replay) -> list[str]:
    """Axes on which nothing was measured although others were."""
    known = np.asarray(np.isfinite(replay.measured).any(axis=0))
    return list(names_of(known)) if known.any() else []


def notes(replay: Replay) -> tuple[str, ...]:
    """What a user should know of the log, the command and the GP."""
    found = sentences(replay.notes)
    if replay.computed_from is not None:
        found.append(
            f"{replay.flight.name}: no commanded wrench in the log; computed from {replay.computed_from} with the "
            "model's geometry."
        )
    return tuple(dict.fromkeys((*found, *of_process(replay.caveats))))


def withheld_in_words(replay: Replay) -> list[str]:
    """How much of the correction was withheld, how it fades, and steps in which something went wrong."""
    withheld = share(float(np.mean(replay.steps.beta > 0.5)))
    fading = np.exp(-replay.dt / replay.settings.decay_time)
    return [
        f"{len(replay)} steps of {1e3 * replay.dt:.3g} ms; more than half of the correction is withheld in {withheld} "
        f"of them. a = exp(-dt / tau_d) = {fading:.3f}.",
        *(f"{count} steps: {words}" for words, count in replay.steps.trouble.items()),
    ]


def to_frame(replay: Replay) -> pd.DataFrame:
    """One row for each step: time, wrenches as `desired.force_x` etc., then sigma, beta, cost, iterations, accepted.

    `desired` is the wrench that went in, `commanded` the one that would have come out, `logged` the command of the
    log, `predicted` and `predicted_new` the model with the GP at `logged` and at `commanded`.
    """
    import pandas as pd  # here: others need not wait for it

    columns: dict[str, Any] = {"time": replay.time}
    for name, values in _wrenches(replay).items():
        columns |= {f"{name}.{axis}": values[:, k] for k, axis in enumerate(AXES)}
    return pd.DataFrame(columns | _scalars(replay))


def write_files(
    replay: Replay, log: Path | None, csv: Path | None, parquet: Path | None, figure: Path | None, *, force: bool
) -> None:
    """Log, tables and figure, where they are asked for."""
    if log is not None:
        write_log(replay, log, force=force)
    if csv is not None:
        write_csv(to_frame(replay), csv, digits=None)
    if parquet is not None:
        with atomic(parquet) as partial:
            to_frame(replay).to_parquet(partial, index=False)
    if figure is not None:
        save(replay, figure, force=force)


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
