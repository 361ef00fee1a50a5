"""What a replay has to say: a summary, a table for other tools, series for a log, and a figure."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from rich.table import Table

from wrenchgap.flight import Named, write
from wrenchgap.flight.flight import AXES
from wrenchgap.learn.identify.learning import NEARLY_SINGULAR
from wrenchgap.plant.mismatch import output_indices
from wrenchgap.plant.model_file import content_hash, tool_version
from wrenchgap.replay.compensation.replay import Replay
from wrenchgap.replay.present.compensation import sentences
from wrenchgap.replay.present.documents import atomic
from wrenchgap.replay.present.notes import sentences as sentences_of
from wrenchgap.replay.present.numbers import UNIT_HEADS, number, row
from wrenchgap.replay.present.tables import table

Array = NDArray[np.float64]

HELD_BACK = 0.5
"""beta above which the uncertainty filter counts as holding the correction back."""
PERCENTILES = (5, 50, 95, 100)


@dataclass(frozen=True)
class Summary:
    """A replay in numbers. Arrays are (6,) over `AXES` or (L,) over the outputs of the GP, in N and Nm.

    `sigma` and `beta` are the `PERCENTILES`; `held_back`, `accepted` and `near_singular` are shares of the steps.
    `measured_minus_logged` and `measured_minus_predicted` are mean absolute errors, nan where nothing was measured.
    """

    source: str
    steps: int
    duration: float
    restarts: int
    correction_mean_abs: Array
    correction_max_abs: Array
    accepted: float
    iterations_mean: float
    sigma: Array
    sigma_threshold: float
    beta: Array
    held_back: float
    outputs: tuple[str, ...]
    error_before_mean_abs: Array
    error_after_mean_abs: Array
    error_before_max_abs: Array
    error_after_max_abs: Array
    measured_minus_logged: Array
    measured_minus_predicted: Array
    eigenvalue_min: float
    near_singular: float
    saturation: dict[str, int] | None
    saturation_logged: dict[str, int] | None
    solve_mean_ms: float
    solve_p99_ms: float
    solve_max_ms: float
    trouble: dict[str, int]

    def warnings(self) -> tuple[str, ...]:
        """What a user should not overlook, one sentence each."""
        out = []
        if self.near_singular > 0:
            out.append(
                f"I + dmu/dW is nearly singular in {100 * self.near_singular:.1f} % of the commands (smallest real "
                f"eigenvalue {self.eigenvalue_min:.2f}, expected above {NEARLY_SINGULAR:.2f}): the GP claims that more "
                "command gives no more wrench; excite the command on its own in the training flight."
            )
        if self.accepted < 0.99:
            out.append(f"in {100 * (1 - self.accepted):.1f} % of the steps no correction solves the problem.")
        for message, count in self.trouble.items():
            out.append(f"{count} step(s): {message}")
        if self.saturation is not None and self.saturation_logged is not None:
            for name, count in self.saturation.items():
                more = count - self.saturation_logged[name]
                if name != "held" and more > 0:
                    out.append(f"{name.replace('_', ' ')} would be limited in {more} more of {self.steps} commands.")
        return tuple(out)


def summarise(replay: Replay) -> Summary:
    """The numbers of a replay."""
    steps = replay.steps
    size = np.abs(steps.correction)
    before, after = np.abs(steps.mismatch_before), np.abs(steps.mismatch_after)
    solve = 1e3 * steps.solve_time
    return Summary(
        source=replay.source,
        steps=len(replay),
        duration=float(replay.time[-1] - replay.time[0]),
        restarts=replay.restarts,
        correction_mean_abs=size.mean(axis=0),
        correction_max_abs=size.max(axis=0),
        accepted=float(steps.accepted.mean()),
        iterations_mean=float(steps.iterations.mean()),
        sigma=np.percentile(steps.sigma, PERCENTILES),
        sigma_threshold=replay.sigma_threshold,
        beta=np.percentile(steps.beta, PERCENTILES),
        held_back=float((steps.beta > HELD_BACK).mean()),
        outputs=replay.outputs,
        error_before_mean_abs=before.mean(axis=0),
        error_after_mean_abs=after.mean(axis=0),
        error_before_max_abs=before.max(axis=0),
        error_after_max_abs=after.max(axis=0),
        measured_minus_logged=_mean_abs(replay.measured - replay.logged),
        measured_minus_predicted=_mean_abs(replay.measured - replay.predicted),
        eigenvalue_min=float(replay.conditioning.real_min.min()),
        near_singular=float((replay.conditioning.real_min < NEARLY_SINGULAR).mean()),
        saturation=None if replay.saturation is None else asdict(replay.saturation),
        saturation_logged=None if replay.saturation_logged is None else asdict(replay.saturation_logged),
        solve_mean_ms=float(solve.mean()),
        solve_p99_ms=float(np.percentile(solve, 99)),
        solve_max_ms=float(solve.max()),
        trouble=steps.trouble,
    )


def _mean_abs(residual: Array) -> Array:
    """Mean absolute value (6,) of what is known; nan where nothing is."""
    known = np.isfinite(residual).all(axis=1)
    return np.abs(residual[known]).mean(axis=0) if known.any() else np.full(residual.shape[1], np.nan)


def tables(replay: Replay, summary: Summary) -> list[Table]:
    """For the terminal."""
    wrenches = table(f"{replay.flight.name}: compensation of the {summary.source} wrench", "mean |.|", *UNIT_HEADS)
    wrenches.add_row("correction", *row(summary.correction_mean_abs))
    wrenches.add_row("  its maximum", *row(summary.correction_max_abs))
    known = output_indices(summary.outputs)
    for name, values in (
        ("predicted error before", summary.error_before_mean_abs),
        ("predicted error after", summary.error_after_mean_abs),
    ):
        cells = np.full(len(AXES), np.nan)
        cells[known] = values
        wrenches.add_row(name, *row(cells))
    wrenches.add_row("measured - logged command", *row(summary.measured_minus_logged))
    wrenches.add_row("measured - model and GP", *row(summary.measured_minus_predicted))
    steps = table("Steps", "what", "value", left=2)
    for what, value in _lines(summary):
        steps.add_row(what, value)
    return [wrenches, steps]


def _lines(summary: Summary) -> list[tuple[str, str]]:
    sigma, beta = (" / ".join(number(float(v)) for v in values) for values in (summary.sigma, summary.beta))
    lines = [
        ("steps, duration, restarts after gaps", f"{summary.steps}, {summary.duration:.2f} s, {summary.restarts}"),
        ("accepted", f"{100 * summary.accepted:.1f} %"),
        ("sigma 5 / 50 / 95 / 100 %", f"{sigma}, threshold {number(summary.sigma_threshold)}"),
        ("beta 5 / 50 / 95 / 100 %", beta),
        ("filter held back (beta > 0.5)", f"{100 * summary.held_back:.1f} % of the time"),
        ("smallest real eigenvalue of I + dmu/dW", number(summary.eigenvalue_min)),
        (
            "solve time mean / p99 / max",
            f"{summary.solve_mean_ms:.2f} / {summary.solve_p99_ms:.2f} / {summary.solve_max_ms:.2f} ms, "
            f"{summary.iterations_mean:.1f} evaluations",
        ),
    ]
    if summary.saturation is not None and summary.saturation_logged is not None:
        for name, count in summary.saturation.items():
            what = "arms without thrust" if name == "held" else f"{name.replace('_', ' ')} limited"
            lines.append((what, f"{count} commands, {summary.saturation_logged[name]} without correction"))
    return lines


def to_json(replay: Replay, summary: Summary) -> dict[str, Any]:
    """The content of the command's JSON; see docs/json.md."""
    numbers = asdict(summary) | {
        "sigma": dict(zip(("p5", "p50", "p95", "max"), summary.sigma.tolist(), strict=True)),
        "beta": dict(zip(("p5", "p50", "p95", "max"), summary.beta.tolist(), strict=True)),
        "error_fall": 1.0 - summary.error_after_mean_abs / np.maximum(summary.error_before_mean_abs, 1e-12),
    }
    return {
        "axes": list(AXES),
        "flight": replay.flight.name,
        "settings": asdict(replay.settings),
        **numbers,
        "warnings": list(summary.warnings()),
        "notes": list(notes(replay)),
    }


