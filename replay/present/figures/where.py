"""Figures of `learn.diagnose.where`: failure maps, correlations with their bands, the error budget.

Every function returns a matplotlib figure that belongs to nobody (no pyplot state); `save` writes one.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import AXES
from wrenchgap.learn.diagnose.budget import PARTS
from wrenchgap.learn.diagnose.failure_map import Dependence
from wrenchgap.learn.diagnose.where import Where
from wrenchgap.replay.present.documents import atomic, claim

Array = NDArray[np.float64]

MOST = 8
"""Quantities drawn at most."""
FORCE, TORQUE, NOISE = "tab:blue", "tab:orange", "0.55"
COLOURS = {"noise": "0.7", "physics": "tab:green", "process": "tab:blue", "unexplained": "tab:red"}
NAMES = {"noise": "sensor noise", "physics": "effects", "process": "Gaussian process", "unexplained": "unexplained"}
SIDES = ((-180, -90, 0, 90), ("back", "right", "front", "left"))
SHORT = ("F_x", "F_y", "F_z", "M_x", "M_y", "M_z")


def budget_figure(where: Where) -> Any:
    """Stacked bars: what the nominal error is made of, per axis and for the whole."""
    figure = _figure(8.0, 3.4)
    _draw_budget(figure.subplots(), where)
    return figure


def maps_figure(where: Where) -> Any:
    """One panel per quantity: rms of force and torque by bin, against the noise floor."""
    shown = where.failure_map.dependences[:MOST]
    columns = 4 if len(shown) > 2 else 2
    rows = max(1, -(-len(shown) // columns))
    figure = _figure(3.6 * columns, 2.9 * rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    _draw_maps(panels, where)
    return figure


def grid_figure(where: Where) -> Any:
    """Map of the rms over two quantities, force and torque; an empty figure where the logs give none."""
    figure = _figure(8.0, 3.4)
    _draw_grid(figure, figure.subplots(1, 2), where)
    return figure


def correlation_figure(where: Where) -> Any:
    """Autocorrelation of each axis, and its strongest correlation with an input, with bands."""
    figure = _figure(14.0, 5.2)
    _draw_correlations(figure.subplots(2, 6, squeeze=False), where)
    return figure


def where_figure(where: Where) -> Any:
    """All of it on one page."""
    rows = max(1, -(-min(MOST, len(where.failure_map.dependences)) // 4))
    figure = _figure(15.0, 3.4 + 2.9 * rows + 5.2)
    top, middle, bottom = figure.subfigures(3, 1, height_ratios=[3.4, 2.9 * rows, 5.2])
    left, right = top.subfigures(1, 2, width_ratios=[1.0, 1.15])
    _draw_budget(left.subplots(), where)
    _draw_grid(right, right.subplots(1, 2), where)
    _draw_maps(middle.subplots(rows, 4, squeeze=False).ravel(), where)
    _draw_correlations(bottom.subplots(2, 6, squeeze=False), where)
    figure.suptitle(f"where {where.name} fails: {', '.join(where.flights)}", x=0.01, ha="left", fontsize=11)
    return figure


def save(figure: Any, path: Path, *, force: bool = False) -> None:
    """Write a figure as PNG, all of it or nothing."""
    claim({"--figure": path}, force=force)
    with atomic(path) as partial:
        figure.savefig(partial, dpi=110, format="png")


def _figure(width: float, height: float) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _draw_budget(panel: Any, where: Where) -> None:
    shares = where.budget.shares()
    whole = where.budget.whole()
    place = np.array([0.0, 1.0, 2.0, 3.4, 4.4, 5.4, 7.0])
    above = np.zeros(len(place))
    below = np.zeros(len(place))
    for part in PARTS:
        height = 100.0 * np.append(shares[part], whole[part])
        foot = np.where(height >= 0, above, below)
        label = {"given": "given GP"}.get(where.budget.source, NAMES[part]) if part == "process" else NAMES[part]
        panel.bar(place, height, 0.8, bottom=foot, color=COLOURS[part], label=label)
        above, below = above + np.maximum(height, 0.0), below + np.minimum(height, 0.0)
    rms = np.sqrt(where.budget.nominal)
    names = [
        f"{name}\n{value:.2g} {'N' if i < 3 else 'Nm'}" for i, (name, value) in enumerate(zip(SHORT, rms, strict=True))
    ]
    panel.set_xticks(place, [*names, "whole"])
    panel.set_ylabel("share of the nominal error [%]")
    panel.set_title("error budget; below the axes: nominal rms", fontsize=9, loc="left")
    panel.axhline(0.0, color="black", lw=0.6)
    if below.min() < -100.0:  # effects that do great harm
        panel.set_yscale("symlog", linthresh=100.0)
    panel.legend(fontsize=8, frameon=False, ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.06))


def _draw_maps(panels: Any, where: Where) -> None:
    shown = where.failure_map.dependences[: len(panels)]
    handles = [_draw_map(panel, dependence) for panel, dependence in zip(panels, shown, strict=False)]
    for panel in panels[len(shown) :]:
        panel.set_axis_off()
    if handles:
        words = [h.get_label() for h in handles[0]]
        place = panels[0].get_figure(root=False)
        place.legend(handles[0], words, fontsize=8, frameon=False, ncols=4, loc="outside upper right")


def _draw_map(panel: Any, dependence: Dependence) -> list[Any]:
    """Rms over the bins, force on the left scale, torque on the right, noise pale; returns what a legend needs."""
    b = dependence.binned
    other = panel.twinx()
    known = np.isfinite(b.low)
    for part, axis, colour, word in ((slice(0, 3), panel, FORCE, "force"), (slice(3, 6), other, TORQUE, "torque")):
        rms, noise = (np.sqrt(np.sum(values[:, part] ** 2, axis=1)) for values in (b.rms, b.noise))
        middle = 0.5 * (b.low + b.high)[known]
        half = 0.5 * (b.high - b.low)[known]
        axis.errorbar(middle, rms[known], xerr=half, fmt="o", ms=3, lw=1.5, color=colour, label=f"{word} rms")
        axis.errorbar(middle, noise[known], xerr=half, fmt="none", lw=1.0, color=colour, alpha=0.5, ls=":")
        axis.plot([], [], color=colour, alpha=0.5, lw=1.0, label=f"{word} noise")
        if not known.all():
            axis.axhline(float(rms[~known][0]), color=colour, lw=0.8, ls="--", alpha=0.7)
        axis.set_ylim(0.0, 1.15 * float(max(rms.max(), noise.max())))
        axis.tick_params(axis="y", labelsize=7, colors=colour)
    panel.tick_params(axis="x", labelsize=7)
    if dependence.name == "direction":
        panel.set_xticks(*SIDES)
    panel.set_xlabel(f"{dependence.label} [{dependence.unit}]", fontsize=8)
    sure = "" if dependence.significant else ", chance would do it"
    text = f"mean {100 * dependence.of_mean:.0f} %, size {100 * dependence.of_size:.0f} %{sure}"
    panel.set_title(text, fontsize=8, color="black" if dependence.significant else "0.5")
    panel.grid(alpha=0.25)
    return [*panel.get_legend_handles_labels()[0], *other.get_legend_handles_labels()[0]]


def _draw_grid(figure: Any, panels: Any, where: Where) -> None:
    grid = where.failure_map.grid
    if grid is None:
        for panel in panels:
            panel.set_axis_off()
        panels[0].text(0.0, 0.5, "no map over two quantities: the logs lack them", fontsize=9)
        return
    for panel, values, word in zip(
        panels, (grid.force, grid.torque), ("force rms [N]", "torque rms [Nm]"), strict=True
    ):
        drawn = panel.pcolormesh(grid.y_edges, grid.x_edges, values, cmap="viridis", vmin=0.0)
        figure.colorbar(drawn, ax=panel).ax.tick_params(labelsize=7)
        panel.set_xlabel(grid.y_label, fontsize=8)
        panel.set_title(word, fontsize=9)
        panel.tick_params(labelsize=7)
        if grid.y == "direction":
            panel.set_xticks(*SIDES)
    panels[0].set_ylabel(grid.x_label, fontsize=8)


def _draw_correlations(panels: Any, where: Where) -> None:
    for k, auto in enumerate(where.whiteness.autocorrelation):
        panel = panels[0][k]
        panel.fill_between(
            auto.lags, auto.expected - auto.band, auto.expected + auto.band, color=NOISE, alpha=0.35, lw=0
        )
        panel.plot(auto.lags, auto.value, color="black", lw=1.0)
        panel.set_title(f"{AXES[k]}: {'white' if auto.white else 'not white'}", fontsize=8)
        panel.set_ylim(-1.05, 1.05)
        panel.set_xlabel("lag [s]", fontsize=7)
    panels[0][0].set_ylabel("autocorrelation\n(grey: noise alone)", fontsize=8)
    for k, axis in enumerate(AXES):
        panel = panels[1][k]
        cross = where.whiteness.strongest(axis)
        panel.set_ylim(-1.05, 1.05)
        if cross is None:
            panel.set_axis_off()
            continue
        panel.axhspan(-cross.band, cross.band, color=NOISE, alpha=0.35, lw=0)
        panel.plot(cross.lags, cross.value, color="black", lw=1.0)
        panel.plot([cross.lag], [cross.peak], "o", ms=4, color="tab:red" if cross.outside else NOISE)
        panel.set_title(f"with {cross.input}", fontsize=8)
        panel.set_xlabel("lag [s], + residual follows", fontsize=7)
    panels[1][0].set_ylabel("with its strongest input\n(grey: chance)", fontsize=8)
    for panel in np.ravel(panels):
        panel.tick_params(labelsize=7)
        panel.grid(alpha=0.25)
