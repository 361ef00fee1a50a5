"""The fitted model on flights that were not fitted, and how far those went beyond the fitted ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight import so3
from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.comparison import Comparison, compare
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.data.prediction import Predictor
from wrenchgap.plant.model import Model

Array = NDArray[np.float64]

WORSE, LOUD = 1.1, 1.5
"""An axis got worse where its rms grew by this factor and is above the noise by this one."""
BEYOND = 1.15
"""A flight lies outside when its 95th percentile exceeds the fitted maximum by this factor."""


@dataclass(frozen=True)
class Range:
    """How far a quantity went: `maximum` over the fitted flights, `percentile` (95th) over a validation flight."""

    quantity: str
    unit: str
    maximum: float
    percentile: float

    @property
    def outside(self) -> bool:
        """Whether the validation flight left what was fitted."""
        return self.percentile > BEYOND * self.maximum


def ranges(fitted: Sequence[Record], unseen: Sequence[Record]) -> list[Range]:
    """Tilt, body rate, speed and force of both sides; tilt and speed only where all logs have a pose."""
    posed = all(r.has_pose for r in (*fitted, *unseen))
    out = []
    for quantity, unit, values in _quantities(posed):
        known = np.concatenate([values(r) for r in fitted])
        new = np.concatenate([values(r) for r in unseen])
        out.append(Range(quantity, unit, float(np.max(known)), float(np.percentile(new, 95))))
    return out


def _quantities(posed: bool) -> list[tuple[str, str, Callable[[Record], Array]]]:
    always = [
        ("body rate", "rad/s", lambda r: np.linalg.norm(r.state_kept.omega_B, axis=1)),
        ("commanded force", "N", lambda r: np.linalg.norm(r.commanded[:, :3], axis=1)),
        ("commanded torque", "Nm", lambda r: np.linalg.norm(r.commanded[:, 3:], axis=1)),
    ]
    with_pose = [
        ("tilt", "deg", lambda r: np.degrees(so3.tilt_angle(r.state_kept.quat_EB))),
        ("speed", "m/s", lambda r: np.linalg.norm(r.state_kept.velocity_E, axis=1)),
    ]
    return with_pose + always if posed else always


@dataclass(frozen=True)
class Validation:
    """The fitted model on flights that were not fitted: `comparison` of nominal, given and fitted model."""

    comparison: Comparison
    ranges: tuple[tuple[str, tuple[Range, ...]], ...]

    @property
    def before(self) -> Array:
        """Rms (6,) of the given model."""
        return self.comparison.evaluations[0].pooled.rms

    @property
    def after(self) -> Array:
        """Rms (6,) of the fitted model."""
        return self.comparison.evaluations[-1].pooled.rms

    @property
    def reduction(self) -> Array:
        """Fraction (6,) of the given model's rms that is gone."""
        return self.comparison.reduction(self.comparison.evaluations[-1])

    @property
    def worse(self) -> tuple[str, ...]:
        """Axes on which the fitted model is worse than the given one."""
        given, fitted = self.comparison.evaluations[-2].pooled.rms, self.after
        lost = (fitted > WORSE * given) & (fitted > LOUD * self.comparison.noise)
        return tuple(AXES[k] for k in np.flatnonzero(lost))

    @property
    def outside(self) -> tuple[tuple[str, Range], ...]:
        """Flights and the quantities in which they left the fitted range."""
        return tuple((flight, r) for flight, listed in self.ranges for r in listed if r.outside)


def validate(flights: Sequence[OpenFlight], fitted_on: Sequence[OpenFlight], given: Model, fitted: Model) -> Validation:
    """Given and fitted model on flights that were not fitted."""
    predictors = [Predictor("given", given.wrench_model), Predictor("explained", fitted.wrench_model)]
    known = [r for f in fitted_on for r in f.records]
    listed = tuple((f.records[0].flight, tuple(ranges(known, f.records))) for f in flights)
    return Validation(compare(flights, given, predictors), listed)
