"""How well models predict the measured wrench of flights: errors by axis and by flight, and where they are worst.

All models are compared on one and the same measured wrench, made from the IMU with the mass and inertia of the first
model (`learn.data.measurement`); a model that believes something else predicts what that processing will see.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight import so3
from wrenchgap.flight.errors import FitError, ModelError
from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.inputs import groups, process_inputs
from wrenchgap.learn.data.measurement import Record, predict
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.identify.fit import dataset, inapplicable
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant.mismatch import LinearMismatch, output_indices
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import content_hash
from wrenchgap.plant.vehicle import Body
from wrenchgap.plant.wrench_model import WrenchModel

Array = NDArray[np.float64]

STRETCH_SECONDS = 1.0
"""Length of the stretches among which the worst are sought [s]."""
STRETCHES = 5
"""How many of the worst stretches are kept."""


@dataclass(frozen=True)
class Errors:
    """Of the absolute error, per axis (6,): mean, standard deviation, root mean square, maximum [N, Nm]."""

    mean_abs: Array
    std_abs: Array
    rms: Array
    max_abs: Array

    @classmethod
    def of(cls, residual: Array) -> Errors:
        """Errors of residuals (K, 6)."""
        size = np.abs(residual)
        return cls(size.mean(axis=0), size.std(axis=0), np.sqrt((residual**2).mean(axis=0)), size.max(axis=0))

    def to_json(self) -> dict[str, list[float]]:
        """By name."""
        return {name: np.asarray(value).tolist() for name, value in self.__dict__.items()}


@dataclass(frozen=True)
class Predictor:
    """A model, with a Gaussian process or a straight line on top where there is one, under its name in tables."""

    name: str
    model: WrenchModel
    gp: GaussianProcess | LinearMismatch | None = None

    def predict(self, record: Record, body: Body) -> Array:
        """Measured wrench (K, 6) that the model expects, as processed with the mass and inertia of `body`."""
        predicted = predict(record, self.model, body)
        if self.gp is not None:
            predicted[:, output_indices(self.gp.outputs)] += self.gp.mean(self._inputs(record))
        return predicted

    def sigma(self, record: Record) -> Array | None:
        """Standard deviation (K, 6) where a Gaussian process knows one; not a number on the other axes."""
        if self.gp is None:
            return None
        sigma = np.full((len(record), 6), np.nan)
        sigma[:, output_indices(self.gp.outputs)] = self.gp.std(self._inputs(record))
        return sigma

    def _inputs(self, record: Record) -> Array:
        assert self.gp is not None
        return process_inputs(groups(self.gp), record)


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

    def to_json(self) -> dict[str, Any]:
        """Plain."""
        return {**self.__dict__, "rms": self.rms.tolist()}


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
class Comparison:
    """Models on flights. `noise` (6,) is the sensor noise that no model can predict."""

    flights: tuple[str, ...]
    records: tuple[Record, ...]
    evaluations: tuple[Evaluation, ...]
    noise: Array
    notes: tuple[str, ...]

    def falls(self, evaluation: Evaluation) -> Array:
        """Fraction (6,) of the first model's rms that this one takes off."""
        return 1.0 - evaluation.pooled.rms / np.maximum(self.evaluations[0].pooled.rms, 1e-30)

    def to_json(self) -> dict[str, Any]:
        """The body of the `compare` schema."""
        return {
            "axes": list(AXES),
            "flights": list(self.flights),
            "models": [
                {
                    "name": e.name,
                    **e.pooled.to_json(),
                    "fall_of_rms": self.falls(e).tolist(),
                    "per_flight": [
                        {"flight": f, **errors.to_json()} for f, errors in zip(self.flights, e.by_flight, strict=True)
                    ],
                    "worst": [s.to_json() for s in e.worst],
                }
                for e in self.evaluations
            ],
            "noise": self.noise.tolist(),
            "samples": sum(len(r) for r in self.records),
            "notes": list(self.notes),
        }


def compare(flights: Sequence[OpenFlight], model: Model, predictors: Sequence[Predictor]) -> Comparison:
    """Evaluate predictors on flights that were opened for `model`."""
    records = tuple(r for f in flights for r in f.records)
    data = dataset(records, model)
    numbers = np.repeat(np.arange(len(flights)), [sum(len(r) for r in f.records) for f in flights])
    notes = [note for f in flights for note in f.notes]
    evaluations = []
    for predictor in predictors:
        usable, left_out = _usable(predictor, model, records)
        notes += left_out
        predictions = tuple(usable.predict(r, model.vehicle.body) for r in records)
        residuals = [r.measured - p for r, p in zip(records, predictions, strict=True)]
        pooled = np.concatenate(residuals)
        sigma = [usable.sigma(r) for r in records]
        evaluations.append(
            Evaluation(
                predictor.name,
                Errors.of(pooled),
                tuple(Errors.of(pooled[numbers == i]) for i in range(len(flights))),
                worst_stretches(records, residuals, data.weights),
                predictions,
                None if any(s is None for s in sigma) else tuple(s for s in sigma if s is not None),
            )
        )
    names = tuple(f.records[0].flight for f in flights)
    return Comparison(names, records, tuple(evaluations), data.noise, tuple(dict.fromkeys(notes)))


def _usable(predictor: Predictor, model: Model, records: Sequence[Record]) -> tuple[Predictor, list[str]]:
    """The predictor without effects that need what these logs lack, and a note for each."""
    lacking = {}
    for item in predictor.model.effects:
        reason = inapplicable(item.name, model, records)
        if reason is not None:
            lacking[item.name] = f"{predictor.name}: left out, {reason}"
    if not lacking:
        return predictor, []
    kept = tuple(e for e in predictor.model.effects if e.name not in lacking)
    return replace(predictor, model=WrenchModel(predictor.model.vehicle, kept)), list(lacking.values())


