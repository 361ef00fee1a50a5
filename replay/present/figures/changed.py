"""Picture of what changed: mean residuals by flight in units of what healthy flights differ by, and the changes.

Left, every flight's signed mean on each axis, from the mean of the healthy ones: what lies within the band is what
healthy flights differ by. Right, each change by itself: how many standard deviations it is.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wrenchgap.learn.changed.changed import Changed
from wrenchgap.learn.changed.sizes import Size
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.numbers import AXIS_HEADS

MOST = 12
"""Changes drawn."""
COLOURS = {"healthy": "0.55", "odd": "tab:orange", "suspect": "tab:red"}
BAND = 2.0
"""Half the width of the band, in standard deviations between healthy flights."""


def picture(found: Changed) -> style.Picture:
    """Two panels side by side."""
    title = f"{found.model.name}: {', '.join(map(style.shortened, found.suspect))} against {len(found.healthy)} healthy"
    return style.Picture((1, 2), (11.0, 4.2), lambda panels: _draw(found, np.ravel(panels)), title=title)


def _draw(found: Changed, panels: Any) -> None:
    _means(found, panels[0])
    _changes(found, panels[1])


def _means(found: Changed, panel: Any) -> None:
    known = np.flatnonzero(np.isfinite(found.scatter))
    usual = np.mean([r.mean for r in found.rows if r.role == "healthy"], axis=0)
    panel.axhspan(-BAND, BAND, color=style.NOISE, alpha=0.15, lw=0, label=f"{BAND:g} scatter of healthy flights")
    for k, role in enumerate(COLOURS):
        for r in [r for r in found.rows if r.role == role]:
            at = np.arange(len(known)) + 0.16 * (k - 1)
            heights = ((r.mean - usual) / found.scatter)[known]
            panel.plot(at, heights, "o", color=COLOURS[role], ms=6, alpha=0.8, label=role)
    panel.set_xticks(range(len(known)), [AXIS_HEADS[k] for k in known])
    style.labelled(panel, "mean residual from that of healthy flights", "scatter")
    style.grid(panel)
    style.legend(panel)


def _changes(found: Changed, panel: Any) -> None:
    shown = found.alone[:MOST][::-1]
    if not shown:
        style.nothing(panel, "no effect of the catalogue could be tried")
        return
    colours = ["tab:red" if a.effect in found.names else "0.75" for a in shown]
    panel.barh(range(len(shown)), [a.largest.significance for a in shown], 0.7, color=colours)
    panel.set_yticks(range(len(shown)), [_label(a.largest) for a in shown], fontsize=style.SMALL)
    style.labelled(panel, "each change by itself", "standard deviations", "x")
    style.grid(panel)
    panel.grid(visible=False, axis="y")


def _label(size: Size) -> str:
    """Effect, and the rotor or arm that it is of."""
    own = size.where if size.name.split("_")[0] in ("rotor", "arm") else size.name
    return f"{size.effect}: {own}"
