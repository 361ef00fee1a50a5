"""What flights say about columns, by frequency: blocks of time, their cosine transforms, and products of columns.

Residuals are coloured: sensors, turbulence and what nothing explains have each their own spectrum. Records are cut
into blocks of time, each is transformed (type-II discrete cosine, orthonormal), and the coefficients of one
axis in one band of frequencies are taken to have one variance, which is unknown (`learn.posterior.score`). This is
the Whittle likelihood with a piecewise constant spectrum. Source: Whittle, J. R. Stat. Soc. B 15, 1953; the cosine
transform in place of Fourier's for finite blocks, Ahmed, Natarajan and Rao, IEEE Trans. Comput. C-23, 1974.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.fft import dct

from wrenchgap.flight.flight import AXES, Array, Indices
from wrenchgap.flight.memory import empty_on_disk, let_go
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import means_by, sums_by
from wrenchgap.learn.data.feedback_regressors import (
    REGRESSORS,
    Answerable,
    answers,
    by_parts,
    in_parts,
    partly,
    slowly_answerable,
    spanned,
    wholly,
)
from wrenchgap.learn.data.input_errors import EDGES
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.data.sensor_noise import coefficient_shapes
from wrenchgap.learn.identify.bias_and_trim import Trim
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.linear_problem import LinearProblem
from wrenchgap.learn.posterior.settings import DEFAULT, SearchSettings

LARGE = 1 << 24
"""Bytes of coefficients from which on they wait on disk: products are what a search asks for."""
AT_ONCE = 24
"""Quantities that are transformed at once, at least."""


@dataclass(frozen=True)
class Answers:
    """What is taken out of the coefficients of an axis, of size one by `weight` (K, 1): what commands answered, and a
    basis (K, B) of the motion that no command explains.
    """  # noqa: D205

    weight: Array
    answerable: Answerable
    disturbed: Array


class Spectrum(LinearProblem):
    """Products of everything linear, by band and axis.

    Always there are biases and trims of flights (`learn.identify.bias_and_trim`), and what the model's own effects may
    be off by (`known`). On the axes where commands answer the motion it is of all of them what free responses to all
    commands leave (`learn.data.feedback_regressors`). `leak` is the mean square of the share of that name of what the
    model leaves in all of an axis' force, or torque, in that band, and of what the commands may err by there
    (`input_errors`).
    """

    def __init__(
        self,
        data: Dataset,
        base: Array,
        columns: Sequence[Column],
        trim: Trim,
        known: Sequence[Column] = (),
        settings: SearchSettings = DEFAULT,
    ) -> None:
        self.settings = settings
        flights = int(data.flight.max()) + 1
        limit = np.concatenate((np.tile(trim.limit, flights), *(c.high for c in known)))
        size = np.concatenate((np.tile(trim.scale, flights), *(c.scale for c in known)))
        super().__init__(columns, -limit, limit, size)
        self.axes = np.flatnonzero(data.measured_axes)
        lines = [part for c in columns for part in (c.jacobian, c.offset[:, :, None])]
        stacked = [base[:, :, None], *lines, trim.columns(data), *(c.jacobian for c in known)]
        self.coefficients, self.block, hertz = side_by_side(data.records, stacked, self.axes, settings.block)
        self.hertz = hertz
        _, self.band = np.unique(np.digitize(hertz, EDGES), return_inverse=True)
        self.starts = np.flatnonzero(np.diff(self.block, prepend=-1))
        self.blocks = len(self.starts)
        self.silent = data.untrusted[np.digitize(hertz, EDGES)][:, self.axes] & (hertz > 0.0)[:, None]
        self.count = self.counted()
        self.sensor = sensor_spectrum(data, hertz, self.band)[:, self.axes]
        self.leak = leaking(means_by(self.band, self.coefficients[:, :, 0] ** 2), self.axes, settings.leak)
        self._silence(data)
        self._take_out_answers(data)
        self.factors = np.ones(self.blocks)
        self._arrange(data)

    def _arrange(self, data: Dataset) -> None:
        """What a kind of spectrum does with its coefficients before anything is asked of it."""

    @cached_property
    def products(self) -> Array:
        """Means over coefficients (bands, axes, Q, Q), worked out when they are asked for."""
        rows = self.coefficients.transpose(1, 2, 0)
        size = rows.shape[1]
        out = np.empty((len(self.count), len(rows), size, size))
        bands = [np.flatnonzero(self.band == k) for k in range(len(self.count))]
        for axis, each in enumerate(rows):
            for k, own in enumerate(bands):
                x = each[:, own]
                np.divide(x @ x.T, max(self.count[k, axis], 1.0), out=out[k, axis])
            let_go(rows)
        return out

    def counted(self) -> Array:
        """Coefficients (bands, A) that say something of the vehicle."""
        return sums_by(self.band, ~self.silent)

    def _silence(self, data: Dataset) -> None:
        """Of all but what the model leaves: nothing where commands say nothing, and the mean of a flight where they do
        not say what changes slowly. What they may err by elsewhere nobody can tell from a law (`leak`).
        """  # noqa: D205
        for axis in np.flatnonzero(self.silent.any(axis=0)):
            self.coefficients[self.silent[:, axis], axis, 1:] = 0.0
        for axis in np.flatnonzero(data.untrusted[0, self.axes]):
            for flight in np.unique(data.flight):
                rows = self.starts[data.flight[self.starts] == flight]
                size = np.sqrt(np.bincount(self.block)[self.block[rows]])[:, None]
                self.coefficients[rows, axis, 1:] = size * (self.coefficients[rows, axis, 1:] / size).mean(axis=0)
        self.error = input_errors(data, self.axes, self.hertz, self.settings.block)
        self.leak = self.leak + sums_by(self.band, self.error * ~self.silent) / np.maximum(self.count, 1.0)

    def _take_out_answers(self, data: Dataset) -> None:
        """On the axes where commands answer the motion: leave of everything what no linear response to the commands
        explains, the means of the blocks apart, weighed by the spectrum of what the model leaves. Of all but what the
        model leaves take out, too, the disturbance (`_disturbed`) and how means over blocks go with the commands'
        (`slowly_answerable`): so what an effect explains there is the mean of a flight, and what nothing answers.
        """  # noqa: D205
        if not set(self.axes) & set(data.answering):
            return
        left = np.ascontiguousarray(self.coefficients[:, :, 0])  # on which alone depends what is taken out
        key = hashlib.blake2b(left.tobytes()).digest()
        if key not in data.answers_of:
            data.answers_of.clear()
            data.answers_of[key] = self._answers(data, left)
        slow, answers = data.answers_of[key]
        for k, one in answers.items():
            part = one.answerable.out_of(self.coefficients[:, k] * one.weight)
            part[:, 1:] -= one.disturbed @ (one.disturbed.T @ part[:, 1:])
            self.coefficients[:, k] = part / one.weight
            means = self.coefficients[self.starts, k, 1:]
            self.coefficients[self.starts, k, 1:] -= slow @ (slow.T @ means)
            let_go(self.coefficients)

    def _answers(self, data: Dataset, left: Array) -> tuple[Array, dict[int, Answers]]:
        """A basis (blocks, B) of the commands' means over blocks, and by axis what is taken out of the rest."""
        signals, of = answers(data.records, REGRESSORS.shifts)
        seconds = self.settings.block
        free = transformed(data.records, signals[:, None], seconds, without_mean=True)[0][:, 0]
        measured = np.concatenate([r.measured for r in data.records])
        moved = transformed(data.records, measured[:, :, None], seconds, without_mean=True)[0][:, :, 0]
        slow = slowly_answerable(data.records, self.block, data.flight).basis[self.starts]
        slow *= np.sqrt(np.bincount(self.block))[:, None]  # of means: a coefficient is a mean times that
        out = {}
        for k in (k for k, axis in enumerate(self.axes) if axis in data.answering):
            known = ~self.silent[:, k, None]
            weight = self._weight(k, left[:, k])
            every = wholly(free * weight * known)
            disturbed = self._disturbed(k, every.out_of(moved[:, self.axes[k], None] * weight * known), weight)
            gain = by_parts(data.answer_gains[:, self.axes[k], of])[np.digitize(self.hertz, EDGES)]
            if np.isfinite(gain).all():
                rest = every.out_of(left[:, k, None] * weight) / weight
                sure = self._weight(k, rest[:, 0])
                every = partly(in_parts(free * sure * known) * gain)
                disturbed, weight = spanned(disturbed * sure / weight), sure
            out[k] = Answers(weight, every, disturbed)
        return slow, out

    def _weight(self, k: int, left: Array) -> Array:
        """One over the size (K, 1) that coefficients (K,) have on an axis, by band, no less than the sensors' noise."""
        power = np.bincount(self.band, weights=left**2) / np.maximum(self.count[:, k], 1.0)
        return np.asarray(np.maximum(power, self.sensor[:, k])[self.band][:, None] ** -0.5)

    def _disturbed(self, k: int, left: Array, weight: Array) -> Array:
        """Orthonormal basis (K, B) of an axis' motion above noise that no command explains: the disturbance."""
        power = np.bincount(self.band, weights=(left / weight)[:, 0] ** 2) / np.maximum(self.count[:, k], 1.0)
        disturbed = power > self.settings.structure**2 * self.sensor[:, k]
        return spanned(left * disturbed[self.band][:, None])

    def combined(self, weights: Array) -> Array:
        """Sum (K, L) of the coefficients of the quantities times these weights (Q,)."""
        used = np.flatnonzero(weights)
        out = np.empty(self.coefficients.shape[1::-1])
        for axis, rows in enumerate(self.coefficients.transpose(1, 2, 0)):
            out[axis] = np.tensordot(weights[used], rows[used], 1)
            let_go(rows)
        return out.T

    def calm(self, weights: Array) -> None:
        """Take weight off the blocks of time in which far more is left than in others: a hand, a gust."""
        self.down_weight(self.block_weights(self.combined(weights)))

    def block_weights(self, left: Array) -> Array:
        """Factors (blocks,) of blocks of time, of which this is left (K, L): less than one of the loud ones."""
        mean = sums_by(self.band, left**2) / np.maximum(self.count, 1.0)
        size = np.add.reduceat(np.mean(left**2 / np.maximum(mean, self.sensor)[self.band], axis=1), self.starts)
        size /= np.bincount(self.block)
        return np.asarray(np.sqrt(np.minimum(1.0, self.settings.loud * np.median(size) / np.maximum(size, 1e-30))))

    def down_weight(self, factors: Array) -> None:
        """Multiply the blocks of time by these factors (blocks,)."""
        self.factors = factors
        if np.any(factors < 1.0):
            for axis in range(len(self.axes)):
                self.coefficients[:, axis] *= factors[self.block][:, None]
                let_go(self.coefficients)
            self.__dict__.pop("products", None)


