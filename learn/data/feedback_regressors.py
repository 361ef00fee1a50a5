"""What commands that answer the motion could explain, whatever the vehicle is like.

In every stabilised vehicle torque commands answer the motion, and with it whatever disturbs: measured and commanded
wrench are related through the controller. What any such relation could explain is no evidence for an effect, and where
it is taken for one the answer is biased (Forssell and Ljung, Automatica 35, 1999: direct identification in closed loop
where the noise model is wrong). Neither is how means over blocks of time differ where the commands' do: a slow gust is
answered slowly. The mean of a flight is left in: no controller explains that.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.filters import filtered
from wrenchgap.flight.flight import Array, Indices
from wrenchgap.learn.data.errors import means_by
from wrenchgap.learn.data.input_errors import EDGES, by_band, density, sensors_by_band
from wrenchgap.learn.data.measurement import Record


@dataclass(frozen=True)
class RegressorSettings:
    """Behind which lags and delays commands are seen."""

    lags: tuple[float, ...] = (0.0, 0.03, 0.08, 0.2)
    """Time constants [s] of the first-order lags behind which commands are seen."""
    shifts: tuple[float, ...] = (-0.4, -0.2, 0.2, 0.4)
    """Delays, in periods of the filter's corner. An answer comes after what it answers, so some are leads."""
    parts: tuple[float, ...] = (1.2, 4.5)
    """Frequencies [Hz] between and beyond which the size of an answer's gain may be another: two octaves each."""
    commanded: float = 0.2
    """Power of a disturbance over that of the command up to which an axis follows its command: the most by which a gain
    is found wrong there, on average."""


REGRESSORS = RegressorSettings()
ROUNDING = 1e-9
"""Share of a command's size below which a change of it is one of rounding."""


def answers(records: Sequence[Record], shifts: Sequence[float] = ()) -> tuple[Array, Indices]:
    """All commands that change, behind first-order lags and later by `shifts`: (K, A), and the axis (A,) of each."""
    size = np.max([np.abs(r.commanded).max(axis=0) for r in records], axis=0)
    moving = np.flatnonzero(np.max([np.std(r.commanded, axis=0) for r in records], axis=0) > ROUNDING * size)
    rows = []
    for r in records:
        sent = [r.commanded[:, a] for a in moving]
        late = [lagged(x, tau / r.dt_kept) for x in sent for tau in REGRESSORS.lags]
        late += [shifted(x, round(share / (r.cutoff_hz * r.dt_kept))) for x in sent for share in shifts]
        rows.append(np.stack(late, axis=1) if late else np.zeros((len(r), 0)))
    of = [a for a in moving for _ in REGRESSORS.lags] + [a for a in moving for _ in shifts]
    return np.concatenate(rows), np.array(of, dtype=np.intp)


def answer_gains(records: Sequence[Record]) -> Array:
    """Largest gain (bands, 6, 6) from each command (last) to what is measured on an axis that an answer to a
    disturbance may make; NaN on axes on which more than `REGRESSORS.commanded` of the power may be one.

    Of a command u = e - H d that answers the disturbance d, a regression finds the gain S_du / S_u beside the vehicle's
    own (Forssell and Ljung, sec. 5). With S_d of all that the nominal vehicle leaves beyond the sensors' noise and |H|
    of one that is sqrt(S_d / S_u) between two axes if all of the command answers; of it answers the share
    sqrt(S_d / S_u) of its own axis.
    """  # noqa: D205
    sent, made = np.zeros((2, len(EDGES) + 1, 6))
    for r in records:
        share = len(r) / sum(len(each) for each in records)
        sent += share * np.nan_to_num(by_band(*density(r.commanded, r.dt_kept)))
        left = by_band(*density(np.nan_to_num(r.measured - r.commanded), r.dt_kept))
        made += share * np.nan_to_num(np.maximum(left - sensors_by_band(r), 0.0))
    sent = np.maximum(sent, 1e-30)
    answering = np.minimum(1.0, np.sqrt(made / sent))
    out = np.sqrt(made[:, :, None] / sent[:, None, :]) * answering[:, None, :]
    wide = np.diff((0.0, *EDGES, EDGES[-1] + 1.0))
    out[:, wide @ made > REGRESSORS.commanded * (wide @ sent)] = np.nan
    return np.asarray(out)


