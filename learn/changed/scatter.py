"""By how much healthy flights differ among themselves, as a wrench: what a change has to exceed.

    s^2 = (sum_f (m_f - m)^2 + WORTH t^2) / (F - 1 + WORTH)

m_f is what is left of flight f on average when all that is common to the flights is taken off, F the healthy flights,
t the typical scatter (`learn.identify.trim.typical`), which is worth `WORTH` flights. One healthy flight says nothing
of its scatter: then t alone. Source: a random effect by flight (Pinheiro and Bates, "Mixed-Effects Models in S and
S-PLUS", 2000, ch. 1) with a conjugate prior of its variance.
"""

from __future__ import annotations

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.identify.trim import WORTH, typical
from wrenchgap.plant.model import Model


def means_by_flight(data: Dataset, left: Array) -> Array:
    """Signed means (F, 6) of a residual (K, 6) by flight."""
    count = np.bincount(data.flight)
    return np.stack([np.bincount(data.flight, weights=r) / count for r in left.T], axis=1)


def scatter_between(means: Array, model: Model) -> Array:
    """Standard deviation (6,) [N, Nm] between flights, of the means (F, 6) of healthy ones."""
    count = len(means)
    spread = np.sum((means - means.mean(axis=0)) ** 2, axis=0)
    return np.asarray(np.sqrt((spread + WORTH * typical(model) ** 2) / (count - 1 + WORTH)))