def transformed(
    records: Sequence[Record], stacked: Array, seconds: float, *, without_mean: bool = False
) -> tuple[Array, Indices, Array]:
    """Cosine coefficients (K, L, Q) of blocks of about `seconds`, and of each (K,) its block and frequency [Hz]."""
    out = np.empty(stacked.shape)
    cuts, block, hertz = blocks_of_time(records, seconds)
    for own in cuts:
        part = stacked[own]
        part = part - part.mean(axis=0) if without_mean else part
        out[own] = dct(part, axis=0, norm="ortho", type=2)
        if without_mean:
            out[own.start] = 0.0  # and not what rounding leaves, which would be a direction like any other
    return out, block, hertz


def side_by_side(
    records: Sequence[Record], parts: Sequence[Array], axes: Indices, seconds: float
) -> tuple[Array, Indices, Array]:
    """`transformed` of these axes of arrays (K, 6, .) side by side, which would be large twice. In memory every
    quantity lies in one piece, axis by axis: what is summed and multiplied are quantities.
    """  # noqa: D205
    ends = np.cumsum([0, *(part.shape[2] for part in parts)])
    cuts, block, hertz = blocks_of_time(records, seconds)
    shape = (int(ends[-1]), len(axes), len(block))
    rows = np.empty(shape) if 8 * np.prod(shape) < LARGE else empty_on_disk(shape, least=1)
    first = 0
    for part, (low, high) in zip(parts, itertools.pairwise(ends), strict=True):
        for k, axis in enumerate(axes):
            rows[low:high, k] = part[:, axis].T
        let_go(part)
        if high - first >= AT_ONCE or high == ends[-1]:
            for own in cuts:
                rows[first:high, :, own] = dct(rows[first:high, :, own], axis=2, norm="ortho", type=2)
            let_go(rows)
            first = high
    return rows.transpose(2, 1, 0), block, hertz


