"""What a model leaves of its flights, as a random process of which another flight can be drawn.

A flight of seconds shows a gust of seconds once. Played again at another time of the same flight it is the same gust,
with the same mean. So what is left on an axis is taken to be a constant c, a first-order Gauss-Markov process s and
white noise (`learn.data.gauss_markov`). A draw takes each from its posterior, then s anew; axes go together as the
increments of s did. What is faster than s is played from another time of the flights, of which it has many, without the
share of its scatter that is sensor noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.gauss_markov import (
    BLOCK,
    TIMES,
    WHITE,
    GaussMarkov,
    block_means,
    gauss_markov,
    pieces,
    spectral,
)


@dataclass(frozen=True)
class Left:
    """What a model leaves (K, 6) [N, Nm] of a stretch, in B about O, `dt` [s] apart; the sensors' noise (6,) in it."""

    wrench: Array
    dt: float
    noise: Array


@dataclass(frozen=True)
class DisturbanceProcess:
    """The `posterior` of six axes; `mixing` (6, 6) makes them of independent ones, `fast` is what is played again."""

    posterior: GaussMarkov
    mixing: Array
    fast: tuple[Left, ...]

    def draw(self, count: int, dt: float, rng: np.random.Generator) -> tuple[Array, Array]:
        """Another flight's wrenches (N, 6) [N, Nm], N = `count`, `dt` [s] apart, and the constant (6,) in them."""
        seen = self.posterior
        place = [np.unravel_index(rng.choice(w.size, p=w.ravel()), w.shape) for w in seen.weights]
        rows = (np.arange(len(place)), *np.transpose(place))
        variance = seen.q[rows] / rng.chisquare(seen.count - 1, len(place))
        blocks = int(np.ceil(count * dt / BLOCK)) + 1
        normal = rng.standard_normal((blocks + 1, len(place))) @ self.mixing.T
        keep = np.exp(-BLOCK / TIMES[rows[1]])
        slow = normal[:blocks] * np.sqrt((1.0 - WHITE[rows[2]]) * variance)
        for k in range(1, blocks):
            slow[k] = keep * slow[k - 1] + np.sqrt(1.0 - keep**2) * slow[k]
        constant = seen.constant[rows] + np.sqrt(variance * seen.spread[rows]) * normal[-1]
        time, at = np.arange(count) * dt, np.arange(blocks) * BLOCK
        smooth = np.stack([np.interp(time, at, column) for column in slow.T], axis=1)
        return constant + smooth + _elsewhere(self.fast, count, dt, rng), constant

    def draws(self, number: int, count: int, dt: float, rng: np.random.Generator) -> tuple[Array, Array]:
        """So many flights (D, N, 6), and the constants (D, 6) in them."""
        wrenches, constants = zip(*(self.draw(count, dt, rng) for _ in range(number)), strict=True)
        return np.array(wrenches), np.array(constants)


def disturbance_process(left: Sequence[Left]) -> DisturbanceProcess:
    """Of what a model leaves of flights."""
    segments = [Left(part, one.dt, one.noise) for one in left for part in pieces(one.wrench, one.dt)]
    means = [block_means(one.wrench, one.dt) for one in segments]
    posterior = gauss_markov(means)
    smooth = [_smoothed(y, step, posterior) for y, step in means]
    fast = tuple(_fast(one, s, step) for one, (_, step), s in zip(segments, means, smooth, strict=True))
    return DisturbanceProcess(posterior, _mixing(smooth), fast)


def _smoothed(y: Array, step: float, posterior: GaussMarkov) -> Array:
    """The expected c + s (M, 6) at the most probable time and share of each axis."""
    out = np.empty(y.shape)
    for axis, (t, r) in enumerate(posterior.most_probable()):
        size, basis = spectral(len(y), step)[t]
        slow = (1.0 - WHITE[r]) * np.maximum(size, 1e-9)
        c = posterior.constant[axis, t, r]
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


def _fast(one: Left, smooth: Array, step: float) -> Left:
    """What is faster than c + s (M, 6), `step` [s] apart, less its share of sensor noise, which pushes nothing."""
    time = np.arange(len(one.wrench)) * one.dt
    at = np.arange(len(smooth)) * step + 0.5 * (step - one.dt)
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
