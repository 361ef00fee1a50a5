"""Panels of where a model fails: error budget, map over two quantities, failure maps, correlations with their bands.

`present.where.picture` puts all of them on one page; `budget_picture` and those after it are each alone.
"""

from typing import Any

import numpy as np

from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.errors import length
from wrenchgap.learn.diagnose.failure_map import Dependence
from wrenchgap.learn.diagnose.where import PARTS, Source, Where
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.numbers import AXIS_HEADS, share, unit_of

COLOURS = {"noise": "0.7", "physics": "tab:green", "process": "tab:blue", "unexplained": "tab:red"}
NAMES = {"noise": "sensor noise", "physics": "effects", "process": "Gaussian process", "unexplained": "unexplained"}
SIDES = ((-180, -90, 0, 90), ("back", "right", "front", "left"))
"""Tilt directions [deg] and their names."""
HARMFUL = -100.0
"""Share [%] below which the budget's axis becomes logarithmic: effects that do great harm."""


def budget_picture(where: Where) -> style.Picture:
    """Stacked bars: what the nominal error is made of, per axis and for the whole."""
    return style.Picture((), (8.0, 3.6), lambda panel: draw_budget(panel, where))


def maps_picture(where: Where) -> style.Picture:
    """One panel per quantity: rms of force and torque by bin, against the noise floor."""
    count = len(shown(where))
    columns = 4 if count > 2 else 2
    rows = max(1, -(-count // columns))

    def draw(panels: Any) -> None:
        draw_maps(panels.ravel()[:count], where)
        for spare in panels.ravel()[count:]:
            spare.set_axis_off()

    return style.Picture((rows, columns), (3.7 * columns, 2.9 * rows), draw)


def grid_picture(where: Where) -> style.Picture:
    """Map of the rms over two quantities, force and torque; an empty figure where the logs give none."""
    return style.Picture((1, 2), (8.6, 3.4), lambda panels: draw_grid(panels[0], where))


def correlation_picture(where: Where) -> style.Picture:
    """Autocorrelation of each axis, and its strongest correlation with an input, with bands."""
    return style.Picture((2, 6), (14.0, 5.4), lambda panels: draw_correlations(panels, where))


def shown(where: Where, most: int = 8) -> tuple[Dependence, ...]:
    """The quantities that are drawn."""
    return where.failure_map.dependences[:most]


def explains(dependence: Dependence) -> str:
    """Which share of the error depends on a quantity, in words."""
    return f"explains {share(dependence.of_mean)} of the mean error, {share(dependence.of_size)} of its size"


def draw_budget(panel: Any, where: Where) -> None:
    """Shares of the nominal error energy, by axis and for the whole."""
    shares, whole, place = where.budget.shares(), where.budget.whole(), np.array([0.0, 1.0, 2.0, 3.4, 4.4, 5.4, 7.0])
    above, below = np.zeros(len(place)), np.zeros(len(place))
    for part in PARTS:
        if part == "physics" and not where.budget.has_physics:
            continue
        height = 100.0 * np.append(shares[part], whole[part])
        foot = np.where(height >= 0, above, below)
        name = "given GP" if part == "process" and where.budget.source is Source.GIVEN else NAMES[part]
        panel.bar(place, height, 0.8, bottom=foot, color=COLOURS[part], label=name)
        above, below = above + np.maximum(height, 0.0), below + np.minimum(height, 0.0)
    rms = np.sqrt(where.budget.nominal)
    names = [f"{name}\n{style.written(v, unit_of(k))}" for k, (name, v) in enumerate(zip(AXIS_HEADS, rms, strict=True))]
    panel.set_xticks(place, [*names, "all axes\ntogether"], fontsize=style.SMALL)
    panel.set_ylabel("share of the nominal error energy [%]", fontsize=style.USUAL)
    panel.set_xlabel("axis and its nominal rms", fontsize=style.USUAL)
    panel.tick_params(axis="y", labelsize=style.SMALL)
    panel.axhline(0.0, color="black", lw=0.6)
    if np.nanmin(below) < HARMFUL:
        panel.set_yscale("symlog", linthresh=-HARMFUL)
    style.grid(panel, without="x")
    style.legend(panel)


def draw_maps(panels: Any, where: Where) -> None:
    """One panel for each quantity."""
    for panel, dependence in zip(panels, shown(where), strict=True):
        _draw_map(panel, dependence)
    for panel in panels[:1]:
        if any(np.isnan(d.binned.low).any() for d in shown(where)):
            panel.plot([], [], color="0.4", ls="--", lw=0.8, label="samples in no bin (level flight)")
        figure = panel.get_figure(root=False)
        entries = panel.get_legend_handles_labels()
        figure.legend(*entries, loc="outside upper left", fontsize=style.SMALL, frameon=False, ncols=5)


def _draw_map(panel: Any, dependence: Dependence) -> None:
    """Rms over the bins, force on the left scale, torque on the right, noise floors as thin lines."""
    b = dependence.binned
    other = panel.twinx()
    known = np.isfinite(b.low)
    middle, half = 0.5 * (b.low + b.high)[known], 0.5 * (b.high - b.low)[known]
    for part, axis, colour, word in ((0, panel, style.FORCE, "force"), (1, other, style.TORQUE, "torque")):
        rows = slice(3 * part, 3 * part + 3)
        rms, noise = (length(values[:, rows]) for values in (b.rms, b.noise))
        if np.isnan(rms).all():
            axis.set_yticks([])
            continue
        axis.errorbar(middle, rms[known], xerr=half, fmt="o", ms=3, lw=1.5, color=colour)
        axis.hlines(noise[known], b.low[known], b.high[known], color=colour, lw=1.0, ls=":")
        if not known.all():
            axis.axhline(float(rms[~known][0]), color=colour, lw=0.8, ls="--", alpha=0.7)
        axis.set_ylim(0.0, 1.15 * float(max(rms.max(), noise.max())))
        style.labelled(axis, f"{word} rms", "N" if part == 0 else "Nm", size=style.SMALL)
        axis.yaxis.label.set_color(colour)
        axis.tick_params(axis="y", colors=colour, labelsize=7)
        axis.spines["top"].set_visible(False)
        panel.plot([], [], color=colour, marker="o", ms=3, lw=1.5, label=f"{word} residual, rms in the bin")
        panel.plot([], [], color=colour, ls=":", lw=1.0, label=f"{word} sensor noise (no model gets below)")
    style.labelled(panel, dependence.label, dependence.unit, "x", size=style.SMALL)
    if dependence.name == "direction":
        _sides(panel)
    panel.tick_params(axis="x", labelsize=7)
    title, colour = "no significant dependence", "0.5"
    if dependence.significant:
        title, colour = explains(dependence), "black"
    panel.set_title(title, fontsize=style.SMALL, color=colour)
    panel.grid(alpha=0.25)


def _sides(panel: Any) -> None:
    """Names instead of degrees on the axis of the tilt direction."""
    panel.set_xticks(*SIDES)
    panel.set_xlabel("tilt direction (lowest side of the body)", fontsize=style.SMALL)


def draw_grid(panels: Any, where: Where) -> None:
    """The map over two quantities, or why there is none."""
    grid = where.failure_map.grid
    if grid is None:
        style.nothing(panels[0], "no map over two quantities: the logs lack them")
        panels[1].set_axis_off()
        return
    x_name, x_unit = grid.x_label.removesuffix("]").split(" [")
    y_name, y_unit = grid.y_label.removesuffix("]").split(" [")
    drawn_in = ((panels[0], grid.force, "force", "N"), (panels[1], grid.torque, "torque", "Nm"))
    for panel, values, word, unit in drawn_in:
        if np.isnan(values).all():
            part = where.noise[:3] if word == "force" else where.noise[3:]
            none = "not measured" if np.isnan(part).all() else "too few samples in every cell"
            style.nothing(panel, f"{word}: {none}")
            continue
        drawn = panel.pcolormesh(grid.y_edges, grid.x_edges, values, cmap="viridis", vmin=0.0)
        bar = panel.get_figure(root=False).colorbar(drawn, ax=panel)
        style.labelled(bar.ax, f"{word} residual, rms", unit, size=style.SMALL)
        style.labelled(panel, y_name, y_unit, "x", size=style.SMALL)
        style.labelled(panel, x_name, x_unit, size=style.SMALL)
        panel.set_title(f"{word} residual (white: too few samples)", fontsize=style.SMALL, loc="left")
        panel.tick_params(labelsize=7)
        if grid.y == "direction":
            _sides(panel)


def draw_correlations(panels: Any, where: Where) -> None:
    """Autocorrelations above, correlations with the strongest input below."""
    autos = {auto.axis: auto for auto in where.whiteness.autocorrelation}
    for k, axis in enumerate(AXES):
        panel, auto = panels[0][k], autos.get(axis)
        if auto is None:
            for none in (panel, panels[1][k]):
                style.nothing(none, f"{style.QUANTITIES[k][0]}:\nnot measured")
            continue
        low, high = auto.expected - auto.band, auto.expected + auto.band
        panel.fill_between(auto.lags, low, high, color=style.NOISE, alpha=0.35, lw=0)
        panel.plot(auto.lags, auto.value, color="black", lw=1.0)
        panel.set_title(f"{style.QUANTITIES[k][0]}: {'white' if auto.white else 'not white'}", fontsize=style.SMALL)
        cross, panel = where.whiteness.strongest(auto.axis), panels[1][k]
        if cross is None:
            style.nothing(panel, "no input that\nvaries enough")
            continue
        panel.axhspan(-cross.band, cross.band, color=style.NOISE, alpha=0.35, lw=0)
        panel.plot(cross.lags, cross.value, color="black", lw=1.0)
        panel.plot([cross.lag], [cross.peak], "o", ms=4, color=style.WARNING if cross.outside else "0.55")
        panel.set_title(f"with {cross.input}", fontsize=style.SMALL)
    first = next(k for k, axis in enumerate(AXES) if axis in autos)
    panels[0][first].set_ylabel("autocorrelation [-]\n(green: sensor noise alone)", fontsize=style.SMALL)
    panels[1][first].set_ylabel(
        "correlation with the\nstrongest input [-]\n(green: not significant)", fontsize=style.SMALL
    )
    for panel in np.ravel(panels):
        panel.set_ylim(-1.05, 1.05)
        panel.tick_params(labelsize=7)
    for row, words in zip(panels, ("lag [s]", "lag [s], > 0: residual later"), strict=True):
        for panel in row:
            panel.set_xlabel(words, fontsize=7)
    style.grid(panels)
