"""Picture of a designed flight: the reference, and what one effect adds beside the best that the other can imitate.

Axes are (5 + D, 1): position x, y, z, tilt and heading of the reference over time, then the D directions ("if it is
this and the model has that"), at most `MOST`, the hardest first. Dashed lines part the manoeuvres.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.learn.design.design_result import Design
from wrenchgap.learn.design.designer import REST
from wrenchgap.learn.design.separability import Direction
from wrenchgap.replay.present.figures import style

MOST = 4
"""Directions drawn at most."""
SAMPLES = 1500
"""Points of the reference."""


def picture(design: Design) -> style.Picture:
    """Five panels of the reference and one for each direction."""
    count = len(_shown(design))
    return style.Picture(
        (5 + count, 1),
        (11.0, 1.3 * 5 + 2.1 * count + 0.6),
        lambda axes: _draw(design, axes),
        title=f"reference of {design.trajectory.duration:g} s that separates {' and '.join(design.expected.names)}",
        heights=[1.0] * 5 + [1.7] * count,
        share=True,
    )


def _shown(design: Design) -> list[Direction]:
    return sorted(design.expected.directions, key=lambda d: d.merit)[:MOST]


def _draw(design: Design, axes: Any) -> None:
    panels = axes[:, 0]
    _reference(panels[:5], design)
    for panel, direction in zip(panels[5:], _shown(design), strict=True):
        _direction(panel, design, direction)
    style.over_time(axes)
    _manoeuvres(panels, design)


def _reference(panels: Any, design: Design) -> None:
    """Position, tilt, and the heading as it turns on past 180 deg."""
    r = design.trajectory.at(np.linspace(0.0, design.trajectory.duration, SAMPLES))
    nose = so3.rotate(r.quat_ED, np.array([1.0, 0.0, 0.0]))
    heading = np.degrees(np.unwrap(np.arctan2(nose[:, 1], nose[:, 0])))
    tilt = np.degrees(so3.tilt_angle(r.quat_ED))
    named = [*((axis, "m", r.position_E[:, k]) for k, axis in enumerate("xyz")), ("tilt", "deg", tilt)]
    for panel, (name, unit, values) in zip(panels, [*named, ("heading", "deg", heading)], strict=True):
        panel.plot(r.time, values, color=style.MEASURED, lw=1.1)
        middle, half = 0.5 * float(values.max() + values.min()), 0.55 * float(np.ptp(values))
        least = 0.05 if unit == "m" else 2.0  # a flat line is flat, not a scale of nanometres
        panel.set_ylim(middle - max(half, least), middle + max(half, least))
        style.labelled(panel, name, unit)


def _direction(panel: Any, design: Design, d: Direction) -> None:
    """What the truth adds and its imitation, on the axis that tells most; the filter has cut either end."""
    added, imitated = (part[:, d.telling] for part in d.traces)
    cut = 0.5 * (design.trajectory.duration - design.expected.seconds)
    time = np.linspace(cut, design.trajectory.duration - cut, len(added))
    panel.plot(time, added, color=style.MEASURED, lw=1.1, label=f"{d.truth} adds")
    panel.plot(time, imitated, color=style.MODELS[1], lw=1.1, label=f"best imitation by {d.imitator}")
    look = {"color": style.MODELS[1], "alpha": 0.2, "lw": 0}
    panel.fill_between(time, added, imitated, **look, label="difference that separates them")
    style.band(panel, [cut, design.trajectory.duration - cut], float(d.noise[d.telling]), "± 1 sigma of the noise")
    style.labelled(panel, *style.QUANTITIES[d.telling])
    found = f"separation {d.separation:.1f} expected, {design.simulated(d.truth, d.imitator):.1f} simulated"
    panel.set_title(f"{d.truth} or {d.imitator}? {found}", loc="left", fontsize=style.USUAL, pad=18)
    style.legend(panel)


def _manoeuvres(panels: Any, design: Design) -> None:
    starts = np.linspace(REST, design.trajectory.duration - REST, len(design.segments) + 1)
    for start, segment in zip(starts, design.segments, strict=False):
        place = {"xycoords": ("data", "axes fraction"), "va": "bottom"}
        panels[0].annotate(str(segment), (start, 1.02), **place, fontsize=style.SMALL)
    for panel in panels:
        for start in starts:
            panel.axvline(start, color="0.6", lw=0.7, ls="--", zorder=0)
