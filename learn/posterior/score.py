"""The probability of a set of effects, up to a constant, at noise whose spectrum is unknown.

For a set S with parameters theta, the coefficients of axis l in band k leave the mean square s_kl(theta). Their
variance is unknown, with an inverse-gamma prior about that of the sensors; integrated out it leaves

    log p = -1/2 sum_kl (N_kl + NU) log((N_kl s_kl + NU s0_kl) / (N_kl + NU)) - 1/2 sum_p (theta_p / s_p)^2
            - 1/2 log det(A S S + I) - PRICE complexity(S)

a Student likelihood (Gelman et al., "Bayesian Data Analysis", 3rd ed., 3.2), the prior, and Laplace's approximation of
the integral over theta, A the curvature (MacKay, "Information Theory, Inference, and Learning Algorithms", 27). An axis
on which a law is nearly right, and no more, has the larger variance that it shows, and counts for less.

N_kl are coefficients that count. What a spectrum shows above the sensors' own is no independent noise in every
coefficient: a form that is nearly right errs the same way everywhere. Of that share, `SHOWN` values count for each
block, band and axis (`Scorer`).

What is wrong about one axis shows a little on others: vehicles are never quite symmetric. To every mean square is
added that of `learn.posterior.spectrum.LEAK` of what the model leaves in all of the force, or torque, in that band;
without it a law that takes 96 % off one axis lost for a trace that it added to another, counted by its logarithm.

No law is exactly right: what an effect adds is known to a share (`plant.effects.Effect.accuracy`). The mean square of a
cell therefore has added to it the square of the sum of those shares of what its effects add there, whatever their
signs: what effects that cancel each other leave is known no better than each of them. That is an upper limit: of
`DOUBTS`, the share of it that makes the set likelier counts. Source: model discrepancy, Kennedy and O'Hagan, J. R.
Stat. Soc. B 63, 2001.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.learn.parallel import by_threads
from wrenchgap.learn.posterior import compiled
from wrenchgap.learn.posterior.columns import complexity
from wrenchgap.learn.posterior.spectrum import Spectrum

Keys = tuple[str, ...]

ROUNDS = 8
"""Of weights by band and parameters in turn, at most."""
NU = 2.0
"""Values that the prior of a variance is worth."""
PRICE = 3.0
"""Log odds against every further effect of a set."""
DOUBTS = (1.0, 0.3)
"""Shares of what laws may be off by, of which the likelier holds: what fits to the noise has shown that it is exact."""
SHOWN = 2.0
"""Values that count for each block, band and axis of what exceeds the sensors' noise."""


@dataclass(frozen=True)
class Scored:
    """A set at its best parameters.

    `theta` by column; `left` (bands, axes) are mean squares, `inexact` those that laws may be off by at most, `doubt`
    the share of that (of its root; of `DOUBTS`) which counts, `variance` that which is modelled of both.
    `log_probability` in all; `prior` that part of it which does not come from the flights. `weights` (Q,) multiply the
    stacked quantities of the spectrum to give what the set leaves.
    """

    keys: Keys
    theta: dict[str, Array]
    left: Array
    inexact: Array
    doubt: float
    variance: Array
    log_probability: float
    prior: float
    weights: Array


