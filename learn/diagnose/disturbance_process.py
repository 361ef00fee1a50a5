"""What a model leaves of its flights, as a random process of which another flight can be drawn.

A flight of seconds shows a gust of seconds once. Played again at another time of the same flight it is the same gust,
with the same mean. So the means y (M,) over `BLOCK` of what is left on an axis are taken to be

    y = c 1 + s + e,    cov(s(t), s(t')) = (1 - r) v exp(-|t - t'| / tau),    cov(e) = r v I

a constant, a first-order Gauss-Markov process (Dryden's form of turbulence along the flight: MIL-F-8785C, 3.7.2; Gelb,
Applied Optimal Estimation, 1974, 3.8) and what changes from block to block. With K = cov(y) / v, no preference for any
c, 1/v for v and none among the logarithms of tau, the posterior of tau and r on a grid, of v and of c is

    log p(tau, r | y) = -1/2 [log det K + log a + (n - 1) log q],    a = 1' K^-1 1,    b = 1' K^-1 y
    q = y' K^-1 y - b^2 / a,    v | tau, r ~ q / chi^2_(n-1),    c | v, tau, r ~ N(b / a, v / a)

(restricted likelihood: Patterson and Thompson, Biometrika 58, 1971). Sums go over the stretches, which share c. A draw
takes each from its posterior, then s anew; axes go together as the increments of s did. What is faster than s is
played from another time of the flights, of which it has many, without the share of its scatter that is sensor noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchgap.flight.flight import Array

BLOCK = 0.25
"""Over which means are taken [s]: faster than gusts that a controller has to answer, slower than the filter."""
TIMES = np.geomspace(BLOCK, 30.0, 12)
"""Correlation times [s]: from one block to that of turbulence of 150 m in 5 m/s of wind. What is slower is constant."""
WHITE = np.array([0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.9, 0.99])
"""Shares r of the variance that change from block to block."""


@dataclass(frozen=True)
class Left:
    """What a model leaves (K, 6) [N, Nm] of a stretch, in B about O, `dt` [s] apart; the sensors' noise (6,) in it."""

    wrench: Array
    dt: float
    noise: Array


@dataclass(frozen=True)
class DisturbanceProcess:
    """The posterior of six axes: weights (6, T, R) of times and shares, and there the constant, its variance and q.

    `count` blocks were seen; `mixing` (6, 6) makes the axes of independent ones; `fast` is what is played again.
    """

    weights: Array
    constant: Array
    spread: Array
    q: Array
    count: int
    mixing: Array
    fast: tuple[Left, ...]

    def draw(self, count: int, dt: float, rng: np.random.Generator) -> tuple[Array, Array]:
        """Another flight's wrenches (N, 6) [N, Nm], N = `count`, `dt` [s] apart, and the constant (6,) in them."""
        place = [np.unravel_index(rng.choice(w.size, p=w.ravel()), w.shape) for w in self.weights]
        rows = (np.arange(len(place)), *np.transpose(place))
        variance = self.q[rows] / rng.chisquare(self.count - 1, len(place))
        blocks = int(np.ceil(count * dt / BLOCK)) + 1
        normal = rng.standard_normal((blocks + 1, len(place))) @ self.mixing.T
        keep = np.exp(-BLOCK / TIMES[rows[1]])
        slow = normal[:blocks] * np.sqrt((1.0 - WHITE[rows[2]]) * variance)
        for k in range(1, blocks):
            slow[k] = keep * slow[k - 1] + np.sqrt(1.0 - keep**2) * slow[k]
        constant = self.constant[rows] + np.sqrt(variance * self.spread[rows]) * normal[-1]
        time, at = np.arange(count) * dt, np.arange(blocks) * BLOCK
        smooth = np.stack([np.interp(time, at, column) for column in slow.T], axis=1)
        return constant + smooth + _elsewhere(self.fast, count, dt, rng), constant

    def draws(self, number: int, count: int, dt: float, rng: np.random.Generator) -> tuple[Array, Array]:
        """So many flights (D, N, 6), and the constants (D, 6) in them."""
        wrenches, constants = zip(*(self.draw(count, dt, rng) for _ in range(number)), strict=True)
        return np.array(wrenches), np.array(constants)


def disturbance_process(left: Sequence[Left]) -> DisturbanceProcess:
    """Of what a model leaves of flights."""
    segments = [piece for one in left for piece in _segments(one)]
    means = [_means(one) for one in segments]
    count = sum(len(y) for y, _, _ in means)
    bases: dict[tuple[int, float], list[tuple[Array, Array]]] = {}
    for y, _, step in means:
        if (len(y), step) not in bases:
            bases[len(y), step] = [np.linalg.eigh(_covariance(len(y), step / tau)) for tau in TIMES]
    sums = np.zeros((4, 6, len(TIMES), len(WHITE)))
    for y, _, step in means:
        sums += _sums(y, bases[len(y), step])
    a, b, c, logdet = sums
    q = np.maximum(c - b**2 / a, 1e-300)
    density = -0.5 * (logdet + np.log(a) + (count - 1) * np.log(q))
    weights = np.exp(density - density.max(axis=(1, 2), keepdims=True))
    weights /= weights.sum(axis=(1, 2), keepdims=True)
    best = [np.unravel_index(np.argmax(w), w.shape) for w in weights]
    smooth = [_smoothed(y, bases[len(y), step], (b / a), best) for y, _, step in means]
    fast = tuple(_fast(one, at, s) for one, (_, at, _), s in zip(segments, means, smooth, strict=True))
    return DisturbanceProcess(weights, b / a, 1.0 / a, q, count, _mixing(smooth), fast)


