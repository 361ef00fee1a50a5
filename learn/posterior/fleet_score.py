"""The score of a set of effects on merged evidence: as `learn.posterior.score`, the flights' trims eliminated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.learn.posterior import compiled
from wrenchgap.learn.posterior.merging import FleetSpectrum
from wrenchgap.learn.posterior.score import DOUBTS, NU, Keys, Products, Scored, Scorer, quadratic

SATURATED = 3
"""Rounds of `saturated`."""


@dataclass(frozen=True)
class SetProblem:
    """The least squares of one set at its noise: `rows` (R,) of the spectrum's quantities, parameters first, what is
    fixed after them; `weights` (R,) of the rows; `whole` (R, R) their products, weighed by `g` (bands, L), trims
    eliminated; limits and sizes of the parameters; `off` and `log` (bands, L) what laws may be off by and log variance.
    """  # noqa: D205

    rows: NDArray[np.intp]
    weights: Array
    whole: Array
    low: Array
    high: Array
    scale: Array
    g: Array
    off: Array
    log: Array


class FleetScorer(Scorer):
    """Scores sets on merged evidence, with the counts that a reference spectrum gives."""

    spectrum: FleetSpectrum  # type: ignore[assignment]

    def __init__(self, space: FleetSpectrum, reference: Array) -> None:
        super().__init__(space, reference)  # type: ignore[arg-type]
        self.share = self.count / space.count
        self._states: dict[Keys, _State] = {}

    def weighed(self, variance: Array) -> Array:
        """Products (Q, Q) of all quantities over the noise, trims eliminated."""
        trims = self.spectrum.trims
        whole = super().weighed(variance)
        g = (self.share / variance)[0, trims.axes]
        return np.asarray(whole - trims.eliminated(g, trims.scale))

    def _scored(self, keys: Keys, rounds: int) -> Scored:
        own = _Set(self.spectrum, keys)
        state = _State(own.start, own.typical, np.zeros(own.trims.squares.shape))
        best: tuple[Scored, _State] | None = None
        for doubt in DOUBTS:
            found, state = self._at(own, doubt, state, rounds)
            if best is None or found.log_probability > best[0].log_probability:
                best = found, state
            if not np.any(found.inexact):
                break
        assert best is not None
        self._states[keys] = best[1]
        return best[0]

    def _at(self, own: _Set, doubt: float, state: _State, rounds: int) -> tuple[Scored, _State]:
        """The set where a share `doubt` of what its laws may be off by counts; noise and parameters in turn."""
        trims, size, last = own.trims, len(own.start), -np.inf
        theta, scale, trim = state.theta, state.scale, state.trim
        for _ in range(rounds):
            left, inexact = own.left(theta, trim)
            variance = self.pooled(left + doubt**2 * inexact)
            fitted = -0.5 * float(np.sum((self.count + NU) * np.log(variance)))
            sizes = np.sum((theta / scale) ** 2) + np.sum((trim / trims.scale) ** 2)
            value = fitted - 0.5 * float(sizes)
            if abs(value - last) < 0.05:
                break
            last = value
            g = self.share / variance
            whole = own.weighed(self.count / variance, g)
            A, b = np.ascontiguousarray(whole[:size, :size]), whole[:size, size:] @ own.fixed
            scale = compiled.relevant(A, b, own.low, own.high, scale, own.sparse, own.typical)
            theta = compiled.bounded(A, b, own.low, own.high, scale)
            trim = trims.likeliest(g[0, trims.axes], own.weights(theta), trims.scale)
        left, inexact = own.left(theta, trim)
        variance = self.pooled(left + doubt**2 * inexact)
        likelihood = -0.5 * float(np.sum((self.count + NU) * np.log(variance)))
        width = compiled.occam(A, theta, scale) + trims.occam(g[0, trims.axes], trims.scale)
        prior = width - 0.5 * float(np.sum((trim / trims.scale) ** 2)) + self.prior_of(own.keys)
        values = own.by_column(theta)
        total = likelihood + prior
        spread = own.spread(theta)
        found = Scored(own.keys, values, left, inexact, doubt, variance, total, prior, spread)
        return found, _State(theta, scale, trim)

    def problem(self, scored: Scored) -> SetProblem:
        """The least squares of a set that was scored, at the noise that it leaves."""
        own, state = _Set(self.spectrum, scored.keys), self._states[scored.keys]
        g = self.share / scored.variance
        off = scored.doubt**2 * scored.inexact + self.spectrum.leak
        whole = own.weighed(self.count / scored.variance, g)
        weights, limits = own.weights(state.theta), (own.low, own.high, state.scale)
        return SetProblem(own.every, weights, whole, *limits, g, off, np.log(scored.variance))

    def weighed_of(self, products: Array, flight: int, problem: SetProblem) -> Array:
        """What one flight adds to `SetProblem.whole`: of its sums of products (bands, L, R, R)."""
        trims = self.spectrum.trims.of(problem.rows, flight)
        whole = np.tensordot(problem.g, products, axes=([0, 1], [0, 1]))
        return np.asarray(whole - trims.eliminated(problem.g[0, trims.axes], trims.scale))

    def left_of(self, products: Array, flight: int, problem: SetProblem, weights: Array) -> Array:
        """Sums of squares (bands, L) that weights (R,) leave of one flight, its own trim taken out."""
        trims = self.spectrum.trims.of(problem.rows, flight)
        left = quadratic(products, weights)
        t = trims.likeliest(problem.g[0, trims.axes], weights, trims.scale)
        left[0, trims.axes] += trims.squares_left(t, weights)[0]
        return np.maximum(left, 0.0)


@dataclass(frozen=True)
class _State:
    """Parameters (P,), the sizes of their priors (P,), and trims (F, A)."""

    theta: Array
    scale: Array
    trim: Array


class _Set:
    """What a score needs of one set: its quantities out of those of the spectrum, parameters before what is fixed."""

    def __init__(self, space: FleetSpectrum, keys: Keys) -> None:
        self.keys, self.space = keys, space
        unknown = np.concatenate([*(space.parameters[k] for k in keys), space.always]).astype(np.intp)
        self.every = np.concatenate((unknown, [0], [space.offset[k] for k in keys])).astype(np.intp)
        size = len(unknown)
        owner = np.concatenate([np.full(len(space.parameters[k]), i) for i, k in enumerate(keys)] or [np.zeros(0)])
        self.members = [np.append(np.flatnonzero(owner == i), size + 1 + i) for i in range(len(keys))]
        self.products = Products(space.products, self.every, self.members, [space.columns[k].accuracy for k in keys])
        self.trims = space.trims.of(self.every)
        self.fixed = np.concatenate(([1.0], -np.ones(len(keys))))
        self.start = np.concatenate([*(space.columns[k].theta for k in keys), np.zeros(len(space.always))])
        self.typical = space.scale[unknown]
        self.low, self.high, self.sparse = space.low[unknown], space.high[unknown], space.sparse[unknown]

    def weights(self, theta: Array) -> Array:
        """Of the quantities (R,)."""
        return np.concatenate((-theta, self.fixed))

    def left(self, theta: Array, trim: Array) -> tuple[Array, Array]:
        """As `learn.posterior.score.Products.mean_squares`, with trims (F, A) of the flights."""
        weights = self.weights(theta)
        left, inexact = self.products.mean_squares(weights)
        gone = self.trims.squares_left(trim, weights).sum(axis=0)
        left[0, self.trims.axes] += gone / self.space.count[0, self.trims.axes]
        return np.maximum(left, 0.0), inexact

    def weighed(self, count: Array, g: Array) -> Array:
        """Products (R, R), mean ones weighed by `count` (bands, L), trims at precisions `g` (bands, L) eliminated."""
        whole = self.products.weighed(count)
        return np.asarray(whole - self.trims.eliminated(g[0, self.trims.axes], self.trims.scale))

    def by_column(self, theta: Array) -> dict[str, Array]:
        """Parameters by key."""
        return {k: theta[m[:-1]] for k, m in zip(self.keys, self.members, strict=True)}

    def spread(self, theta: Array) -> Array:
        """Weights of all quantities of the spectrum (Q,)."""
        out = np.zeros(self.space.low.size)
        out[self.every] = self.weights(theta)
        return out


def saturated(space: FleetSpectrum) -> Array:
    """Mean squares (bands, L) that everything at once leaves, as `learn.posterior.score.saturated`."""
    unknown = np.concatenate([*space.parameters.values(), space.always]).astype(np.intp)
    trims, weights = space.trims, np.zeros(space.low.size)
    weights[0] = 1.0
    left = space.products[:, :, 0, 0]
    narrow = np.diag((0.5 * space.scale[unknown]) ** -2.0)
    for _ in range(SATURATED):
        variance = np.maximum(left, space.sensor)
        g = (1.0 / variance)[0, trims.axes]
        whole = np.tensordot(space.count / variance, space.products, axes=([0, 1], [0, 1]))
        whole -= trims.eliminated(g, 0.5 * trims.scale)
        weights[unknown] = -np.linalg.solve(whole[np.ix_(unknown, unknown)] + narrow, whole[unknown, 0])
        left = quadratic(space.products, weights)
        t = trims.likeliest(g, weights, 0.5 * trims.scale)
        left[0, trims.axes] += trims.squares_left(t, weights).sum(axis=0) / space.count[0, trims.axes]
        left = np.maximum(left, 0.0)
    return left
