"""A few representative samples of a long log, and all of them behind a prediction that costs as much as those few.

Equations and sources: docs/theory/process.md, Points. The distance matrix of k-medoids grows with the square of the
number of samples, so the log is thinned first; memory is then bounded, however long the log. For a sparse posterior the
bound on the likelihood of all samples (`learn.process.likelihood`) is maximised over the hyperparameters; inducing
inputs stay where they are, and the time to predict depends on their number alone.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.flight.flight import Array, Indices

Method = Literal["fasterpam", "pyclustering"]
Scale = Literal["standardised", "raw"]


def subsample(
    inputs: Array,
    count: int,
    *,
    method: Method = "fasterpam",
    seed: int = 0,
    pre_thin: int = 5000,
    scale: Scale = "standardised",
    pyclustering_max: int = 400,
) -> Indices:
    """Indices, increasing, of `count` representative rows of `inputs` (N, D); all rows where N <= count.

    `scale="standardised"` divides each column by its standard deviation first; `"raw"` is the paper's variant, in
    which a force of tens of newtons outweighs a torque of half a newton metre. `method="pyclustering"` is the paper's
    library; it sees at most `pyclustering_max` samples (or `count`, if larger), since its time grows with their cube:
    100 medoids of 250 samples take 1.5 s, of 400 4 s, and fifty times as long where its compiled library does not load.
    Its last swap makes its result a little worse instead of better, which is left as it is.
    """
    _check(inputs, count, method, scale)
    if len(inputs) <= count:
        return np.arange(len(inputs))
    limit = pre_thin if method == "fasterpam" else min(pre_thin, pyclustering_max)
    kept = thin(len(inputs), max(limit, count), seed)
    points = inputs[kept] if scale == "raw" else standardised(inputs[kept])
    distance = squared_distances(points)
    if method == "pyclustering":
        from pyclustering.cluster.kmedoids import kmedoids

        start = _spread_out(distance, count, seed).tolist()
        run = kmedoids(distance.astype(float), start, data_type="distance_matrix")
        medoids = np.asarray(run.process().get_medoids(), dtype=np.intp)
    elif count == 1:
        medoids = np.array([np.argmin(distance.sum(axis=1))])
    else:
        medoids = _spread_out(distance, count, seed)
        _swap(distance, medoids)
    return np.sort(kept[medoids])


def thin(length: int, count: int, seed: int) -> Indices:
    """At most `count` indices of 0 ... length-1: one drawn from each of `count` equal stretches.

    Drawn, not evenly spaced, so that a periodic trajectory cannot alias with the spacing.
    """
    if length <= count:
        return np.arange(length)
    edges = -(-np.arange(count + 1) * length // count)
    return np.random.default_rng(seed).integers(edges[:-1], edges[1:])


def standardised(points: Array) -> Array:
    """Columns centred and divided by their standard deviation; constant columns become zero."""
    spread = points.std(axis=0)
    return np.asarray((points - points.mean(axis=0)) / np.where(spread > 0, spread, 1.0))


def squared_distances(points: Array) -> NDArray[np.float32]:
    """Squared Euclidean distances (N, N) of the rows, in single precision (100 MB at N = 5,000)."""
    centred = (points - points.mean(axis=0)).astype(np.float32)
    squares = np.einsum("nd,nd->n", centred, centred)
    other = np.ascontiguousarray(centred.T)  # numpy makes one triangle of A A^T and mirrors it, which takes longer
    apart = (-2.0 * centred) @ other
    apart += squares
    apart += squares[:, None]
    np.maximum(apart, 0.0, out=apart)
    np.fill_diagonal(apart, 0.0)
    return np.asarray(apart)


def _check(inputs: Array, count: int, method: str, scale: str) -> None:
    if inputs.ndim != 2 or len(inputs) == 0:
        raise FitError(f"subsample: inputs have shape {inputs.shape}, expected (N, D) with N > 0")
    if not np.isfinite(inputs).all():
        raise FitError(f"subsample: {int((~np.isfinite(inputs)).any(axis=1).sum())} inputs are not finite; drop them")
    if count < 1:
        raise UsageError(f"subsample: got {count} points, expected at least 1")
    for name, value, known in (("method", method, get_args(Method)), ("scale", scale, get_args(Scale))):
        if value not in known:
            raise UsageError(f"subsample: unknown {name} {value!r}; available: {', '.join(known)}")


@njit(cache=True, nogil=True)
def _swap(distance: NDArray[np.float32], medoids: Indices) -> None:
    """Exchange medoids (K,), in place, until no exchange of one lowers the sum of distances to the nearest.

    FasterPAM (Schubert and Rousseeuw, Information Systems 101, 2021): every point in turn is tried in the place of all
    medoids at once, by what it gains where it is the nearest, and what the loss of each medoid costs; the best exchange
    is made at once where it gains. `distance` (N, N) is symmetric.
    """
    points, count = len(distance), len(medoids)
    first, second = np.full(points, -1), np.full(points, -1)
    loss, change = np.zeros(count), np.zeros(count)
    total = _nearest_two(distance, medoids, -1, first, second, loss)
    tried, c = 0, 0
    while tried < points:
        row, gain = distance[c], 0.0
        for m in range(count):
            change[m] = loss[m]
        for o in range(points):
            new = np.float64(row[o])
            near, after = np.float64(distance[medoids[first[o]], o]), np.float64(distance[medoids[second[o]], o])
            if new < near:
                gain += new - near
                change[first[o]] += near - after
            elif new < after:
                change[first[o]] += new - after
        best = int(np.argmin(change))
        tried += 1
        if c != medoids[first[c]] and change[best] + gain < 0.0:
            old, medoids[best] = medoids[best], c
            lower = _nearest_two(distance, medoids, best, first, second, loss)
            if lower < total:
                total, tried = lower, 0
            else:  # the gain was rounding: without this, exchanges can go round for ever
                medoids[best] = old
                _nearest_two(distance, medoids, -1, first, second, loss)
        c = (c + 1) % points


@njit(cache=True, nogil=True)
def _nearest_two(
    distance: NDArray[np.float32],
    medoids: Indices,
    changed: int,
    first: NDArray[np.int64],
    second: NDArray[np.int64],
    loss: Array,
) -> float:
    """Places of the nearest and the next medoid of every point (N,), and what the loss of each medoid (K,) costs;
    returns the sum of distances to the nearest.

    `changed` is the place of the one medoid that is another since the last time; -1 for all of them.
    """  # noqa: D205
    loss[:] = 0.0
    total = 0.0
    for o in range(len(first)):
        a, b = first[o], second[o]
        if changed < 0 or changed in (a, b):
            a, b = -1, -1
            for m in range(len(medoids)):
                d = distance[medoids[m], o]
                if a < 0 or d < distance[medoids[a], o]:
                    a, b = m, a
                elif b < 0 or d < distance[medoids[b], o]:
                    b = m
        elif distance[medoids[changed], o] < distance[medoids[a], o]:
            a, b = changed, a
        elif distance[medoids[changed], o] < distance[medoids[b], o]:
            b = changed
        first[o], second[o] = a, b
        nearest = np.float64(distance[medoids[a], o])
        loss[a] += np.float64(distance[medoids[b], o]) - nearest
        total += nearest
    return total


def _spread_out(distance: NDArray[np.float32], count: int, seed: int) -> Indices:
    """Initial medoids by D^2 sampling (Arthur and Vassilvitskii 2007): far from each other, distinct."""
    rng = np.random.default_rng(seed)
    chosen = [int(rng.integers(len(distance)))]
    nearest = distance[chosen[0]].astype(float)
    free = np.ones(len(distance), dtype=bool)
    free[chosen[0]] = False
    while len(chosen) < count:
        weight = np.where(free, nearest, 0.0)
        weight = weight if weight.sum() > 0 else free.astype(float)
        chosen.append(int(rng.choice(len(distance), p=weight / weight.sum())))
        free[chosen[-1]] = False
        np.minimum(nearest, distance[chosen[-1]], out=nearest)
    return np.array(chosen, dtype=np.intp)


@dataclass(frozen=True)
class Jitter:
    """What is added to a diagonal, so that rounding does not make a covariance indefinite."""

    noise: float = 1e-8
    """To the noise variance of a standardised output wherever K is factored, as GPy does."""
    inducing: float = 1e-6
    """To K_zz, relative to the signal's variance."""
    attempts: int = 6
    """Factors that are tried, each with a diagonal that is ten times larger."""


