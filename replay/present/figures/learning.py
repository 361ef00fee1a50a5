"""Picture of a learnt process: its prediction error beside that of the alternatives, and whether its sigma is right.

Axes are (R, 3): a row for the training flights and, where there are some, one for unseen flights; forces, torques,
and the share of samples within the predicted intervals, before and after calibration.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wrenchgap.learn import Comparison, Learnt
from wrenchgap.learn.process.calibration import Coverage
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.figures.addition import bars_by_axis

EXPECTED = ((95.0, "within_95", "o", "1.96 sigma"), (99.7, "within_3_sigma", "s", "3 sigma"))
"""Expected share [%], its name in `Coverage`, marker, and interval."""


def picture(learnt: Learnt) -> style.Picture:
    """One or two rows of three panels."""
    rows = len(_tested(learnt))
    return style.Picture(
        (rows, 3),
        (15.0, 3.6 * rows + 0.5),
        lambda axes: _draw(learnt, axes),
        title=f"Gaussian process of {len(learnt.gp.inputs)} points for {', '.join(learnt.gp.outputs)}, "
        f"on top of {learnt.gp.provenance.physics}",
    )


def _tested(learnt: Learnt) -> dict[str, Comparison]:
    both = {"training": learnt.training, "unseen": learnt.validation}
    return {name: one for name, one in both.items() if one is not None}


def _draw(learnt: Learnt, axes: Any) -> None:
    for panels, (name, compared) in zip(axes, _tested(learnt).items(), strict=True):
        colours = ("0.6", *style.MODELS)
        rows = [(e.name, colours[k % len(colours)], e.pooled.rms) for k, e in enumerate(compared.evaluations)]
        bars_by_axis(panels[:2], rows, compared.noise)
        flights = style.shortened(", ".join(compared.flights), 40)
        for panel, kind in zip(panels, ("force", "torque"), strict=False):
            if not any(output.startswith(kind) for output in learnt.gp.outputs):
                panel.set_xlabel("no output of this GP: as without it", fontsize=style.SMALL, color="0.4")
            style.labelled(panel, f"{name} ({flights})\n{kind} error, rms", "N" if kind == "force" else "Nm")
        _calibration(panels[2], learnt, *learnt.coverage[name])


def _calibration(panel: Any, learnt: Learnt, before: Coverage, after: Coverage) -> None:
    place = np.arange(len(learnt.gp.outputs))
    for (expected, name, marker, words), colour in zip(EXPECTED, (style.MODELS[0], style.MODELS[1]), strict=True):
        panel.axhline(expected, color=colour, lw=0.9, ls="--", label=f"{expected:g} % in {words}")
        for one, shift, fill in ((before, -0.12, "none"), (after, 0.12, colour)):
            panel.plot(place + shift, 100.0 * getattr(one, name), marker, ms=6, mec=colour, mfc=fill)
    for fill, words in (("none", "before calibration"), ("0.4", "after")):
        panel.plot([], [], "o", ms=6, mec="0.4", mfc=fill, label=words)
    lowest = min(float(getattr(one, name).min()) for one in (before, after) for _, name, _, _ in EXPECTED)
    panel.set_ylim(max(0.0, min(90.0, 100.0 * lowest - 3.0)), 101.0)
    panel.set_xlim(-0.6, len(place) - 0.4)
    style.labelled(panel, "measured within the interval", "%")
    panel.set_xticks(place, [name.replace("_", " ") for name in learnt.gp.outputs], fontsize=style.SMALL)
    style.grid(panel)
    style.legend(panel)