def blocks_of_time(records: Sequence[Record], seconds: float) -> tuple[list[slice], Indices, Array]:
    """Samples of each block of about `seconds`; of the coefficients (K,) the block, and the frequency [Hz]."""
    cuts: list[slice] = []
    block: list[Indices] = []
    hertz: list[Array] = []
    at = 0
    for record in records:
        n, dt = len(record), record.dt_kept
        ends = np.linspace(0, n, max(1, round(n * dt / seconds)) + 1).astype(int)
        for first, last in itertools.pairwise(ends):
            cuts.append(slice(at + first, at + last))
            hertz.append(np.arange(last - first) / (2 * (last - first) * dt))
            block.append(np.full(last - first, len(block)))
        at += n
    return cuts, np.concatenate(block), np.concatenate(hertz)


def input_errors(data: Dataset, axes: Indices, hertz: Array, seconds: float) -> Array:
    """Squares (K, A) of the cosine coefficients that commands may err by (`learn.data.input_errors`), means aside."""
    sent = np.concatenate([r.commanded for r in data.records])[:, axes, None]
    if not any(r.input_error is not None for r in data.records):
        return np.zeros(sent.shape[:2])
    nothing = np.zeros((len(EDGES) + 1, len(AXES)))
    shares = np.array([nothing if r.input_error is None else r.input_error for r in data.records])
    record = np.repeat(np.arange(len(shares)), [len(r) for r in data.records])
    squares = transformed(data.records, sent, seconds, without_mean=True)[0][:, :, 0] ** 2
    return np.asarray(shares[record, np.digitize(hertz, EDGES)][:, axes] * squares)


def leaking(power: Array, axes: Indices, share: float) -> Array:
    """`Spectrum.leak` (bands, axes): this share of what the model leaves, of which these are the mean squares."""
    forces = axes < len(AXES) // 2
    out = np.empty(power.shape)
    for own in (forces, ~forces):
        out[:, own] = share**2 * power[:, own].sum(axis=1, keepdims=True)
    return out


def sensor_spectrum(data: Dataset, hertz: Array, band: Indices) -> Array:
    """Variance (bands, 6) of a coefficient from sensors alone (`coefficient_shapes`)."""
    shapes = np.repeat(coefficient_shapes(hertz, band, data.records[0].cutoff_hz), 3, axis=1)
    shapes *= np.nan_to_num(data.noise) ** 2 / shapes.mean(axis=0)
    return np.maximum(means_by(band, shapes), 1e-30)
