"""Picture of a replay: the wrench before and after compensation, the correction with its uncertainty, the filter.

Axes are (L + 1, 2) for the L outputs of the Gaussian process. Rows of outputs: wrenches on the left, the correction
with its band on the right. Last row: sigma with its threshold, and beta.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.plant.mismatch import output_indices
from wrenchgap.replay.compensation.replay import Replay
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.replay import sigma_unit

REPLAYED, AS_FLOWN, WITH, SIGMA = "tab:orange", "tab:blue", "tab:green", "tab:red"


def picture(replay: Replay) -> style.Picture:
    """A row for each output, and one for the uncertainty filter."""
    rows = len(replay.outputs) + 1
    return style.Picture(
        (rows, 2),
        (14.0, 2.1 * rows + 0.8),
        lambda axes: _draw(replay, axes),
        title=f"{replay.flight.name}: compensation of the {replay.source} wrench, model {replay.model.name}; "
        "*: filtered",
        share=True,
    )


def _draw(replay: Replay, axes: Any) -> None:
    bands = _std(replay)
    for row, k in enumerate(output_indices(replay.outputs)):
        _wrenches(axes[row, 0], replay, int(k))
        _correction(axes[row, 1], replay, int(k), None if bands is None else bands[:, row])
    _sigma(axes[-1, 0], replay)
    _beta(axes[-1, 1], replay)
    for panel in (*axes[0], axes[-1, 0]):
        style.legend(panel)
    style.over_time(axes)


def _wrenches(panel: Any, replay: Replay, k: int) -> None:
    drawn = (
        (replay.wrench, style.COMMANDED, replay.source),
        (replay.steps.commanded, REPLAYED, "with correction"),
        (replay.measured, style.MEASURED, "measured*"),
        (replay.predicted, AS_FLOWN, "predicted*"),
        (replay.predicted_new, WITH, "predicted with correction*"),
    )
    for values, colour, name in drawn:
        if np.isfinite(values[:, k]).any():
            style.curve(panel, replay.time, values[:, k], colour, name)
    style.labelled(panel, *style.QUANTITIES[k])


def _correction(panel: Any, replay: Replay, k: int, std: Array | None) -> None:
    """The optimum, and what the filter lets through of it with the standard deviation of the prediction."""
    correction = replay.steps.correction[:, k]
    style.curve(panel, replay.time, replay.steps.optimum[:, k], "0.3", "optimum", 1.4)
    style.curve(panel, replay.time, correction, REPLAYED, "correction (optimum after the uncertainty filter)")
    if std is not None:
        low, high = correction - std, correction + std
        panel.fill_between(replay.time, low, high, color=SIGMA, alpha=0.25, lw=0, label="± sigma of the GP", zorder=1)
    name, unit = style.QUANTITIES[k]
    style.labelled(panel, f"correction of\n{name}", unit)


def _std(replay: Replay) -> Array | None:
    """Standard deviation (K, L) at each command; None for a process that looks at more than the command."""
    gp = replay.gp
    return None if gp.settings.inputs else gp.std(replay.wrench + replay.steps.optimum)


def _sigma(panel: Any, replay: Replay) -> None:
    """The number that decides: largest standard deviation of the outputs, in their unit or relative to the prior."""
    style.curve(panel, replay.time, replay.steps.sigma, style.MEASURED, "sigma, the largest of the outputs")
    if np.isfinite(replay.sigma_threshold):
        label = "threshold: half of the optimum is withheld"
        panel.axhline(replay.sigma_threshold, color=style.WARNING, lw=1.0, ls="--", label=label)
    panel.set_ylim(min(0.0, float(replay.steps.sigma.min())), None)
    style.labelled(panel, "sigma", sigma_unit(replay))


def _beta(panel: Any, replay: Replay) -> None:
    style.curve(panel, replay.time, 100.0 * replay.steps.beta, style.MEASURED)
    panel.set_ylim(-3.0, 103.0)
    style.labelled(panel, "beta: share of the\noptimum that is withheld", "%")
