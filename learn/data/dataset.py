"""Records of flights, stacked and cut into blocks of time: what every analysis is given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import Array, Indices, Mask
from wrenchgap.flight.memory import trim
from wrenchgap.learn.data import feedback_regressors as feedback
from wrenchgap.learn.data.input_errors import EDGES, untrusted
from wrenchgap.learn.data.measurement import Record, window
from wrenchgap.learn.data.prediction import Evaluator
from wrenchgap.plant.model import Model
from wrenchgap.plant.wrench_model import WrenchModel


@dataclass(frozen=True)
class Dataset:
    """Records of one or several flights, stacked: K samples in all.

    `measured` and `commanded` are (K, 6); `block` (K,) numbers the blocks of time and `flight` (K,) the flights;
    `weights` (6,) puts newtons and newton metres on one scale; `independence` is the share of samples that count as
    independent. `answering` are the axes on which commands answer the motion (`learn.data.feedback_regressors`). An
    axis that one of the records did not measure is out: NaN in `measured` and `noise`, weight zero. `source` is what
    these are `unanswering` of.
    """

    records: tuple[Record, ...]
    measured: Array
    commanded: Array
    block: Indices
    flight: Indices
    weights: Array
    independence: float
    answering: tuple[int, ...] = ()
    source: Dataset | None = field(default=None, repr=False, compare=False)

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Pickled by its source, which the other process may have."""
        return super().__reduce_ex__(protocol) if self.source is None else (Dataset.unanswering, (self.source,))

    def predict(self, model: WrenchModel) -> Array:
        """Predicted measured wrench (K, 6)."""
        return np.concatenate([evaluate(model) for evaluate in self.evaluators])

    @cached_property
    def evaluators(self) -> tuple[Evaluator, ...]:
        """One for each record; they remember what models have in common."""
        if self.source:
            return self.source.evaluators
        return tuple(Evaluator(record, balanced=True) for record in self.records)

    @cached_property
    def answer_gains(self) -> Array:
        """How far the commands of these flights may answer (`learn.data.feedback_regressors`)."""
        return self.source.answer_gains if self.source else feedback.answer_gains(self.records)

    @cached_property
    def answerable(self) -> dict[int, feedback.Answerable]:
        """Of the axes `answering`: what those answers could explain within blocks of time."""
        signals, of = feedback.answers(self.records)
        signals = feedback.within_blocks(signals, self.block)
        left = feedback.within_blocks(np.nan_to_num(self.measured - self.commanded), self.block)
        out = {}
        for axis in self.answering:
            trusted = ~self.untrusted[:, axis]
            out[axis] = every = feedback.wholly(self.with_gains(signals, trusted), signals)
            gain = feedback.by_parts(self.answer_gains[:, axis, of] * trusted[:, None])
            if np.isfinite(gain).all():
                size = every.out_of(self.with_gains(left[:, axis], trusted))
                noise = max(float(np.std(size)), self.noise[axis]) / np.sqrt(self.independence)
                out[axis] = feedback.partly(self.with_gains(feedback.in_parts(signals), gain) / noise)
        return out

    @cached_property
    def slowly_answerable(self) -> feedback.Answerable:
        """The same of how means over blocks differ within a flight."""
        return feedback.slowly_answerable(self.records, self.block, self.flight)

    def by_record(self, values: Array) -> list[Array]:
        """The rows of values (K, ...) that are of each record."""
        return np.split(values, np.cumsum([len(r) for r in self.records])[:-1])

    def forget(self) -> None:
        """Free what evaluators remember of these data: the next models have little in common with the last."""
        for evaluator in self.evaluators:
            evaluator.forget()
        trim()

    def unanswering(self) -> Dataset:
        """The same flights, the wrench as it is; what was worked out of their records is shared."""
        return replace(self, answering=(), source=self)

    @property
    def root(self) -> Dataset:
        """What remembers for these data: the source, or themselves."""
        return self.source or self

    @cached_property
    def starts(self) -> dict[tuple[str, ...], tuple[Array, Array, Array]]:
        """By the names of effects: where their fit began, the residual there (K, 6), its derivatives (K, 6, P).

        Kept by the table of these data for that of those `unanswering`, which begins in the same places.
        """
        return {}

    @cached_property
    def answers_of(self) -> dict[bytes, Any]:
        """What the last spectrum of these data took out (`learn.posterior.spectrum`), by a digest of what was left."""
        return {}

    def unanswered(self, values: Array) -> Array:
        """What derivatives, or residuals, (K, 6, ...) say of the vehicle: `informative`, without answering commands.

        What those could explain on the axes where they answer the motion is taken out, within blocks of time and from
        one to the next; where slow commands are not known either, the mean of a flight.
        """
        out = self.remaining(values)
        for axis in self.answering:
            out[:, axis] = self.slowly_answerable.out_of(out[:, axis])
        for silent in np.flatnonzero(self.untrusted[0]):
            for flight in np.unique(self.flight):
                rows = self.flight == flight
                out[rows, silent] = out[rows, silent].mean(axis=0)
        return out

    def remaining(self, values: Array) -> Array:
        """The same of residuals (K, 6, ...) as they scatter: their means over blocks of time as they are."""
        out = self.informative(values)
        if not self.answering:
            return out
        out = values.copy() if out is values else out
        for axis in self.answering:
            out[:, axis] = self.answerable[axis].out_of(out[:, axis])
        return out

    def evidence(self, given: Array, left: Array) -> Array:
        """What a model leaves (K, 6) beside what is `given` (K, 6), as far as it is evidence.

        Both scatter as they do (`remaining`), and differ by what answering commands could not make (`unanswered`).
        """
        return np.asarray(self.remaining(given) - self.unanswered(given - left))

    @cached_property
    def untrusted(self) -> Mask:
        """Bands of frequency and axes (bands, 6) in which commands say nothing (`learn.data.input_errors`)."""
        return untrusted(self.records)

    def informative(self, values: Array) -> Array:
        """Values (K, 6, ...) without the bands in which commands say nothing, by blocks of time; their means stay."""
        axes = np.flatnonzero(self.untrusted.any(axis=0))
        if not axes.size:
            return values
        out = values.copy()
        for axis in axes:
            if self.untrusted[1:, axis].any():
                out[:, axis] = self.with_gains(values[:, axis], ~self.untrusted[:, axis])
        return out

    def with_gains(self, values: Array, gains: NDArray[Any]) -> Array:
        """Values (K, ...) times a gain (bands, ...) in each band of frequency, by blocks of time; their means stay."""
        from scipy.fft import dct, idct  # here: others need not wait for it

        out = values.copy()
        starts = np.flatnonzero(np.diff(self.block, prepend=-1))
        lengths = np.diff(starts, append=len(self.block))
        for n in np.unique(lengths):  # blocks of one length at once
            rows = starts[lengths == n][:, None] + np.arange(n)
            band = np.digitize(np.arange(n) / (2 * n * self.records[0].dt_kept), EDGES)
            gain = gains[band].reshape(n, *gains.shape[1:], *([1] * (values.ndim - gains.ndim)))
            amplitude = dct(values[rows], axis=1, norm="ortho")
            amplitude[:, 1:] *= gain[1:]
            out[rows] = idct(amplitude, axis=1, norm="ortho")
        return out

    @property
    def measured_axes(self) -> Mask:
        """Which axes (6,) all records measured."""
        return np.asarray(self.weights > 0.0)

    @property
    def noise(self) -> Array:
        """Sensor noise (6,), the mean over records."""
        lengths = np.array([len(r) for r in self.records], dtype=float)
        squared = np.array([r.noise**2 for r in self.records])
        return np.asarray(np.sqrt(lengths @ squared / lengths.sum()))


