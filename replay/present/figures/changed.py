"""Panels of what changed: means of the residual by flight, each change by itself, and what to mark on the vehicle."""

from __future__ import annotations

from typing import Any

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.changed.changed import Changed, Verdict
from wrenchgap.learn.changed.sizes import Size
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.numbers import AXIS_HEADS, quantity, share
from wrenchgap.replay.present.what_to_inspect import LIKELY, SURE

COLOURS = {"healthy": "0.55", "odd": "tab:orange", "suspect": "tab:red"}


def vehicle_marks(found: Changed) -> tuple[dict[str, str], Array | None]:
    """Parts of the vehicle to mark, with a few words on each, and where the centre of mass moved (3,) [m], if it did.

    Of nothing that changed nothing is marked.
    """
    marks: dict[str, str] = {}
    moved_B: Array | None = None
    if found.verdict is Verdict.NOTHING:
        return marks, moved_B
    by_name = {(p.effect, p.name): p for p in found.parameters}
    for place in found.places:
        if place.probability >= LIKELY:
            size = by_name.get((place.effect, place.parameter))
            change = ""
            if size is not None:
                by = f"{100 * size.change:+.0f} %" if size.unit == "1" else quantity(size.change, size.unit, 2)
                change = f"{place.effect} {by}"
            sure = "" if place.probability >= SURE else f"{share(place.probability)}"
            marks[place.parameter] = ", ".join(filter(None, (change, sure)))
    for name in found.names:
        if name.startswith("imu_") or name == "accelerometer_bias":
            marks["imu"] = name
        if name in ("com_offset", "payload"):
            moved_B = np.array([by_name[name, a].change if (name, a) in by_name else 0.0 for a in "xyz"])
            marks["com"] = "moved"
    return marks, moved_B


def means(found: Changed, panel: Any, band: float = 2.0) -> None:
    """Signed means of the residual by flight, in standard deviations between healthy flights; a band of +- `band`."""
    known = np.flatnonzero(np.isfinite(found.scatter))
    usual = np.mean([r.mean for r in found.rows if r.role == "healthy"], axis=0)
    panel.axhspan(-band, band, color=style.NOISE, alpha=0.15, lw=0, label=f"{band:g} scatter of healthy flights")
    for k, role in enumerate(COLOURS):
        for r in [r for r in found.rows if r.role == role]:
            at = np.arange(len(known)) + 0.16 * (k - 1)
            heights = ((r.mean - usual) / found.scatter)[known]
            panel.plot(at, heights, "o", color=COLOURS[role], ms=6, alpha=0.8, label=role)
    panel.set_xticks(range(len(known)), [AXIS_HEADS[k] for k in known])
    style.labelled(panel, "mean residual from that of healthy flights", "scatter")
    style.grid(panel)
    style.legend(panel)


def changes(found: Changed, panel: Any, most: int = 12) -> None:
    """Each change by itself, in standard deviations; the likeliest `most`."""
    shown = found.alone[:most][::-1]
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
