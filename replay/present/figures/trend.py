"""Picture of parameters over flights: values with their intervals, the level and the scatter about it, steps, drifts.

Axes are (P, 1), one panel for each parameter that the flights show; flights from left to right in the order given,
numbered from 1.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from wrenchgap.learn.identify.course import Step, Verdict
from wrenchgap.learn.identify.trend import ParameterTrend, Trend
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.numbers import label, quantity

SIGMAS = 2.0
"""Half-width of intervals and of the band of scatter, in standard deviations."""
MOST_NAMES = 40
"""Flights that are named below the panels; more are numbered."""


def picture(found: Trend) -> style.Picture:
    """One panel for each parameter, over the flights."""
    shown = _shown(found)
    named = len(found.flights) <= MOST_NAMES
    size = (max(8.0, min(16.0, 4.0 + 0.3 * len(found.flights))), 1.9 * len(shown) + (1.9 if named else 0.8))
    title = f"{found.model.name}: {', '.join(found.effects)} over {len(found.flights)} flights, each fitted by itself"
    return style.Picture((len(shown), 1), size, lambda axes: _draw(found, axes), title=title, share=True)


def _shown(found: Trend) -> list[ParameterTrend]:
    shown = [p for p in found.parameters if p.course.verdict is not Verdict.OPEN]
    return shown or list(found.parameters)


def _draw(found: Trend, axes: Any) -> None:
    panels, shown = np.ravel(axes), _shown(found)
    for panel, p in zip(panels, shown, strict=True):
        _panel(panel, p)
        name = f"{p.effect}\n{label(p.name, found.model.vehicle)}"
        style.labelled(panel, name, "" if p.unit == "1" else p.unit)
    bottom, count = panels[-1], len(found.flights)
    if count <= MOST_NAMES:
        names = [f"{k + 1} {style.shortened(name)}" for k, name in enumerate(found.names)]
        bottom.set_xticks(np.arange(1, count + 1), names, rotation=60, ha="right", fontsize=style.SMALL)
    bottom.set_xlabel("flight, in the order given", fontsize=style.USUAL)
    bottom.set_xlim(0.5, count + 0.5)
    style.grid(panels)
    style.legend(panels[0], *panels[1:])
    panels[0].get_figure(root=False).align_ylabels(list(panels))


def _panel(panel: Any, p: ParameterTrend) -> None:
    """Values with intervals over the level with the scatter about it; every step a line with its size."""
    flight = np.arange(1, len(p.values) + 1)
    ends = [0, *(step.flight for step in p.course.steps), len(flight)]
    for first, last in pairwise(ends):
        x = np.array([first + 0.5, last + 0.5])
        part = p.course.level[first:last]
        level = np.interp(x, flight[first:last], part)
        if p.course.verdict is Verdict.DRIFT and p.course.drift is not None:
            level = part[0] + p.course.drift.slope * (x - flight[first])
        half = SIGMAS * p.course.scatter
        words = ("level", f"± {SIGMAS:g} scatter") if first == 0 else ("", "")
        panel.fill_between(x, level - half, level + half, color=style.NOISE, alpha=0.25, lw=0, label=words[1] or None)
        panel.plot(x, level, color=style.NOISE, lw=1.6, label=words[0] or None)
    bars = {"fmt": "o", "ms": 4.0, "color": style.MEASURED, "ecolor": style.MEASURED, "elinewidth": 0.9, "capsize": 2.0}
    panel.errorbar(flight, p.values, SIGMAS * p.errors, label=f"one flight, ± {SIGMAS:g} standard errors", **bars)
    for step in p.course.steps:
        _step(panel, step, p.unit)


def _step(panel: Any, step: Step, unit: str) -> None:
    """A line between the flights, and the size of the step beside it."""
    place = step.flight + 0.5
    panel.axvline(place, color=style.WARNING, lw=1.0, ls="--", label="step")
    words = f"{'+' if step.size > 0 else ''}{quantity(step.size, unit, 2)}"
    if unit in style.PREFIXED:
        words = f"{'+' if step.size > 0 else ''}{style.written(step.size, unit)}"
    look = {"fontsize": style.SMALL, "color": style.WARNING, "rotation": 90, "va": "top", "ha": "left"}
    panel.annotate(words, (place, 1.0), (2, -2), ("data", "axes fraction"), textcoords="offset points", **look)
