"""The probability of a set of effects, up to a constant, at noise whose spectrum is unknown.

Derivation and sources: docs/theory/likelihood.md and docs/theory/posterior.md. For a set S with parameters theta, the
coefficients of axis l in band k leave the mean square s_kl(theta), and N_kl of them count:

    log p = -1/2 sum_kl (N_kl + nu) log((N_kl s_kl + nu s0_kl) / (N_kl + nu)) - 1/2 sum_p (theta_p / s_p)^2
            - 1/2 log det(A S S + I) - price complexity(S)

a Student likelihood, the prior, and Laplace's approximation of the integral over theta, A the curvature. To every mean
square is added what leaks from other axes, and what the laws of the set may be off by
(`plant.effects.Effect.accuracy`), all of it or the share `doubt`, whichever makes the set likelier: that is an upper
limit, and a set that fits to the noise has shown that its laws are nearer. What is left counts as at least the sensors'
noise, s0_kl. All numbers: `learn.posterior.settings`.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import Array, Indices
from wrenchgap.learn.parallel import by_threads
from wrenchgap.learn.posterior import kernels
from wrenchgap.learn.posterior.columns import complexity
from wrenchgap.learn.posterior.linear_problem import LinearProblem, quadratic

Keys = tuple[str, ...]

ROUNDS = 8
"""Of weights by band and parameters in turn, at most."""


@dataclass(frozen=True)
class Scored:
    """A set at its best parameters.

    `theta` by column; `left` (bands, axes) are mean squares, `inexact` those that laws may be off by at most, `doubt`
    the share of that (of its root) which counts, `variance` that which is modelled of both. `log_probability` in all;
    `prior` that part of it which does not come from the flights. `weights` (Q,) multiply the stacked quantities of the
    problem to give what the set leaves; `sizes` (P,) are those of the priors of its unknowns, parameters first.
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
    sizes: Array


