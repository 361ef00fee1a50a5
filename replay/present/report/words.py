"""Sentences of the page that are not those of another result."""

from __future__ import annotations

import numpy as np

from wrenchgap.learn.data.blocks import INDISTINCT
from wrenchgap.learn.design.design_result import Design
from wrenchgap.learn.diagnose.error_grid import FEWEST, Grid
from wrenchgap.replay.present.numbers import separation
from wrenchgap.replay.report.contents import Absent, NextFlight, Report, Rest

ABSENT = {
    Absent.NOISE: "The residual of the last step is sensor noise: a Gaussian process has nothing to learn.",
    Absent.SHORT: "There is too little data to hold anything out for a Gaussian process.",
    Absent.USELESS: "A Gaussian process of the commanded wrench does not reduce the error on held-out time.",
}


def rest(found: Rest) -> str:
    """What the Gaussian process among the steps is, or why there is none."""
    process = found.process
    if process is None:
        return "" if found.absent is None else ABSENT[found.absent]
    axes = ", ".join(process.gp.outputs)
    if process.given:
        return f"The given GP predicts {axes}; it is added to the model as given."
    return (
        f"A Gaussian process of the commanded wrench, learnt for this report from the residual of the last step, "
        f"reduces the error of {axes}; on held-out time it is predicted by processes that did not see that time. It "
        "has no physical name: it shows how much remains to be explained."
    )


def where_on(report: Report) -> str:
    """On which flights the models are examined."""
    if report.unseen:
        return "the unseen flights"
    return f"the given logs{', to which the effects were fitted (in-sample)' if report.addition.model.effects else ''}"


def no_grid(grid: Grid) -> str:
    """Why there is no map over two quantities."""
    return (
        f"No map over {grid.x_label} and {grid.y_label}: no cell has {FEWEST:g} independent samples; that takes a "
        "longer flight."
    )


def why_not(flight: NextFlight) -> str:
    """Why there is no designed flight."""
    return flight.why_not or f"not searched for this page; see `wrenchgap design {' '.join(flight.names)}`."


def designed(found: Design) -> str:
    """The designed flight, and what to expect of it."""
    moves = ", then ".join(str(s) for s in found.segments)
    expected, before = separation(found.expected.separation), separation(found.before.separation)
    said = (
        f"Fly {found.file.trajectory.duration:.0f} s: {moves}. Expected separation {expected}, on the given logs "
        f"{before}; the effects are separable above {INDISTINCT:g}."
    )
    return said if found.separable else f"{said} No flight that was tried separates them reliably."


def rehearsal(found: Design) -> list[list[str]]:
    """The designed flight on the simulated vehicle, a row for each effect in the vehicle and each in the model."""
    return [
        [f.truth, imitator, separation(value), f"{np.degrees(f.tilt_max):.0f}", f"{f.speed_max:.1f}"]
        for f in found.flown
        for imitator, value in f.separation.items()
    ]
