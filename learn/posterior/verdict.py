"""What is said of a set of effects that was fitted: the verdict, and what it asks of the rest.

What a verdict needs:

    unknown   force or torque stay above `structure` times the noise and above the share `UNEXPLAINED` of what they
              were, the worst `UNUSUAL` of the time left aside, and where commands answer the motion `PREDICTABLE` of
              that depends on what was logged; or something is named, and a band of frequency of what is left is open
              (`learn.posterior.unexplained_bands`); or an oscillation is found in what is left, or all of it pushes
              where one rotor does; or what explains most is at the limit of what is plausible
    nothing   no effect was named
    group     another effect would do as well in the place of the largest member
    effect    else
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.blocks import by_block
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import energy, force_and_torque, rms, weighted
from wrenchgap.learn.diagnose.relevance import Relevance
from wrenchgap.learn.diagnose.residual_patterns import OneRotor, Oscillation
from wrenchgap.learn.posterior.members import Member
from wrenchgap.learn.posterior.single_effects import ModelResidual


class Verdict(StrEnum):
    """What the flights show to be missing; see the module."""

    EFFECT = "effect"
    GROUP = "group"
    UNKNOWN = "unknown"
    NOTHING = "nothing"


UNEXPLAINED = 0.25
"""Structure is left where the rms of force or torque stays above `structure` times the noise and above this share
of what it was."""
PREDICTABLE = 0.3
"""Share of what is left that must depend on what was logged to be missing physics, where commands answer the motion:
those answer turbulence too (`learn.diagnose.relevance.Relevance.driven`)."""
UNUSUAL = 0.1
"""Share of the time, the worst, that a verdict disregards."""


def concentrated(data: Dataset, residual: Array) -> float:
    """Share of the energy that sits in the worst tenth of the time."""
    some = residual[usual(data, residual)]
    return 1.0 - energy(some, data.weights) / max(energy(residual, data.weights), 1e-30)


def usual(data: Dataset, residual: Array) -> NDArray[np.bool_]:
    """Samples (K,) outside the tenth of the blocks with the largest residual: one gust or touch is no verdict."""
    loud = by_block(data.block, np.sum(weighted(residual, data.weights) ** 2, axis=1))
    return np.asarray(loud[data.block] <= np.quantile(loud, 1.0 - UNUSUAL, method="lower"))


def over_noise(data: Dataset, residual: Array) -> float:
    """The residual over the noise, the worse of force and torque."""
    return float(np.nanmax(force_and_torque(rms(residual)) / force_and_torque(data.noise)))


def open_axes(on: ModelResidual, left: Array) -> NDArray[np.bool_]:
    """Axes (6,) on which structure is left: those of force, or of torque, where one of the two stays well above the
    noise and above a quarter of what it was.
    """  # noqa: D205
    some = usual(on.data, left)
    before, after = (rms(on.data.unanswered(r)[some]) for r in (on.given, left))
    noise = on.data.noise
    loud = (after > on.settings.structure * noise) & (after > UNEXPLAINED * before)
    worse = force_and_torque(after) > np.maximum(
        on.settings.structure * force_and_torque(noise), UNEXPLAINED * force_and_torque(before)
    )
    return np.asarray(loud & np.repeat(worse, 3))


def decide(
    on: ModelResidual,
    named: Sequence[Member],
    loud: NDArray[np.bool_],
    found: Oscillation | OneRotor | None,
    depends: Relevance | None,
    *,
    at_limit: Collection[str] = (),
) -> Verdict:
    """Unknown where something was found in what is left, or structure is left; where commands answer the motion, and
    with it turbulence, only structure that can be predicted is one. Unknown, too, where what explains most is
    `at_limit` of what is plausible: that says that its law is another one.
    """  # noqa: D205
    turbulent = bool(on.data.answering) and (depends is None or depends.driven < PREDICTABLE)
    if found is not None or (loud.any() and not turbulent):
        return Verdict.UNKNOWN
    if not named:
        return Verdict.NOTHING
    if named[0].name in at_limit:
        return Verdict.UNKNOWN
    return Verdict.GROUP if named[0].alike else Verdict.EFFECT