def by_parts(gains: Array) -> Array:
    """Gains (bands, A) as those of as many regressors in each part of the frequencies alone: the largest there."""
    part = np.digitize(np.append(0.0, EDGES), REGRESSORS.parts)
    each = [(part == k)[:, None] for k in range(len(REGRESSORS.parts) + 1)]
    return np.hstack([own * np.max(gains * own, axis=0) for own in each])


def in_parts(signals: Array) -> Array:
    """Signals (K, A) as often as `by_parts` has gains for them."""
    return np.tile(signals, len(REGRESSORS.parts) + 1)


@dataclass(frozen=True)
class Answerable:
    """What commands that answer could explain: directions `basis` (K, B), the `share` (B,) of each that is taken out.

    With noise of size one and of each of some signals any share up to about one, a residual has the covariance
    C = 1 + F F^T. C^(-1/2), which makes it white, leaves 1 / sqrt(1 + s^2) of a singular direction of F of size s.
    """

    basis: Array
    share: Array

    def out_of(self, values: Array) -> Array:
        """Values (K, ...) without that."""
        flat = values.reshape(len(values), -1)
        return np.asarray(values - (self.basis @ (self.share[:, None] * (self.basis.T @ flat))).reshape(values.shape))


def wholly(signals: Array, of: Array | None = None) -> Answerable:
    """All that signals (K, A) span, none of those that are but rounding of what they are filtered `of` (K, A)."""
    size = np.linalg.norm(signals, axis=0)
    basis = spanned(signals[:, size > ROUNDING * (size if of is None else np.linalg.norm(of, axis=0))])
    return Answerable(basis, np.ones(basis.shape[1]))


def partly(signals: Array) -> Answerable:
    """Signals (K, A) as large as they may be, in units of the noise."""
    basis, size, _ = np.linalg.svd(signals, full_matrices=False)
    return Answerable(basis, 1.0 - 1.0 / np.sqrt(1.0 + size**2))


def within_blocks(signals: Array, block: Indices) -> Array:
    """Signals (K, A) without their means over the blocks (K,) of time."""
    return np.asarray(signals - means_by(block, signals)[block])


def slowly_answerable(records: Sequence[Record], block: Indices, flight: Indices) -> Answerable:
    """How the commands' means over blocks (K,) of time differ within a flight (K,)."""
    sent = np.concatenate([r.commanded for r in records])
    moved = means_by(block, sent)[block] - means_by(flight, sent)[flight]
    return wholly(np.where(np.abs(moved).max(axis=0) > ROUNDING * np.abs(sent).max(axis=0), moved, 0.0))


def spanned(signals: Array) -> Array:
    """Orthonormal basis (K, B) of what signals (K, A) span, each counting alike."""
    size = np.linalg.norm(signals, axis=0)
    if not np.any(size > 0.0):
        return np.zeros((len(signals), 0))
    left, spread, _ = np.linalg.svd(signals[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    return np.asarray(left[:, spread > 1e-6 * spread.max()])


def shifted(signal: Array, samples: int) -> Array:
    """A signal (N,) so many samples later, or earlier; its ends go on as they are."""
    return np.asarray(signal[np.clip(np.arange(len(signal)) - samples, 0, len(signal) - 1)])


def lagged(signal: Array, samples: float) -> Array:
    """A signal (N,) behind a first-order lag of so many samples, at rest where it begins."""
    decay = float(np.exp(-1.0 / samples)) if samples > 0.0 else 0.0
    b, a, start = np.array([1.0 - decay]), np.array([1.0, -decay]), np.array([[decay * signal[0]]])
    return filtered(b, a, signal[:, None], start)[:, 0]
