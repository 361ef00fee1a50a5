"""How well models predict the measured wrench of flights: errors by axis and by flight, and where they are worst.

All models are compared on one and the same measured wrench, made from the IMU with the mass and inertia of the first
model (`learn.data.measurement`); a model that believes something else predicts what that processing will see.
A fitted model is compared on flights that were not fitted (`validate`), with how far those went beyond the fitted ones.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import AXES, GRAVITY, Array
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.candidates import Untried
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.errors import Errors, reduction, rms, weighted
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.data.prediction import Predictor
from wrenchgap.plant.model import Model


@dataclass(frozen=True)
class ComparisonThresholds:
    """How models are compared, and when one is worse."""

    stretch: float = 1.0
    """Length of the stretches among which the worst are sought [s]."""
    stretches: int = 5
    """How many of the worst stretches are kept."""
    worse: float = 1.1
    """Factor by which the rms of an axis that got worse grew."""
    loud: float = 1.5
    """Factor by which that rms is above the noise."""
    beyond: float = 1.15
    """A flight lies outside when its 95th percentile exceeds the fitted maximum by this factor."""


THRESHOLDS = ComparisonThresholds()


@dataclass(frozen=True)
class Stretch:
    """About a second of a flight, and what the vehicle was doing: medians over it.

    `rms` (6,) of the error; `axis` is where it is largest on the common scale of newtons and newton metres. Tilt and
    speed are None where the log has no pose.
    """

    flight: str
    start: float  # s since the start of the flight
    stop: float
    rms: Array
    axis: str
    tilt_deg: float | None
    force: float  # N, commanded
    rate: float  # rad/s
    speed: float | None  # m/s


@dataclass(frozen=True)
class Evaluation:
    """One predictor on all flights: errors pooled and by flight, worst stretches, predictions by record (K, 6)."""

    name: str
    pooled: Errors
    by_flight: tuple[Errors, ...]
    worst: tuple[Stretch, ...]
    predictions: tuple[Array, ...]
    sigma: tuple[Array, ...] | None


@dataclass(frozen=True)
class LeftOut:
    """An effect that was taken out of a model (or a compared one, by name) because these flights lack what it needs."""

    model: str
    reason: Untried


@dataclass(frozen=True, repr=False)
class Comparison(Result):
    """Models on flights. `noise` (6,) is the sensor noise that no model can predict, `weight` [N] the vehicle's.

    `notes` are those of the flights, and what was left out of which model. `ahead` are predictions of the same models
    without correction, where they were made.
    """

    flights: tuple[str, ...]
    records: tuple[Record, ...]
    evaluations: tuple[Evaluation, ...]
    noise: Array
    notes: tuple[object, ...]
    weight: float
    ahead: Result | None = None

    @property
    def nearest(self) -> int:
        """Index of the evaluation that leaves the least rms, by the mean over axes of its logarithm."""
        return int(np.argmin([np.nanmean(np.log(e.pooled.rms)) for e in self.evaluations]))

    def reduction(self, evaluation: Evaluation) -> Array:
        """Fraction (6,) of the first model's rms that is gone with this one."""
        return reduction(self.evaluations[0].pooled.rms, evaluation.pooled.rms)


def compare(flights: Sequence[OpenFlight], model: Model, predictors: Sequence[Predictor]) -> Comparison:
    """Evaluate predictors on flights that were opened for `model`."""
    records = tuple(r for f in flights for r in f.records)
    data = dataset(records, model)
    ends = np.cumsum([sum(len(r) for r in f.records) for f in flights])[:-1]
    notes: list[object] = [note for f in flights for note in f.notes]
    evaluations = []
    for predictor in predictors:
        usable, lacking = predictor.usable(model, records)
        notes += [LeftOut(predictor.name, reason) for reason in lacking]
        predictions = tuple(usable.predict(r, model.vehicle.body) for r in records)
        residuals = [r.measured - p for r, p in zip(records, predictions, strict=True)]
        pooled = np.concatenate(residuals)
        sigma = [usable.sigma(r) for r in records]
        evaluations.append(
            Evaluation(
                predictor.name,
                Errors.of(pooled),
                tuple(Errors.of(part) for part in np.split(pooled, ends)),
                worst_stretches(records, residuals, data.weights),
                predictions,
                None if any(s is None for s in sigma) else tuple(s for s in sigma if s is not None),
            )
        )
    names = tuple(f.records[0].flight for f in flights)
    weight = model.vehicle.body.mass * GRAVITY
    return Comparison(names, records, tuple(evaluations), data.noise, tuple(dict.fromkeys(notes)), weight)