class Scorer:
    """Scores sets on one spectrum, with the counts that a reference spectrum gives."""

    def __init__(self, spectrum: Spectrum, reference: Array) -> None:
        self.spectrum = spectrum
        self.reference = reference
        above = 1.0 - spectrum.sensor / np.maximum(reference, spectrum.sensor)
        shown = np.minimum(1.0, SHOWN * spectrum.blocks / np.maximum(spectrum.count, 1.0))
        self.count = spectrum.count * (1.0 - above + above * shown)
        self.variance = self.pooled(reference)
        self.known: dict[Keys, Scored] = {}
        self._kinds: dict[str, int] = {}

    def pooled(self, left: Array) -> Array:
        """The variance that mean squares (bands, axes), what leaks from other axes, and its prior make likely."""
        space = self.spectrum
        return np.asarray((self.count * (left + space.leak) + NU * space.sensor) / (self.count + NU))

    def weighed(self, variance: Array) -> Array:
        """Products (Q, Q) of all quantities over the variance (bands, axes) of the noise."""
        return np.asarray(np.tensordot(self.count / variance, self.spectrum.products, axes=([0, 1], [0, 1])))

    def prior_of(self, keys: Keys) -> float:
        """Log probability of the set before any flight."""
        for k in keys:
            if k not in self._kinds:
                self._kinds[k] = complexity(self.spectrum.columns[k].names)
        return -PRICE * sum(self._kinds[k] for k in keys)

    def __call__(self, keys: Sequence[str], rounds: int = ROUNDS) -> Scored:
        """The set's score: weights by axis and band, and parameters, in turn until nothing changes."""
        keys = tuple(sorted(keys))
        if keys not in self.known:
            self.known[keys] = self._scored(keys, rounds)
        return self.known[keys]

    def many(self, sets: Iterable[Keys], jobs: int = 1) -> None:
        """Score all of these sets, by `jobs` threads."""
        new = [k for k in dict.fromkeys(tuple(sorted(k)) for k in sets) if k not in self.known]
        self.known.update(zip(new, by_threads(lambda k: self._scored(k, ROUNDS), new, jobs), strict=True))

    def _scored(self, keys: Keys, rounds: int) -> Scored:
        space = self.spectrum
        unknown = np.concatenate([*(space.parameters[k] for k in keys), space.always])
        fixed = np.array([0, *(space.offset[k] for k in keys)])
        every = np.concatenate((unknown, fixed))
        size = len(unknown)
        weights = np.concatenate((np.zeros(size), [1.0], -np.ones(len(keys))))
        start = [space.columns[k].theta for k in keys]
        theta = np.concatenate([*start, np.zeros(len(space.always))])
        low, high, sparse = space.low[unknown], space.high[unknown], space.sparse[unknown]
        scale = space.scale[unknown]
        owner = np.concatenate([np.full(len(space.parameters[k]), i) for i, k in enumerate(keys)] or [np.zeros(0)])
        members = [np.append(np.flatnonzero(owner == i), size + 1 + i) for i in range(len(keys))]
        products = Products(space.products, every, members, [space.columns[k].accuracy for k in keys])
        best: tuple[float, float, Array, Array, Array, Array, float] | None = None
        for doubt in DOUBTS:
            last = -np.inf
            for _ in range(rounds):
                weights[:size] = -theta
                left, inexact = products.mean_squares(weights)
                variance = self.pooled(left + doubt**2 * inexact)
                value = -0.5 * np.sum((self.count + NU) * np.log(variance)) - 0.5 * np.sum((theta / scale) ** 2)
                if abs(value - last) < 0.05:
                    break
                last = value
                whole = products.weighed(self.count / variance)
                A, b = np.ascontiguousarray(whole[:size, :size]), whole[:size, size:] @ weights[size:]
                scale = compiled.relevant(A, b, low, high, scale, sparse, space.scale[unknown])
                theta = compiled.bounded(A, b, low, high, scale)
            weights[:size] = -theta
            left, inexact = products.mean_squares(weights)
            variance = self.pooled(left + doubt**2 * inexact)
            likelihood = -0.5 * float(np.sum((self.count + NU) * np.log(variance)))
            prior = compiled.occam(A, theta, scale) + self.prior_of(keys)
            if best is None or likelihood + prior > best[0]:
                best = likelihood + prior, prior, theta.copy(), left, inexact, variance, doubt
            if not np.any(inexact):
                break
        assert best is not None
        total, prior, theta, left, inexact, variance, doubt = best
        weights[:size] = -theta
        spread = np.zeros(space.low.size)
        spread[every] = weights
        values = {k: theta[m[:-1]] for k, m in zip(keys, members, strict=True)}
        return Scored(keys, values, left, inexact, doubt, variance, total, prior, spread)

    def by_block(self, scored: Scored) -> Array:
        """What each block of time (blocks,) contributes to the log likelihood."""
        space = self.spectrum
        off = scored.doubt**2 * scored.inexact + space.leak
        left = space.combined(scored.weights) ** 2 + off[space.band]
        share = (self.count / np.maximum(space.count, 1.0))[space.band]
        variance = scored.variance[space.band]
        return -0.5 * np.add.reduceat((share * (left / variance + np.log(variance))).sum(axis=1), space.starts)


class Products:
    """Products of some of the stacked quantities, those of every pair once: by band and axis they are symmetric.

    `rows` (R,) are which of all (bands, axes, Q, Q). `members` are the quantities of each candidate among them, whose
    laws are known to `accuracy`.
    """

    def __init__(
        self,
        products: Array,
        rows: NDArray[np.intp],
        members: Sequence[NDArray[np.intp]],
        accuracy: Sequence[float],
    ) -> None:
        self.shape, every = products.shape[:2], products.shape[2]
        self.pairs = _pairs(len(rows))
        places = rows[self.pairs.one] * every + rows[self.pairs.other]
        self.values = products.reshape(-1, every * every).take(places, axis=1)
        self.members, self.accuracy = members, accuracy
        self.own = [products[:, :, rows[m][:, None], rows[m]] for m in members]

    def mean_squares(self, weights: Array) -> tuple[Array, Array]:
        """By band and axis: what these weights leave, and what the laws of the members may be off by at most."""
        both = weights[self.pairs.one] * weights[self.pairs.other] * self.pairs.times
        sizes = np.zeros(self.shape)
        for m, own, share in zip(self.members, self.own, self.accuracy, strict=True):
            sizes += share * np.sqrt(np.maximum(quadratic(own, weights[m]), 0.0))
        return np.maximum((self.values @ both).reshape(self.shape), 0.0), sizes**2

    def weighed(self, over: Array) -> Array:
        """The sum (R, R) of the products times these factors (bands, axes)."""
        return np.asarray((over.ravel() @ self.values)[self.pairs.place])


