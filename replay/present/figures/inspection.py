"""Picture of a log: how often each role's topic was recorded over time, and where it is missing.

Axes are (R, 1), one for each role that a topic plays; one with a sentence where none does.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wrenchgap.flight.flight import Series
from wrenchgap.learn.diagnose.model_checks import LogReport
from wrenchgap.replay.present.figures import style

WINDOWS, SHORTEST = 300, 0.5
"""Into how many windows a log is cut at most, and how long these are at least [s]."""


def picture(seen: LogReport) -> style.Picture:
    """A row for each role."""
    rows = max(1, len(_series(seen)))
    return style.Picture(
        (rows, 1),
        (10.0, 1.25 * rows + 1.0),
        lambda axes: _draw(seen, axes[:, 0]),
        title=f"{seen.inspection.path.name}: rates and gaps of the topics",
        share=True,
    )


def _series(seen: LogReport) -> dict[str, Series]:
    return {} if seen.inspection.flight is None else dict(seen.inspection.flight.series())


def _draw(seen: LogReport, panels: Any) -> None:
    if not _series(seen):
        style.nothing(panels[0], "no topic plays a role; map one with --topic ROLE=/your/topic")
        return
    for panel, (role, series) in zip(panels, _series(seen).items(), strict=True):
        _rate(panel, series, seen.inspection.duration)
        panel.set_title(
            f"{role}: {style.shortened(series.topic, style.LONGEST_LABEL)}", fontsize=style.SMALL, loc="left"
        )
        panel.set_xlim(0.0, max(seen.inspection.duration, 1e-3))
    style.labelled(panels[-1], "time since the first message", "s", "x")
    style.grid(panels)


def _rate(panel: Any, series: Series, duration: float) -> None:
    count = max(1, min(WINDOWS, int(duration / SHORTEST)))
    found, edges = np.histogram(series.time, bins=np.linspace(0.0, max(duration, 1e-3), count + 1))
    rate = found / np.diff(edges)
    panel.stairs(rate, edges, baseline=None, color=style.MODELS[0], lw=1.0)
    for k, gap in enumerate(series.gaps):
        panel.axvspan(gap.start, gap.stop, color=style.WARNING, alpha=0.3, lw=0, label="gap" if k == 0 else None)
    words = f"{len(series.gaps)} gaps" if len(series.gaps) != 1 else "1 gap"
    panel.annotate(words, (1.0, 1.02), xycoords="axes fraction", ha="right", va="bottom", fontsize=style.SMALL)
    panel.set_ylim(0.0, 1.15 * float(max(rate.max(), 1e-9)))
    style.labelled(panel, "rate", "Hz")