class Scorer:
    """Scores sets on one spectrum, with the counts that a reference spectrum gives."""

    def __init__(self, spectrum: LinearProblem, reference: Array) -> None:
        self.spectrum = spectrum
        self.reference = reference
        above = 1.0 - spectrum.sensor / np.maximum(reference, spectrum.sensor)
        shown = np.minimum(1.0, spectrum.settings.shown * spectrum.blocks / np.maximum(spectrum.count, 1.0))
        self.count = spectrum.count * (1.0 - above + above * shown)
        self.share = self.count / np.maximum(spectrum.count, 1.0)
        self.variance = self.pooled(reference)
        self.known: dict[Keys, Scored] = {}
        self.kinds = {key: complexity(c.names) for key, c in spectrum.columns.items()}

    def on(self, spectrum: LinearProblem) -> Scorer:
        """The same scorer on another spectrum of the same columns."""
        other = copy.copy(self)
        other.spectrum, other.known = spectrum, {}
        return other

    def pooled(self, left: Array) -> Array:
        """The variance that mean squares (bands, axes), what leaks from other axes, and its prior make likely.

        Less than the sensors' noise counts as that noise: no law takes it off, but commands that answer it do.
        """
        space, worth = self.spectrum, self.spectrum.settings.sensors_worth
        left = np.maximum(left, space.sensor)
        return np.asarray((self.count * (left + space.leak) + worth * space.sensor) / (self.count + worth))

    def weighed(self, variance: Array) -> Array:
        """Products (Q, Q) of all quantities over the variance (bands, axes) of the noise, trims eliminated."""
        trims = self.spectrum.trims
        whole = np.tensordot(self.count / variance, self.spectrum.products, axes=([0, 1], [0, 1]))
        return trims.eliminated_from(whole, (self.share / variance)[0, trims.axes])

    def eliminated(self, variance: Array) -> Array:
        """`weighed`, what is always there eliminated as well."""
        whole, always, scale = self.weighed(variance), self.spectrum.always, self.spectrum.scale
        inner = whole[np.ix_(always, always)] + np.diag(scale[always] ** -2.0)
        across = whole[always]
        return np.asarray(whole - across.T @ np.linalg.solve(inner, across))

    def prior_of(self, keys: Keys, further: float) -> float:
        """Log probability of the set before any flight, with sparse effects at so many `further` places: that one rotor
        is weak is no reason for another to be.
        """  # noqa: D205
        space = self.spectrum
        count = sum(self.kinds[k] for k in keys) + further
        return -space.settings.price * count - sum(space.columns[k].price for k in keys)

    def __call__(self, keys: Sequence[str]) -> Scored:
        """The set's score: weights by axis and band, and parameters, in turn until nothing changes."""
        keys = tuple(sorted(keys))
        if keys not in self.known:
            self.known[keys] = self._scored(keys)
        return self.known[keys]

    def many(self, sets: Iterable[Keys], jobs: int = 1) -> None:
        """Score all of these sets, by `jobs` threads."""
        new = [k for k in dict.fromkeys(tuple(sorted(k)) for k in sets) if k not in self.known]
        self.known.update(zip(new, by_threads(self._scored, new, jobs), strict=True))

    def held(self, keys: Sequence[str], theta: Mapping[str, Array]) -> Scored:
        """The set with its parameters at these values, and everything else as likely as can be."""
        keys = tuple(sorted(keys))
        return self._scored(keys, np.concatenate([theta[k] for k in keys]))

    def _scored(self, keys: Keys, held: Array | None = None) -> Scored:
        own = SetRows(self.spectrum, keys)
        if held is not None:
            own.low[: len(held)] = own.high[: len(held)] = held
        theta, sizes, trims = own.start, own.typical, np.zeros(own.trims.squares.shape)
        best: Scored | None = None
        for doubt in (1.0, self.spectrum.settings.doubt):
            found, theta, trims = self._at(own, doubt, theta, sizes, trims)
            sizes = found.sizes
            if best is None or found.log_probability > best.log_probability:
                best = found
            if not np.any(found.inexact):
                break
        assert best is not None
        return best

    def _at(self, own: SetRows, doubt: float, theta: Array, sizes: Array, trim: Array) -> tuple[Scored, Array, Array]:
        """The set where a share `doubt` of what its laws may be off by counts, with its unknowns and trims: noise and
        parameters in turn, from these values.
        """  # noqa: D205
        trims, size, last = own.trims, len(theta), -np.inf
        counts = self.count + self.spectrum.settings.sensors_worth
        for _ in range(ROUNDS):
            left, inexact = own.mean_squares(theta, trim)
            variance = self.pooled(left + doubt**2 * inexact)
            fitted = -0.5 * float(np.sum(counts * np.log(variance)))
            value = fitted - 0.5 * float(np.sum((theta / sizes) ** 2) + np.sum((trim / trims.scale) ** 2))
            if abs(value - last) < 0.05:
                break
            last = value
            g = (self.share / variance)[0, trims.axes]
            whole = own.weighed(self.count / variance, g)
            A, b = np.ascontiguousarray(whole[:size, :size]), whole[:size, size:] @ own.fixed
            sizes = kernels.relevant(A, b, own.low, own.high, sizes, own.sparse, own.typical)
            theta = kernels.bounded(A, b, own.low, own.high, sizes)
            trim = trims.likeliest(g, own.weights(theta))
        left, inexact = own.mean_squares(theta, trim)
        variance = self.pooled(left + doubt**2 * inexact)
        likelihood = -0.5 * float(np.sum(counts * np.log(variance)))
        width = kernels.occam(A, theta, sizes) + trims.occam(g)
        further = kernels.further_places(theta, sizes, own.place, own.sizes)
        prior = width - 0.5 * float(np.sum((trim / trims.scale) ** 2)) + self.prior_of(own.keys, further)
        weights = np.zeros(self.spectrum.scale.size)
        weights[own.every] = own.weights(theta)
        total, by_column = likelihood + prior, own.by_column(theta)
        found = Scored(own.keys, by_column, left, inexact, doubt, variance, total, prior, weights, sizes)
        return found, theta, trim

    def by_block(self, scored: Scored) -> Array:
        """What each block of time (blocks,) contributes to the log likelihood."""
        space = self.spectrum
        off = scored.doubt**2 * scored.inexact + space.leak
        left = self.as_noise(scored)[space.band] * space.combined(scored.weights) ** 2 + off[space.band]
        share, variance = self.share[space.band], scored.variance[space.band]
        return -0.5 * np.add.reduceat((share * (left / variance + np.log(variance))).sum(axis=1), space.starts)

    def as_noise(self, scored: Scored) -> Array:
        """Factors (bands, axes) of what the set leaves, with which none of it is less than the sensors' noise."""
        return np.maximum(self.spectrum.sensor / np.maximum(scored.left, 1e-300), 1.0)

    def deviations(self, scored: Scored) -> dict[str, Array]:
        """Standard deviations by column: the width of the posterior at the noise that the set leaves."""
        own, size = SetRows(self.spectrum, scored.keys), len(scored.sizes)
        g = self.share / scored.variance
        whole = own.weighed(self.count / scored.variance, g[0, own.trims.axes])
        curvature = whole[:size, :size] + np.diag(scored.sizes**-2.0)
        return own.by_column(np.sqrt(np.diag(np.linalg.inv(curvature))))


