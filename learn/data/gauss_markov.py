"""The mean of a signal whose neighbours in time are alike: what it is, and how far it may be off.

Twenty blocks of time in which one gust was felt are not twenty measurements. Means y (M,) over `BLOCK` are taken to be

    y = c 1 + s + e,    cov(s(t), s(t')) = (1 - r) v exp(-|t - t'| / tau),    cov(e) = r v I

a constant, a first-order Gauss-Markov process (Dryden's form of turbulence along the flight: MIL-F-8785C, 3.7.2; Gelb,
Applied Optimal Estimation, 1974, 3.8) and what changes from block to block. With K = cov(y) / v, no preference for any
c, 1/v for v and none among the logarithms of tau, the posterior of tau and r on a grid, of v and of c is

    log p(tau, r | y) = -1/2 [log det K + log a + (n - 1) log q],    a = 1' K^-1 1,    b = 1' K^-1 y
    q = y' K^-1 y - b^2 / a,    v | tau, r ~ q / chi^2_(n-1),    c | v, tau, r ~ N(b / a, v / a)

(restricted likelihood: Patterson and Thompson, Biometrika 58, 1971). Sums go over the stretches, which share c.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from wrenchgap.flight.flight import Array

BLOCK = 0.25
"""Over which means are taken [s]: faster than gusts that a controller has to answer, slower than the filter."""
TIMES = np.geomspace(BLOCK, 30.0, 12)
"""Correlation times [s]: from one block to that of turbulence of 150 m in 5 m/s of wind. What is slower is constant."""
WHITE = np.array([0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.9, 0.99])
"""Shares r of the variance that change from block to block."""


@dataclass(frozen=True)
class GaussMarkov:
    """The posterior of L signals: weights (L, T, R) of times and shares, and there the constant, its variance over v
    and q. `count` means were seen.
    """  # noqa: D205

    weights: Array
    constant: Array
    spread: Array
    q: Array
    count: int

    @property
    def variance(self) -> Array:
        """Of the constants (L,): the geometric mean over times and shares.

        Their expectation is that of the few in which all that was seen is one gust: ten times as wide on 10 s.
        """
        each = np.log(self.q * self.spread / max(self.count - 3, 1))
        return np.asarray(np.exp(np.sum(self.weights * each, axis=(1, 2))))

    def most_probable(self) -> list[tuple[int, int]]:
        """Indices of the time and share of each signal."""
        flat = self.weights.reshape(len(self.weights), -1).argmax(axis=1)
        return [divmod(int(k), len(WHITE)) for k in flat]


def gauss_markov(stretches: Sequence[tuple[Array, float]]) -> GaussMarkov:
    """Of stretches of L signals, each the `block_means` (M, L) and how far apart they are [s]."""
    a, b, c, logdet = np.sum([_sums(y, spectral(len(y), step)) for y, step in stretches], axis=0)
    count = sum(len(y) for y, _ in stretches)
    q = np.maximum(c - b**2 / a, 1e-300)
    density = -0.5 * (logdet + np.log(a) + (count - 1) * np.log(q))
    weights = np.exp(density - density.max(axis=(1, 2), keepdims=True))
    return GaussMarkov(weights / weights.sum(axis=(1, 2), keepdims=True), b / a, 1.0 / a, q, count)


def pieces(values: Array, dt: float, longest: float = 60.0) -> list[Array]:
    """Of at most `longest` [s] of values (K, L), `dt` [s] apart: work goes with the cube of it."""
    return np.array_split(values, max(1, int(np.ceil(len(values) * dt / longest))))


def block_means(values: Array, dt: float) -> tuple[Array, float]:
    """Means (M, L) over blocks of values (K, L), `dt` [s] apart, and how far apart the means are [s]."""
    size = max(1, min(round(BLOCK / dt), len(values)))
    count = len(values) // size
    return np.asarray(values[: count * size].reshape(count, size, -1).mean(axis=1)), size * dt


@lru_cache(maxsize=32)
def spectral(count: int, step: float) -> tuple[tuple[Array, Array], ...]:
    """Eigenvalues (M,) and vectors (M, M) of the covariance at each of `TIMES`."""
    return tuple(np.linalg.eigh(_covariance(count, step / tau)) for tau in TIMES)


def _covariance(count: int, x: float) -> Array:
    """Of the means over `count` blocks of x correlation times of a process of variance one: the integral over both."""
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    between = (2.0 * np.cosh(x) - 2.0) * np.exp(-x * apart)
    return np.asarray(np.where(apart == 0, 2.0 * (x - 1.0 + np.exp(-x)), between) / x**2)


def _sums(y: Array, bases: Sequence[tuple[Array, Array]]) -> Array:
    """a, b, y' K^-1 y and log det K (4, L, T, R) of one stretch."""
    out = np.empty((4, y.shape[1], len(bases), len(WHITE)))
    for t, (size, basis) in enumerate(bases):
        one, turned = basis.sum(axis=0), basis.T @ y
        power = (1.0 - WHITE) * np.maximum(size, 1e-9)[:, None] + WHITE
        out[0, :, t] = (one**2) @ (1.0 / power)
        out[1, :, t] = (turned * one[:, None]).T @ (1.0 / power)
        out[2, :, t] = (turned**2).T @ (1.0 / power)
        out[3, :, t] = np.log(power).sum(axis=0)
    return out