class _Pairs(NamedTuple):
    """`one` and `other` of each pair (P,), how many times it counts, and where it stands (R, R)."""

    one: NDArray[np.intp]
    other: NDArray[np.intp]
    times: Array
    place: NDArray[np.intp]


@lru_cache(maxsize=16)
def _pairs(size: int) -> _Pairs:
    one, other = np.tril_indices(size)
    place = np.empty((size, size), dtype=np.intp)
    place[one, other] = place[other, one] = np.arange(len(one))
    return _Pairs(one, other, np.where(one == other, 1.0, 2.0), place)


def quadratic(products: Array, weights: Array) -> Array:
    """The form w' P w (bands, axes) of products P (bands, axes, Q, Q) and weights (Q,). What numpy's indexing
    of the last two axes returns lies in memory with them in front; so it is read in that order.
    """  # noqa: D205
    inner = np.ascontiguousarray(products.transpose(2, 3, 0, 1))
    once = weights @ inner.reshape(len(weights), -1)
    return np.asarray(weights @ once.reshape(len(weights), -1)).reshape(products.shape[:2])


def relevant(
    A: Array, b: Array, low: Array, high: Array, scale: Array, sparse: Array, typical: Array, rounds: int = 8
) -> Array:
    """The prior's sizes; of sparse parameters those that the evidence makes likely (`learn.identify.fit`)."""
    if not sparse.any():
        return scale
    for _ in range(rounds):
        posterior = np.linalg.inv(A + np.diag(scale**-2.0))
        theta = np.clip(posterior @ b, low, high)
        size = np.maximum(np.sqrt(theta**2 + np.diag(posterior)), 1e-2 * typical)
        changed = np.where(sparse, size, scale)
        done = np.max(np.abs(np.log(changed / scale))) < 0.1
        scale = changed
        if done:
            break
    return scale


def bounded(A: Array, b: Array, low: Array, high: Array, scale: Array, rounds: int = 40) -> Array:
    """Where 1/2 theta A theta - b theta + 1/2 |theta / scale|^2 is least within the bounds: an active-set method.

    Source: Nocedal and Wright, "Numerical Optimization", 2nd ed., 16.5.
    """
    size = len(scale)
    H, g, lower, upper = A * np.outer(scale, scale) + np.eye(size), b * scale, low / scale, high / scale
    x, free = np.zeros(size), np.ones(size, dtype=bool)
    for _ in range(rounds):
        inner, outer = np.flatnonzero(free), np.flatnonzero(~free)
        new = x.copy()
        new[inner] = np.linalg.solve(H[np.ix_(inner, inner)], g[inner] - H[np.ix_(inner, outer)] @ x[outer])
        crossed = free & ((new < lower - 1e-12) | (new > upper + 1e-12))
        if crossed.any():
            x, free = np.clip(new, lower, upper), free & ~crossed
            continue
        x = new
        push = g - H @ x
        back = ~free & (((x <= lower) & (push > 1e-9)) | ((x >= upper) & (push < -1e-9)))
        if not back.any():
            break
        free[np.argmax(np.where(back, np.abs(push), 0.0))] = True
    return np.asarray(np.clip(x, lower, upper) * scale)


def saturated(spectrum: Spectrum, rounds: int = 3) -> tuple[Array, Array]:
    """What everything at once leaves, where the noise's spectrum starts: mean squares (bands, axes), and the weights
    (Q,) of the stacked quantities that leave it.
    """  # noqa: D205
    unknown = np.concatenate([*spectrum.parameters.values(), spectrum.always])
    left = spectrum.products[:, :, 0, 0]
    weights = np.zeros(spectrum.low.size)
    weights[0] = 1.0
    for _ in range(rounds):
        variance = np.maximum(left, spectrum.sensor)
        whole = np.tensordot(spectrum.count / variance, spectrum.products, axes=([0, 1], [0, 1]))
        narrow = np.diag((0.5 * spectrum.scale[unknown]) ** -2.0)
        weights[unknown] = -np.linalg.solve(whole[np.ix_(unknown, unknown)] + narrow, whole[unknown, 0])
        left = np.maximum(np.einsum("klij,i,j->kl", spectrum.products, weights, weights, optimize=True), 0.0)
    return left, weights