def length_scale(model: Model) -> float:
    """The length [m] that makes torques comparable with forces: the vehicle's radius of gyration times sqrt(3)."""
    body = model.vehicle.body
    return float(np.sqrt(1.5 * np.trace(body.inertia) / body.mass))


def dataset(
    records: Sequence[Record], model: Model, answering: Sequence[int] = (), seconds: float = 2.0, fewest: int = 8
) -> Dataset:
    """Stack records; weights are 1/N for forces and 1/(N l) for torques, l the vehicle's `length_scale`.

    Blocks of time that are treated as independent last `seconds`, many filter lengths; a short log is cut into `fewest`
    at least, as long as a block holds four periods of the cut-off.
    """
    if not records:
        raise FitError("no stretch of flight is long enough to be used; see `wrenchgap inspect`")
    blocks: list[Indices] = []
    count = 0
    durations = [float(r.time[-1] - r.time[0]) for r in records]
    length = min(seconds, max(sum(durations) / fewest, 4.0 / records[0].cutoff_hz))
    for record, duration in zip(records, durations, strict=True):
        pieces = max(1, round(duration / length))
        index = np.minimum((record.time - record.time[0]) / max(duration, 1e-9) * pieces, pieces - 1).astype(np.intp)
        blocks.append(index + count)
        count += pieces
    first = records[0]
    names = list(dict.fromkeys(r.flight for r in records))
    known = np.all([r.measured_axes for r in records], axis=0)
    if not known.any():
        raise FitError("no axis of the wrench was measured on all of these flights; see `wrenchgap inspect`")
    return Dataset(
        tuple(records),
        np.where(known, np.concatenate([r.measured for r in records]), np.nan),
        np.concatenate([r.commanded for r in records]),
        np.concatenate(blocks),
        np.concatenate([np.full(len(r), names.index(r.flight)) for r in records]),
        np.where(known, np.repeat([1.0, 1.0 / length_scale(model)], 3), 0.0),
        min(1.0, first.dt_kept * 2.0 * first.cutoff_hz),
        tuple(answering),
    )


def latest(records: Sequence[Record], seconds: float) -> tuple[Record, ...]:
    """The last `seconds` of flight."""
    out: list[Record] = []
    missing = round(seconds / records[0].dt_kept)
    for record in reversed(records):
        if missing > 0:
            out.insert(0, window(record, max(0, len(record) - missing), len(record)))
            missing -= len(record)
    return tuple(out)


def spread_out(records: tuple[Record, ...], seconds: float, piece: float = 40.0) -> tuple[Record, ...]:
    """About `seconds` of flight in pieces of at most `piece` [s], evenly spread; all where there is no more."""
    step = records[0].dt_kept
    total = sum(len(r) for r in records) * step
    if total <= seconds:
        return records
    share, length = seconds / total, round(piece / step)
    out: list[Record] = []
    passed = kept = 0
    for record in records:
        passed += len(record)
        wanted = share * passed - kept
        if wanted < 0.5 * min(length, len(record)):
            continue
        if len(record) <= length:
            out.append(record)
            kept += len(record)
            continue
        count = max(1, round(wanted / length))
        starts = np.linspace(0, len(record) - length, count).astype(int)
        out += [window(record, int(s), int(s) + length) for s in starts]
        kept += count * length
    return tuple(out)