def worst_stretches(records: Sequence[Record], residuals: Sequence[Array], weights: Array) -> tuple[Stretch, ...]:
    """The stretches of `THRESHOLDS.stretch` with the largest weighted error, none overlapping, worst first."""
    found: list[tuple[float, int, int, int]] = []
    for number, (record, residual) in enumerate(zip(records, residuals, strict=True)):
        length = max(1, min(len(record), round(THRESHOLDS.stretch / record.dt_kept)))
        energy = np.sum(weighted(residual, weights) ** 2, axis=1)
        sums = np.convolve(energy, np.ones(length), mode="valid") / length
        for _ in range(THRESHOLDS.stretches):
            start = int(np.argmax(sums))
            if not np.isfinite(sums[start]) or sums[start] < 0:
                break
            found.append((float(sums[start]), number, start, length))
            sums[max(0, start - length + 1) : start + length] = -1.0
    found.sort(key=lambda item: -item[0])
    return tuple(
        _stretch(records[n], residuals[n], weights, start, size) for _, n, start, size in found[: THRESHOLDS.stretches]
    )


def _stretch(record: Record, residual: Array, weights: Array, start: int, length: int) -> Stretch:
    part = slice(start, start + length)
    size = rms(residual[part])
    state = record.state_kept
    posed = record.has_pose
    return Stretch(
        record.flight,
        float(record.time[part][0]),
        float(record.time[part][-1]),
        size,
        AXES[int(np.argmax(weighted(size, weights)))],
        float(np.degrees(np.median(so3.tilt_angle(state.quat_EB[part])))) if posed else None,
        float(np.median(np.linalg.norm(record.commanded[part, :3], axis=1))),
        float(np.median(np.linalg.norm(state.omega_B[part], axis=1))),
        float(np.median(np.linalg.norm(state.velocity_E[part], axis=1))) if posed else None,
    )


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
        return self.percentile > THRESHOLDS.beyond * self.maximum


QUANTITIES: tuple[tuple[str, str, bool, Callable[[Record], Array]], ...] = (
    ("tilt", "deg", True, lambda r: np.degrees(so3.tilt_angle(r.state_kept.quat_EB))),
    ("speed", "m/s", True, lambda r: np.linalg.norm(r.state_kept.velocity_E, axis=1)),
    ("body rate", "rad/s", False, lambda r: np.linalg.norm(r.state_kept.omega_B, axis=1)),
    ("commanded force", "N", False, lambda r: np.linalg.norm(r.commanded[:, :3], axis=1)),
    ("commanded torque", "Nm", False, lambda r: np.linalg.norm(r.commanded[:, 3:], axis=1)),
)
"""Whose range is compared: name, unit, whether it needs a pose, values (K,) of a record."""


def ranges(fitted: Sequence[Record], unseen: Sequence[Record]) -> list[Range]:
    """`QUANTITIES` of both sides; those that need a pose only where all logs have one."""
    posed = all(r.has_pose for r in (*fitted, *unseen))
    out = []
    for quantity, unit, needs_pose, values in QUANTITIES:
        if posed or not needs_pose:
            known, new = (np.concatenate([values(r) for r in records]) for records in (fitted, unseen))
            out.append(Range(quantity, unit, float(np.max(known)), float(np.percentile(new, 95))))
    return out


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
        lost = (fitted > THRESHOLDS.worse * given) & (fitted > THRESHOLDS.loud * self.comparison.noise)
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
