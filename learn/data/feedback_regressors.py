"""What commands that answer the motion could explain, whatever the vehicle is like.

In every stabilised vehicle torque commands answer the motion, and with it whatever disturbs: measured and commanded
wrench are related through the controller. What any such relation could explain is no evidence for an effect, and where
it is taken for one the answer is biased (Forssell and Ljung, Automatica 35, 1999: direct identification in closed loop
where the noise model is wrong). Neither is how means over blocks of time differ where the commands' do: a slow gust is
answered slowly. The mean of a flight is left in: no controller explains that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.filters import filtered
from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.measurement import Record


@dataclass(frozen=True)
class RegressorSettings:
    """Behind which lags and delays commands are seen."""

    lags: tuple[float, ...] = (0.0, 0.03, 0.08, 0.2)
    """Time constants [s] of the first-order lags behind which commands are seen."""
    shifts: tuple[float, ...] = (-0.4, -0.2, 0.2, 0.4)
    """Delays, in periods of the filter's corner. A command that answers comes after what it answers, so some are
    leads."""


REGRESSORS = RegressorSettings()


def answers(records: Sequence[Record], shifts: Sequence[float] = ()) -> Array:
    """All commands that change, behind first-order lags and later by `shifts`: (K, A), K samples of all records."""
    moving = [a for a in range(6) if max(float(np.std(r.commanded[:, a])) for r in records) > 0.0]
    rows = []
    for r in records:
        sent = [r.commanded[:, a] for a in moving]
        late = [lagged(x, tau / r.dt_kept) for x in sent for tau in REGRESSORS.lags]
        late += [shifted(x, round(share / (r.cutoff_hz * r.dt_kept))) for x in sent for share in shifts]
        rows.append(np.stack(late, axis=1) if late else np.zeros((len(r), 0)))
    return np.concatenate(rows)


def answerable(records: Sequence[Record], block: NDArray[np.intp]) -> Array:
    """`answers` (K, A) without their means over the blocks (K,) of time."""
    signals = answers(records)
    return signals - means(signals, block)[block]


def slowly_answerable(records: Sequence[Record], block: NDArray[np.intp], flight: NDArray[np.intp]) -> Array:
    """Orthonormal basis (K, B) of how the commands' means over blocks (K,) of time differ within a flight (K,)."""
    sent = np.concatenate([r.commanded for r in records])
    return spanned(means(sent, block)[block] - means(sent, flight)[flight])


def means(signals: Array, part: NDArray[np.intp]) -> Array:
    """Means (parts, A) of signals (K, A) over the parts (K,) that samples belong to."""
    count = np.bincount(part)
    sums = [np.bincount(part, weights=s, minlength=len(count)) for s in signals.T]
    return np.stack(sums, axis=1) / count[:, None] if sums else np.zeros((len(count), 0))


def without(basis: Array, values: Array) -> Array:
    """Values (K, ...) without what an orthonormal basis (K, B) explains."""
    flat = values.reshape(len(values), -1)
    return np.asarray(values - (basis @ (basis.T @ flat)).reshape(values.shape))


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
