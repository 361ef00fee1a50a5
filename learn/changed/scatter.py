"""By how much healthy flights differ among themselves, as a wrench: what a change has to exceed.

    s^2 = (max(sum_f (m_f - m)^2 - (F - 1) n^2, 0) + WORTH t^2) / (F - 1 + WORTH)

m_f is what is left of flight f on average when all that is common to the flights is taken off, F the healthy flights,
n^2 the variance that such a mean has from what wanders within the flights: that is noise, which the likelihood has
already. t is the typical scatter (`learn.identify.bias_and_trim.typical_trim`), which is worth `WORTH` flights. One
healthy flight says nothing of its scatter: then t alone. Source: a random effect by flight (Pinheiro and Bates,
"Mixed-Effects Models in S and S-PLUS", 2000, ch. 1) with a conjugate prior of its variance.
"""

from __future__ import annotations

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.identify.bias_and_trim import WORTH


def means_by_flight(data: Dataset, left: Array) -> Array:
    """Signed means (F, 6) of a residual (K, 6) by flight."""
    count = np.bincount(data.flight)
    return np.stack([np.bincount(data.flight, weights=r) / count for r in left.T], axis=1)


def noise_of_means(data: Dataset, left: Array) -> Array:
    """Variance (6,) that the mean of a residual (K, 6) over a flight has from what wanders within it, by blocks of
    time; the mean over flights.
    """  # noqa: D205
    out = []
    for f in np.unique(data.flight):
        mine = data.flight == f
        _, block = np.unique(data.block[mine], return_inverse=True)
        means = np.stack([np.bincount(block, weights=r) / np.bincount(block) for r in left[mine].T], axis=1)
        out.append(means.var(axis=0, ddof=1) / len(means) if len(means) > 1 else np.zeros(6))
    return np.asarray(np.mean(out, axis=0))


def scatter_between(means: Array, usual: Array, noise: Array | float = 0.0) -> Array:
    """Standard deviation (6,) [N, Nm] between flights, of the means (F, 6) of healthy ones, which have the variance
    `noise` (6,) themselves; `usual` (6,) is the typical one.
    """  # noqa: D205
    count = len(means)
    spread = np.sum((means - means.mean(axis=0)) ** 2, axis=0)
    more = np.maximum(spread - (count - 1) * np.asarray(noise), 0.0)
    return np.asarray(np.sqrt((more + WORTH * usual**2) / (count - 1 + WORTH)))
