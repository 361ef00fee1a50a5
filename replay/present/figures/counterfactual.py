"""Picture of a counterfactual: tracking errors over time, recorded, in the null run and with the change.

Axes are (4, 1): attitude error about x, y, z of the body, and the distance from the reference.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wrenchgap.plant.tracking import TrackingErrors
from wrenchgap.replay.counterfactual.counterfactual import Counterfactual
from wrenchgap.replay.present.figures import style

COLOURS = {"recorded": "0.6", "null run": style.MEASURED, "changed": "tab:blue", "not compensated": "tab:orange"}


def picture(result: Counterfactual) -> style.Picture:
    """Four panels over time."""
    words = "; ".join(result.change.words) or "nothing changed"
    return style.Picture(
        (4, 1),
        (11.0, 8.2),
        lambda axes: _draw(result, axes),
        title=f"{result.inference.recording.flight.name}, re-simulated: {style.shortened(words, 90)}",
        share=True,
    )


def _runs(result: Counterfactual) -> dict[str, TrackingErrors]:
    """Errors of the runs that differ, by name; the last is drawn on top."""
    runs = {"recorded": result.inference.recording.tracking_errors, "null run": result.null.tracking_errors}
    if result.uncompensated is not None and result.uncompensated is not result.null:
        runs["not compensated"] = result.uncompensated.tracking_errors
    if result.changed is not result.null:
        runs["changed"] = result.changed.tracking_errors
    return runs


def _draw(result: Counterfactual, axes: Any) -> None:
    panels = axes[:, 0]
    for name, errors in _runs(result).items():
        angles = np.degrees(np.arcsin(np.clip(errors.attitude, -1.0, 1.0)))
        width = 1.8 if name == "recorded" else 0.9
        for panel, values in zip(panels, (*angles.T, errors.position), strict=True):
            style.curve(panel, errors.time, values, COLOURS[name], name, width)
    for panel, axis in zip(panels, "xyz", strict=False):
        panel.axhline(0.0, color="0.5", lw=0.6)
        style.labelled(panel, f"attitude error\nabout {axis}", "deg")
    panels[3].set_ylim(0.0, None)
    style.labelled(panels[3], "distance from\nthe reference", "m")
    style.legend(panels[0])
    style.over_time(axes, "time in flight")