JITTER = Jitter()


@dataclass(frozen=True)
class Kernel:
    """Squared exponential with one lengthscale per input (D,), and the variances of signal and noise."""

    lengthscales: Array
    signal_variance: float
    noise_variance: float

    def __call__(self, a: Array, b: Array, out: Array | None = None) -> Array:
        """k(a, b) (N, M), into `out` where it is given: -1/2 |p - q|^2 as one product, of p and q with their own
        squares beside them.
        """  # noqa: D205
        p, q = a / self.lengthscales, b / self.lengthscales
        left = np.column_stack((p, -0.5 * np.sum(p * p, axis=1), np.ones(len(p))))
        right = np.column_stack((q, np.ones(len(q)), -0.5 * np.sum(q * q, axis=1)))
        out = np.matmul(left, right.T, out=out)
        np.minimum(out, 0.0, out=out)
        np.exp(out, out=out)
        out *= self.signal_variance
        return np.asarray(out)


def posterior(kernel: Kernel, x: Array, z: Array, inducing: Array) -> tuple[Array, Array]:
    """`weights` (M,) and `whitener` (M, M): mean = k w, var = k(x, x) - |V k|^2, for k = k(Z, x)."""
    size = len(inducing)
    Kzz = kernel(inducing, inducing) + JITTER.inducing * kernel.signal_variance * np.eye(size)
    Kzx = kernel(inducing, x)
    A = Kzz + Kzx @ Kzx.T / kernel.noise_variance
    factor = cho_factor(A, lower=True)
    weights = cho_solve(factor, Kzx @ z) / kernel.noise_variance
    inverse = np.linalg.inv(Kzz) - cho_solve(factor, np.eye(size))
    values, vectors = np.linalg.eigh(0.5 * (inverse + inverse.T))
    return weights, np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
