"""Picture of an addition: the error by axis before and after, and the noise floor.

Axes are (1, 2): forces and torques. The errors are those on time that was not fitted, where there is any.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.identify.add import Addition
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.numbers import change


def picture(added: Addition) -> style.Picture:
    """Two groups of bars."""
    where = "on the fitted logs" if added.trial is None else "on held-out time of these logs"
    return style.Picture(
        (1, 2),
        (10.0, 3.8),
        lambda axes: _draw(added, axes[0]),
        title=f"{', '.join(e.name for e in added.model.effects)} in {added.given.name}: error {where}",
    )


def _draw(added: Addition, panels: Any) -> None:
    before, after, noise = added.rms_before, added.rms_after, None
    if added.trial is not None:
        before, after, noise = added.trial.before, added.trial.after, added.trial.noise
    bars_by_axis(panels, [("before", "0.6", before), ("after", style.MODELS[0], after)], noise)
    for k in np.flatnonzero(np.isfinite(after)):
        words = change(float(after[k] / max(before[k], 1e-30)) - 1.0)
        look = {"ha": "center", "fontsize": style.SMALL, "color": style.MODELS[0]}
        place = (k % 3 + 0.2, float(after[k]))
        panels[k // 3].annotate(words, place, (0, 2), textcoords="offset points", **look)


def bars_by_axis(panels: Any, rows: list[tuple[str, str, Array]], noise: Array | None) -> None:
    """Groups of bars over x, y, z for force and torque: `rows` of (name, colour, rms (6,)), `noise` (6,) as lines."""
    place, count = np.arange(3), len(rows)
    for panel, part, kind, unit in zip(panels, (0, 3), ("force", "torque"), ("N", "Nm"), strict=True):
        for index, (name, colour, values) in enumerate(rows):
            shift = (index - (count - 1) / 2) * 0.8 / count
            panel.bar(place + shift, values[part : part + 3], 0.76 / count, color=colour, label=name)
        if noise is not None:
            levels = noise[part : part + 3]
            panel.hlines(levels, place - 0.45, place + 0.45, color=style.NOISE, lw=2.0, label="sensor noise")
        panel.set_xticks(place, [f"{kind} {axis}" for axis in "xyz"], fontsize=style.USUAL)
        panel.set_ylim(0.0, None)
        style.labelled(panel, f"{kind} error, rms", unit)
        style.grid(panel)
        panel.grid(visible=False, axis="x")
        style.legend(panel)