def predictors(
    model: Model, against: Sequence[Model] = (), gp: GaussianProcess | None = None, cutoff_hz: float | None = None
) -> tuple[list[Predictor], list[str]]:
    """What to compare, and notes: the nominal vehicle, the model if it has effects, others, the GP on its model.

    The Gaussian process is added to what it was learnt on: the model itself, or the nominal vehicle.
    """
    found = [Predictor("nominal", model.nominal.wrench_model)]
    notes: list[str] = []
    if model.effects:
        found.append(Predictor(_fresh(model.name, found), model.wrench_model))
    for other in against:
        _check_geometry(model, other)
        found.append(Predictor(_fresh(other.name, found), other.wrench_model))
        if not other.effects:
            notes.append(f"{other.name}: has no effects; it differs from nominal only where its vehicle does.")
    if gp is not None:
        gp.check_vehicle(model.vehicle.name)
        base, name, note = _base_of(gp, model, against)
        notes += note
        if gp.provenance.cutoff_hz is not None and cutoff_hz is not None and gp.provenance.cutoff_hz != cutoff_hz:
            notes.append(
                f"the GP was learnt behind a filter of {gp.provenance.cutoff_hz:g} Hz, this comparison uses "
                f"{cutoff_hz:g} Hz; say --cutoff {gp.provenance.cutoff_hz:g} for like with like."
            )
        found.append(Predictor(f"{name}+GP", base.wrench_model, gp))
    return found, notes


def _base_of(gp: GaussianProcess, model: Model, against: Sequence[Model]) -> tuple[Model, str, list[str]]:
    """The model that a GP was learnt on, among those at hand."""
    wanted = gp.provenance.model_hash
    candidates = [(model.nominal, "nominal"), (model, model.name), *((other, other.name) for other in against)]
    for candidate, name in candidates:
        if content_hash(candidate) == wanted:
            return candidate, name, []
    name = model.name if model.effects else "nominal"
    return model, name, [f"the GP was learnt on another version of this model ({gp.provenance.physics}); see its sum."]


def _fresh(name: str, taken: Sequence[Predictor]) -> str:
    """A name that no other predictor has."""
    names = {p.name for p in taken}
    if name not in names:
        return name
    return next(f"{name} ({n})" for n in range(2, len(names) + 3) if f"{name} ({n})" not in names)


def _check_geometry(model: Model, other: Model) -> None:
    if other.vehicle.name != model.vehicle.name:
        raise ModelError(
            f"{other.name}: is a model of {other.vehicle.name}, {model.name} is one of {model.vehicle.name}; only "
            "models of one vehicle can be compared (the name is vehicle.name)"
        )
    sizes = [
        (0 if v.arms is None else len(v.arms), 0 if v.rotors is None else len(v.rotors))
        for v in (model.vehicle, other.vehicle)
    ]
    if sizes[0] != sizes[1]:
        raise ModelError(
            f"{other.name}: {sizes[1][0]} arms and {sizes[1][1]} rotors, {model.name} has {sizes[0][0]} and "
            f"{sizes[0][1]}; only models of one vehicle can be compared"
        )


def worst_stretches(
    records: Sequence[Record], residuals: Sequence[Array], weights: Array, count: int = STRETCHES
) -> tuple[Stretch, ...]:
    """The stretches of `STRETCH_SECONDS` with the largest weighted error, none overlapping, worst first."""
    found: list[tuple[float, int, int, int]] = []
    for number, (record, residual) in enumerate(zip(records, residuals, strict=True)):
        length = max(1, min(len(record), round(STRETCH_SECONDS / (record.dt * (record.keep.step or 1)))))
        energy = np.sum((residual * weights) ** 2, axis=1)
        sums = np.convolve(energy, np.ones(length), mode="valid") / length
        for _ in range(count):
            start = int(np.argmax(sums))
            if not np.isfinite(sums[start]) or sums[start] < 0:
                break
            found.append((float(sums[start]), number, start, length))
            sums[max(0, start - length + 1) : start + length] = -1.0
    found.sort(key=lambda item: -item[0])
    return tuple(_stretch(records[n], residuals[n], weights, start, size) for _, n, start, size in found[:count])


def _stretch(record: Record, residual: Array, weights: Array, start: int, length: int) -> Stretch:
    part = slice(start, start + length)
    rms = np.sqrt(np.mean(residual[part] ** 2, axis=0))
    state = record.state_kept
    posed = record.has_pose
    return Stretch(
        record.flight,
        float(record.time[part][0]),
        float(record.time[part][-1]),
        rms,
        AXES[int(np.argmax(rms * weights))],
        float(np.degrees(np.median(so3.tilt_angle(state.quat_EB[part])))) if posed else None,
        float(np.median(np.linalg.norm(record.commanded[part, :3], axis=1))),
        float(np.median(np.linalg.norm(state.omega_B[part], axis=1))),
        float(np.median(np.linalg.norm(state.velocity_E[part], axis=1))) if posed else None,
    )


def cutoff_checked(cutoff_hz: float) -> float:
    """The cut-off, if it is one."""
    if not (np.isfinite(cutoff_hz) and cutoff_hz > 0):
        raise FitError(f"--cutoff {cutoff_hz:g}: expected a positive number of Hz, e.g. 8")
    return cutoff_hz