def notes(replay: Replay) -> tuple[str, ...]:
    """What a user should know of the log, the command and the GP."""
    found = sentences_of(replay.notes)
    if replay.computed_from is not None:
        found.append(
            f"{replay.flight.name}: no commanded wrench in the log; computed from {replay.computed_from} with the "
            "model's geometry."
        )
    return tuple(dict.fromkeys((*found, *sentences(replay.caveats))))


def frame(replay: Replay) -> pd.DataFrame:
    """One row for each step: time, wrenches as `desired.force_x` etc., then sigma, beta, cost, iterations, accepted.

    `desired` is the wrench that went in, `commanded` the one that would have come out, `logged` the command of the
    log, `predicted` and `predicted_new` the model with the GP at `logged` and at `commanded`.
    """
    columns: dict[str, Any] = {"time": replay.time}
    for name, values in _wrenches(replay).items():
        columns |= {f"{name}.{axis}": values[:, k] for k, axis in enumerate(AXES)}
    return pd.DataFrame(columns | _scalars(replay))


def write_csv(replay: Replay, path: Path) -> None:
    """`frame` as CSV, with all digits."""
    with atomic(path) as partial:
        frame(replay).to_csv(partial, index=False)


def write_parquet(replay: Replay, path: Path) -> None:
    """`frame` as Parquet."""
    with atomic(path) as partial:
        frame(replay).to_parquet(partial, index=False)


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