class SetRows:
    """What a score needs of one set: its quantities out of those of the problem, unknowns before what is fixed.

    `every` (R,) are rows of the problem's quantities; of the unknowns `start` (P,) is where the set was linearised,
    `typical`, `low`, `high`, `sparse` and `place` (P,) are theirs.
    """

    def __init__(self, space: LinearProblem, keys: Keys) -> None:
        self.keys = keys
        unknown = np.concatenate([*(space.parameters[k] for k in keys), space.always]).astype(np.intp)
        self.every = np.concatenate((unknown, [0], [space.offset[k] for k in keys])).astype(np.intp)
        size = len(unknown)
        owner = np.concatenate([np.full(len(space.parameters[k]), i) for i, k in enumerate(keys)] or [np.zeros(0)])
        self.sizes = np.array([len(space.parameters[k]) for k in keys], dtype=np.intp)
        self.members = [np.append(np.flatnonzero(owner == i), size + 1 + i) for i in range(len(keys))]
        laws = [
            (m, space.inexact(self.every[m]), space.columns[k].accuracy)
            for k, m in zip(keys, self.members, strict=True)
        ]
        self.products = Products(space.products, self.every, laws)
        self.trims, self.count = space.trims.of(self.every), space.count
        self.fixed = np.concatenate(([1.0], -np.ones(len(keys))))
        self.start = np.concatenate([*(space.columns[k].theta for k in keys), np.zeros(len(space.always))])
        self.typical, self.sparse, self.place = space.scale[unknown], space.sparse[unknown], space.place[unknown]
        self.low, self.high = space.low[unknown], space.high[unknown]

    def weights(self, theta: Array) -> Array:
        """Of the quantities (R,)."""
        return np.concatenate((-theta, self.fixed))

    def mean_squares(self, theta: Array, trim: Array) -> tuple[Array, Array]:
        """`Products.mean_squares`, with trims (F, A) of the flights."""
        weights = self.weights(theta)
        left, inexact = self.products.mean_squares(weights)
        return np.maximum(self.trims.added_to(left, trim, weights, self.count), 0.0), inexact

    def weighed(self, count: Array, g: Array) -> Array:
        """Products (R, R), mean ones weighed by `count` (bands, L), trims at precisions `g` (A,) eliminated."""
        return self.trims.eliminated_from(self.products.weighed(count), g)

    def by_column(self, theta: Array) -> dict[str, Array]:
        """Parameters by key."""
        return {k: theta[m[:-1]] for k, m in zip(self.keys, self.members, strict=True)}


class Products:
    """Products of some of the stacked quantities, by band and axis.

    `rows` (R,) are which of all (bands, axes, Q, Q). `laws` are, of each candidate, which rows are its own, their
    products as far as an error of its law is none of a trim (`LinearProblem.inexact`), and to what share it is known.
    """

    def __init__(
        self,
        products: Array,
        rows: Indices,
        laws: Sequence[tuple[Indices, Array, float]],
    ) -> None:
        self.shape, every = products.shape[:2], products.shape[2]
        places = rows[:, None] * every + rows
        self.values = products.reshape(-1, every * every).take(places.ravel(), axis=1)
        self.laws = laws

    def mean_squares(self, weights: Array) -> tuple[Array, Array]:
        """By band and axis: what these weights leave, and what the laws of the members may be off by at most."""
        left, sizes = self.values @ np.outer(weights, weights).ravel(), np.zeros(self.shape)
        for m, own, share in self.laws:
            sizes += share * np.sqrt(np.maximum(quadratic(own, weights[m]), 0.0))
        return np.maximum(left.reshape(self.shape), 0.0), sizes**2

    def weighed(self, over: Array) -> Array:
        """The sum (R, R) of the products times these factors (bands, axes)."""
        whole = over.ravel() @ self.values
        return np.asarray(whole.reshape(2 * (math.isqrt(whole.size),)))
