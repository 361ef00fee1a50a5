"""The figures of the experiments."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt

from wrenchgap.flight.flight import Array

plt.rcParams.update({"axes.grid": True, "grid.alpha": 0.3, "legend.frameon": False})

AXES = ("x", "y", "z")
GREY, BLUE, ORANGE, GREEN = "0.45", "#1f77b4", "#d95f02", "#1b9e77"


def _save(figure: Any, path: Path) -> None:
    figure.savefig(path, dpi=100)
    plt.close(figure)


def prediction_figure(path: Path, traces: Mapping[str, Array]) -> None:
    """Commanded, measured and predicted torque (K, 3) with the 3 sigma band."""
    figure, panels = plt.subplots(3, 1, figsize=(8, 6.5), sharex=True, layout="constrained")
    t = traces["time"]
    for k, panel in enumerate(panels):
        centre, band = traces["predicted"][:, k], 3.0 * traces["sigma"][:, k]
        panel.fill_between(t, centre - band, centre + band, color=BLUE, alpha=0.2, lw=0, label="3 sigma")
        panel.plot(t, traces["commanded"][:, k], color=GREY, label="commanded")
        panel.plot(t, traces["measured"][:, k], color=ORANGE, label="measured")
        panel.plot(t, centre, color=BLUE, label="predicted")
        panel.set_ylabel(f"torque {AXES[k]} [Nm]")
    panels[0].legend(ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    panels[2].set_xlabel("time [s]")
    _save(figure, path)


def box_figure(path: Path, errors: Mapping[str, Array]) -> None:
    """Box plots of |e_R| (N, 3) [rad] by method; whiskers to the 5th and 95th percentile."""
    figure, panels = plt.subplots(1, 3, figsize=(11, 4.8), sharey=True, layout="constrained")
    names = list(errors)
    for k, panel in enumerate(panels):
        panel.boxplot([errors[n][:, k] for n in names], whis=(5, 95), showfliers=False, orientation="horizontal")
        panel.set_xlabel(f"|e_R| about body {AXES[k]} [rad]")
        panel.set_yticks(range(1, len(names) + 1), names)
        panel.grid(False, axis="y")
    panels[0].invert_yaxis()
    _save(figure, path)


def error_figure(path: Path, errors: Mapping[str, tuple[Array, Array]]) -> None:
    """e_R over time: name -> times (N,) [s] and errors (N, 3) [rad]."""
    figure, panels = plt.subplots(3, 1, figsize=(8, 6), sharex=True, layout="constrained")
    for k, panel in enumerate(panels):
        for (name, (t, e)), colour in zip(errors.items(), (GREY, GREEN, BLUE, ORANGE), strict=False):
            panel.plot(t, e[:, k], color=colour, label=name, lw=1.0)
        panel.set_ylabel(f"e_R {AXES[k]} [rad]")
    panels[0].legend(ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    panels[2].set_xlabel("time [s]")
    _save(figure, path)


def step_figure(path: Path, flights: Mapping[str, Mapping[str, Array]]) -> None:
    """e_R, torque correction and sigma after a step, one column per flight: keys pose_time, error, time, ..."""
    figure, panels = plt.subplots(
        3, len(flights), figsize=(3.2 * len(flights), 7), sharex=True, sharey="row", layout="constrained", squeeze=False
    )
    for column, (name, found) in zip(panels.T, flights.items(), strict=True):
        for k, colour in enumerate((BLUE, ORANGE, GREEN)):
            column[0].plot(found["pose_time"], found["error"][:, k], color=colour, label=AXES[k])
            if "correction" in found:
                column[1].plot(found["time"], found["correction"][:, k], color=colour)
        if "sigma" in found:
            column[2].plot(found["time"], found["sigma"], color="0.2")
            column[2].axhline(float(found["threshold"]), color="0.5", ls="--", lw=0.8)
        column[0].set_title(name.replace(", ", "\n"), fontsize=9)
        column[2].set_xlabel("time [s]")
    for panel, words in zip(panels[:, 0], ("e_R [rad]", "correction [Nm]", "sigma [Nm]"), strict=True):
        panel.set_ylabel(words)
    panels[0][0].legend()
    _save(figure, path)


def time_figure(path: Path, times: Mapping[str, Array]) -> None:
    """Share of the solves that take longer than a time [ms], by implementation."""
    figure, panel = plt.subplots(figsize=(7, 4), layout="constrained")
    for name, ms in times.items():
        panel.plot(np.sort(ms), 1.0 - np.arange(len(ms)) / len(ms), label=name)
    panel.axvline(7.5, color="0.5", ls="--", lw=0.8, label="paper, mean")
    panel.axvline(24.0, color="0.5", ls=":", lw=0.8, label="paper, maximum")
    panel.set(xscale="log", yscale="log", xlabel="time of one solve [ms]", ylabel="share that takes longer")
    panel.legend()
    _save(figure, path)


def eigenvalue_figure(path: Path, flights: Mapping[str, tuple[Array, Array]], limit: float) -> None:
    """Smallest real part of the eigenvalues of I + dmu/dW along flights: name -> times (N,), values (N,)."""
    figure, panels = plt.subplots(
        1, len(flights), figsize=(4.5 * len(flights), 3.6), sharey=True, layout="constrained", squeeze=False
    )
    for panel, (name, (t, values)) in zip(panels[0], flights.items(), strict=True):
        panel.plot(t, values, color=BLUE)
        panel.axhline(limit, color=ORANGE, ls="--", lw=1.0, label="wrenchgap warns below")
        panel.set_title(name, fontsize=10)
        panel.set_xlabel("time [s]")
    panels[0][0].set_ylabel("smallest real part")
    panels[0][0].legend()
    _save(figure, path)