def _segments(one: Left, longest: float = 60.0) -> list[Left]:
    """Pieces of at most `longest` [s] of a stretch: work goes with the cube of it."""
    pieces = max(1, int(np.ceil(len(one.wrench) * one.dt / longest)))
    return [Left(part, one.dt, one.noise) for part in np.array_split(one.wrench, pieces)]


def _means(one: Left) -> tuple[Array, Array, float]:
    """Means (M, 6) over blocks, at which times (M,) [s] of the stretch, and how far apart [s]."""
    size = max(1, round(BLOCK / one.dt))
    count = max(len(one.wrench) // size, 1)
    size = min(size, len(one.wrench))
    y = one.wrench[: count * size].reshape(count, size, 6).mean(axis=1)
    return np.asarray(y), np.asarray((np.arange(count) * size + 0.5 * (size - 1)) * one.dt), size * one.dt


def _covariance(count: int, x: float) -> Array:
    """Of the means over `count` blocks of x correlation times of a process of variance one: the integral over both."""
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    between = (2.0 * np.cosh(x) - 2.0) * np.exp(-x * apart)
    return np.asarray(np.where(apart == 0, 2.0 * (x - 1.0 + np.exp(-x)), between) / x**2)


def _sums(y: Array, bases: Sequence[tuple[Array, Array]]) -> Array:
    """a, b, y' K^-1 y and log det K (4, 6, T, R) of one stretch."""
    out = np.empty((4, 6, len(bases), len(WHITE)))
    for t, (size, basis) in enumerate(bases):
        one, turned = basis.sum(axis=0), basis.T @ y
        power = (1.0 - WHITE) * np.maximum(size, 1e-9)[:, None] + WHITE
        out[0, :, t] = (one**2) @ (1.0 / power)
        out[1, :, t] = (turned * one[:, None]).T @ (1.0 / power)
        out[2, :, t] = (turned**2).T @ (1.0 / power)
        out[3, :, t] = np.log(power).sum(axis=0)
    return out


def _smoothed(
    y: Array, bases: Sequence[tuple[Array, Array]], constant: Array, best: Sequence[tuple[Any, ...]]
) -> Array:
    """The expected c + s (M, 6) at the most probable time and share of each axis."""
    out = np.empty(y.shape)
    for axis, (t, r) in enumerate(best):
        size, basis = bases[t]
        slow = (1.0 - WHITE[r]) * np.maximum(size, 1e-9)
        c = constant[axis, t, r]
        out[:, axis] = c + basis @ (slow / (slow + WHITE[r]) * (basis.T @ (y[:, axis] - c)))
    return out


def _mixing(smooth: Sequence[Array]) -> Array:
    """A root (6, 6) of the correlation of the axes' increments."""
    steps = np.concatenate([np.diff(s, axis=0) for s in smooth])
    size = np.sqrt(np.mean(steps**2, axis=0)) if len(steps) else np.zeros(6)
    correlation = np.eye(6)
    moved = size > 0.0
    if moved.any():
        scaled = steps[:, moved] / size[moved]
        correlation[np.ix_(moved, moved)] = scaled.T @ scaled / len(scaled)
    values, vectors = np.linalg.eigh(correlation)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _fast(one: Left, at: Array, smooth: Array) -> Left:
    """What is faster than c + s, less the share of its scatter that is noise of the sensors: that pushes nothing."""
    time = np.arange(len(one.wrench)) * one.dt
    rest = one.wrench - np.stack([np.interp(time, at, column) for column in smooth.T], axis=1)
    size = np.maximum(np.mean(rest**2, axis=0), 1e-30)
    return Left(rest * np.sqrt(np.maximum(1.0 - np.nan_to_num(one.noise) ** 2 / size, 0.0)), one.dt, one.noise)


def _elsewhere(left: Sequence[Left], count: int, dt: float, rng: np.random.Generator) -> Array:
    """What was left (N, 6) from some instant of some stretch on, `dt` apart; it goes back from its end, and on."""
    lengths = np.array([len(one.wrench) for one in left], dtype=float)
    one = left[rng.choice(len(left), p=lengths / lengths.sum())]
    size = len(one.wrench)
    place = rng.uniform(0.0, size) + np.arange(count) * dt / one.dt
    turned = np.abs((place + size - 1) % max(2 * size - 2, 1) - size + 1)
    return np.asarray(one.wrench[np.minimum(turned.astype(int), size - 1)])
