"""Figures of a report: the error step by step, the ranking of the effects, the residual before and after.

Every function returns a matplotlib figure that belongs to nobody (no pyplot state).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.learn.data.comparison import Comparison
from wrenchgap.learn.identify.search import Candidate
from wrenchgap.learn.identify.staircase import Basis, Staircase
from wrenchgap.replay.present.numbers import UNIT_HEADS
from wrenchgap.replay.present.staircase import label, remains
from wrenchgap.replay.report.contents import Report

Array = NDArray[np.float64]

COLOURS = ("#4c72b0", "#dd8452", "#55a868")
TITLES = {Basis.HELD_OUT: "held-out time", Basis.UNSEEN: "unseen flights"}
MOST_POINTS = 4000
"""Samples drawn of a flight at most."""


def figure_of(width: float, height: float) -> Any:
    """An empty figure (inches) without a window."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    made = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(made)
    return made


def plot(report: Report, axes: Any = None) -> Any:
    """The error in all, step by step, into `axes` (new ones where none are given), which are returned."""
    if axes is None:
        axes = figure_of(6.0, 4.8).subplots()
    _in_all(axes, report.staircases)
    return axes


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
    return [label(s) for s in case.falling]


def _in_all(panel: Any, cases: Sequence[Staircase]) -> None:
    """Bars, as shares of the nominal error; the noise dashed, beside them where a case has fewer steps."""
    labels = [*_labels(cases[0]), "sensor noise"]
    place = np.arange(len(labels))
    width = 0.8 / len(cases)
    for k, case in enumerate(cases):
        stairs = (*case.falling, case.noise)
        heights = [100.0 * case.share(s) for s in stairs]
        shift = (k - (len(cases) - 1) / 2) * width
        bars = panel.bar(
            place[: len(heights)] + shift, heights, 0.95 * width, color=COLOURS[k], label=TITLES[case.basis]
        )
        panel.bar_label(bars, [remains(case, s).removesuffix(" %") for s in stairs], fontsize=8, padding=1)
        bars[-1].set(facecolor="white", edgecolor=COLOURS[k], linestyle="--")
    panel.set_xticks(place, labels, rotation=25, ha="right", fontsize=9)
    panel.set_ylabel("RMS error, all axes [% of nominal]")
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
    panel.set_title(UNIT_HEADS[axis], fontsize=9, loc="left")
    panel.set_yscale("log")
    low, high = panel.get_ylim()
    panel.set_ylim(low / 1.2, max(high * 1.2, low * 10.0))
    panel.yaxis.set_major_locator(LogLocator(10.0, (1.0, 3.0)))
    panel.yaxis.set_minor_locator(NullLocator())
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.tick_params(axis="y", labelsize=8)
    _light(panel)


def ranking_figure(candidates: Sequence[Candidate], chosen: Sequence[str]) -> Any:
    """Share of the error energy on held-out time that is gone with each effect alone."""
    shown = list(candidates)[::-1]
    figure = figure_of(8.0, 0.9 + 0.27 * len(shown))
    panel = figure.subplots()
    values = [100.0 * max(c.score, 0.0) for c in shown]
    colours = [COLOURS[0] if c.name in chosen else "#d0b0b0" if c.implausible else "#b8c4d8" for c in shown]
    bars = panel.barh([c.name for c in shown], values, color=colours)
    marks = [f"{v:.1f}" + (" (implausible)" if c.implausible else "") for v, c in zip(values, shown, strict=True)]
    panel.bar_label(bars, marks, fontsize=8, padding=3)
    panel.set_xlim(0.0, 118.0)
    panel.set_xlabel("reduction of the error energy on held-out time [%]; dark: named")
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
        panel.set_ylabel(UNIT_HEADS[axis], fontsize=8)
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
