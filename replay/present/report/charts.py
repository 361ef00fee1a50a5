"""Charts of the report, as data that a page carries inside itself."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.learn.data.comparison import Comparison
from wrenchgap.learn.identify.explain import Candidate
from wrenchgap.learn.identify.staircase import Staircase

Array = NDArray[np.float64]

COLOURS = ("#4c72b0", "#dd8452", "#55a868")
AXIS_NAMES = ("force x [N]", "force y [N]", "force z [N]", "torque x [Nm]", "torque y [Nm]", "torque z [Nm]")
MOST_POINTS = 4000
"""Samples drawn of a flight at most."""


def inline(figure: Any, form: str = "png", dpi: int = 110) -> str:
    """A figure as a data URI."""
    stream = io.BytesIO()
    metadata = {"Date": None} if form == "svg" else None
    figure.savefig(stream, format=form, dpi=dpi, metadata=metadata)
    kind = "svg+xml" if form == "svg" else form
    return f"data:image/{kind};base64,{base64.b64encode(stream.getvalue()).decode('ascii')}"


def figure_of(width: float, height: float) -> Any:
    """An empty figure (inches) without a window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    made = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(made)
    return made


def staircase_figure(cases: Sequence[Staircase]) -> Any:
    """Left: the error in all, as a share of the nominal one. Right: rms by axis, with the noise floor."""
    figure = figure_of(12.0, 4.8)
    left, right = figure.subfigures(1, 2, width_ratios=[1.0, 1.5])
    _in_all(left.subplots(), cases)
    panels = right.subplots(2, 3, squeeze=False, sharex=True)
    for axis in range(6):
        _by_axis(panels[axis // 3][axis % 3], cases, axis)
    return figure


def _labels(case: Staircase) -> list[str]:
    return [s.name for s in case.falling]


def _in_all(panel: Any, cases: Sequence[Staircase]) -> None:
    labels = [*_labels(cases[0]), "noise floor"]
    place = np.arange(len(labels))
    width = 0.8 / len(cases)
    for k, case in enumerate(cases):
        start = max(case.stairs[0].in_all, 1e-30)
        heights = [100.0 * s.in_all / start for s in case.falling]
        shift = (k - (len(cases) - 1) / 2) * width
        title = "held-out time" if k == 0 else "unseen flights"
        heights.append(100.0 * case.noise.in_all / start)
        bars = panel.bar(place[: len(heights)] + shift, heights, 0.95 * width, color=COLOURS[k], label=title)
        panel.bar_label(bars, [f"{h:.0f}" if h >= 9.5 else f"{h:.1f}" for h in heights], fontsize=8, padding=1)
        bars[-1].set(facecolor="white", edgecolor=COLOURS[k], linestyle="--")
    panel.set_xticks(place, labels, rotation=25, ha="right", fontsize=9)
    panel.set_ylabel("error in all [% of nominal]")
    panel.margins(y=0.12)
    panel.legend(fontsize=8, frameon=False)
    _light(panel)


def _by_axis(panel: Any, cases: Sequence[Staircase], axis: int) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    for k, case in enumerate(cases):
        values = [float(s.rms[axis]) for s in case.falling]
        panel.plot(np.arange(len(values)), values, color=COLOURS[k], marker="o", ms=4, lw=1.0, drawstyle="steps-mid")
        panel.axhline(float(case.noise.rms[axis]), color=COLOURS[k], lw=0.9, ls="--")
    labels = _labels(cases[0])
    panel.set_xticks(np.arange(len(labels)), labels, rotation=35, ha="right", fontsize=7)
    panel.set_title(AXIS_NAMES[axis], fontsize=9, loc="left")
    panel.set_yscale("log")
    low, high = panel.get_ylim()
    panel.set_ylim(low / 1.2, max(high * 1.2, low * 10.0))
    panel.yaxis.set_major_locator(LogLocator(10.0, (1.0, 3.0)))
    panel.yaxis.set_minor_locator(NullLocator())
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.tick_params(axis="y", labelsize=8)
    _light(panel)


def ranking_figure(candidates: Sequence[Candidate], chosen: Sequence[str]) -> Any:
    """Share of the error energy that each effect alone takes off held-out time."""
    shown = list(candidates)[::-1]
    figure = figure_of(8.0, 0.9 + 0.27 * len(shown))
    panel = figure.subplots()
    values = [100.0 * max(c.score, 0.0) for c in shown]
    colours = [COLOURS[0] if c.name in chosen else "#d0b0b0" if c.implausible else "#b8c4d8" for c in shown]
    bars = panel.barh([c.name for c in shown], values, color=colours)
    marks = [f"{v:.1f}" + (" (implausible)" if c.implausible else "") for v, c in zip(values, shown, strict=True)]
    panel.bar_label(bars, marks, fontsize=8, padding=3)
    panel.set_xlim(0.0, 118.0)
    panel.set_xlabel("error energy gone on held-out time [%]; dark: named")
    _light(panel, "x")
    return figure


def residual_figure(comparison: Comparison, first: int, last: int, names: tuple[str, str]) -> Any:
    """Residual of two models over time on the first flight, all axes, with twice the noise."""
    figure = figure_of(12.0, 5.0)
    panels = figure.subplots(3, 2, sharex=True, squeeze=False)
    flight = comparison.flights[0]
    for axis in range(6):
        panel = panels[axis % 3][1 if axis < 3 else 0]
        for k, record in enumerate(comparison.records):
            if record.flight != flight:
                continue
            keep = slice(None, None, max(1, len(record) // MOST_POINTS))
            for index, colour, name in ((first, "0.65", names[0]), (last, COLOURS[0], names[1])):
                residual = record.measured[:, axis] - comparison.evaluations[index].predictions[k][:, axis]
                panel.plot(record.time[keep], residual[keep], color=colour, lw=0.8, label=name if k == 0 else None)
        noise = 2.0 * float(comparison.noise[axis])
        panel.axhspan(-noise, noise, color=COLOURS[2], alpha=0.25, lw=0, label="2 sigma of the sensors")
        panel.set_ylabel(AXIS_NAMES[axis], fontsize=8)
        panel.margins(x=0.01)
        _light(panel)
    for panel in panels[2]:
        panel.set_xlabel(f"time in {flight} [s]")
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3, frameon=False, fontsize=8)
    return figure


def _light(panel: Any, grid: str = "y") -> None:
    panel.grid(alpha=0.3, axis=grid)
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)