def write_figure(replay: Replay, path: Path) -> None:
    """Left: the torques desired, commanded, measured, predicted. Right: correction (dotted: raw), sigma, beta."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 8), layout="constrained")
    axes = figure.subplots(3, 2, sharex=True)
    shown = [k for k in output_indices(replay.outputs) if k >= 3] or list(output_indices(replay.outputs))
    for panel, k in zip(axes[:, 0], shown, strict=False):
        _wrench_panel(panel, replay, int(k))
    for k in output_indices(replay.outputs):
        (line,) = axes[0, 1].plot(replay.time, replay.steps.correction[:, k], lw=0.9, label=AXES[k])
        axes[0, 1].plot(replay.time, replay.steps.optimum[:, k], lw=0.6, ls=":", color=line.get_color())
    axes[0, 1].set_ylabel("correction [N, Nm]")
    axes[1, 1].plot(replay.time, replay.steps.sigma, lw=0.9, color="black", label="sigma")
    if np.isfinite(replay.sigma_threshold):
        axes[1, 1].axhline(replay.sigma_threshold, color="tab:red", lw=0.8, ls="--", label="threshold")
    axes[1, 1].set_ylabel("sigma")
    axes[2, 1].plot(replay.time, replay.steps.beta, lw=0.9, color="black")
    axes[2, 1].set_ylim(-0.03, 1.03)
    axes[2, 1].set_ylabel("beta, 1: distrusted")
    for panel in axes.flat:
        panel.grid(alpha=0.3)
        panel.margins(x=0.01)
    for panel in (axes[0, 0], axes[0, 1], axes[1, 1]):
        panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), fontsize=8, ncols=5, frameon=False)
    for panel in axes[2]:
        panel.set_xlabel("time [s]")
    figure.suptitle(
        f"{replay.flight.name}: compensation of the {replay.source} wrench, model {replay.model.name}",
        x=0.01,
        ha="left",
        fontsize=11,
    )
    with atomic(path) as partial:
        figure.savefig(partial, dpi=110, format="png")


def _wrench_panel(panel: Any, replay: Replay, k: int) -> None:
    panel.plot(replay.time, replay.wrench[:, k], color="0.6", lw=1.0, label=replay.source)
    panel.plot(replay.time, replay.steps.commanded[:, k], color="tab:orange", lw=0.9, label="commanded by replay")
    panel.plot(replay.time, replay.measured[:, k], color="black", lw=0.9, label="measured")
    panel.plot(replay.time, replay.predicted[:, k], color="tab:blue", lw=0.9, label="predicted (as flown)")
    panel.plot(replay.time, replay.predicted_new[:, k], color="tab:green", lw=0.9, ls="--", label="predicted (replay)")
    name, axis = AXES[k].split("_")
    panel.set_ylabel(f"{name} {axis} [{'N' if k < 3 else 'Nm'}]")


__all__ = [
    "Summary",
    "frame",
    "notes",
    "summarise",
    "tables",
    "to_json",
    "write_csv",
    "write_figure",
    "write_log",
    "write_parquet",
]
