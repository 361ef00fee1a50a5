"""Passes over the rows of a series; those in which a row depends on the one before, or many are summed, compiled."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

TILE = 1024
"""Numbers that are gone through at a time: they stay in the nearest cache."""


@njit(cache=True, nogil=True)
def repeats(values: Array) -> Counts:
    """How often a column repeats its last value, and how often in a row at most: (2, C) of values (N, C)."""
    out = np.zeros((2, values.shape[1]), dtype=np.int64)
    run = np.zeros(values.shape[1], dtype=np.int64)
    for i in range(1, values.shape[0]):
        for k in range(values.shape[1]):
            if values[i, k] - values[i - 1, k] == 0.0:
                out[0, k] += 1
                run[k] += 1
                if run[k] > out[1, k]:
                    out[1, k] = run[k]
            else:
                run[k] = 0
    return out


@njit(cache=True, nogil=True)
def held_mean(time: Array, knots: Array, values: Array, window: float) -> Array:
    """Mean over `window` [s] around each `time` (N,), increasing, of values (K, C), held between `knots` (K + 1,).

    Exact, as the integral of a held signal is piecewise linear: zero before the first knot, constant after the last.
    The integral up to the knot before either end of the window goes along with that end.
    """
    columns, last = values.shape[1], len(knots) - 1
    out = np.empty((len(time), columns))
    before, integral = np.zeros(2, dtype=np.int64), np.zeros((2, columns))
    for i in range(len(time)):
        for side in range(2):
            t = time[i] + (-1.0, 1.0)[side] * window / 2
            j, reached = before[side], integral[side]
            while j < last and knots[j + 1] <= t:
                for k in range(columns):
                    reached[k] += values[j, k] * (knots[j + 1] - knots[j])
                j += 1
            before[side] = j
            for k in range(columns):
                at = reached[k]
                if j < last and t > knots[0]:
                    at += values[j, k] * (t - knots[j])
                out[i, k] = at if side == 0 else (at - out[i, k]) / window
    return out


@njit(cache=True, nogil=True)
def clamped_sum(steps: Array, start: Array, limit: Array) -> Array:
    """Sums (N, C) before each of the `steps` (N, C), from `start` (C,), kept within +-`limit` (C,) at every step."""
    out = np.empty(steps.shape)
    for k in range(steps.shape[1]):
        held, most = start[k], limit[k]
        for i in range(len(steps)):
            out[i, k] = held
            held = min(max(held + steps[i, k], -most), most)
    return out


@njit(cache=True, nogil=True, fastmath={"contract"})
def correlated(values: Array, weights: Array) -> Array:
    """Sums (N - n + 1, C) of the n rows of values (N, C) around each row, times `weights` (n,)."""
    columns = values.shape[1]
    out = np.zeros((len(values) - len(weights) + 1, columns))
    flat, sums = values.reshape(-1), out.reshape(-1)
    for start in range(0, len(sums), TILE):
        tile = sums[start : start + TILE]
        for k in range(len(weights)):
            weight, rows = weights[k], flat[start + k * columns :]
            for i in range(len(tile)):
                tile[i] += weight * rows[i]
    return out


def lengths(values: Array) -> Array:
    """Euclidean length (N,) of each row of values (N, C)."""
    return np.asarray(np.sqrt(sum(column * column for column in values.T)))


def integral(time: Array, values: Array) -> Array:
    """Integrals (N, C) of values (N, C), straight between their `time` (N,), from the first on."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(time)[:, None]
    return np.concatenate((np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)))


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First index and one past the last of every run of true values (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def varying(values: Array) -> NDArray[np.bool_]:
    """Which columns (C,) of values (N, C) are numbers that change; most do within the first rows."""
    if not len(values):
        return np.zeros(values.shape[1], dtype=bool)
    found = np.zeros(values.shape[1], dtype=bool)
    for start in range(0, len(values), 1024):
        found |= np.any(values[start : start + 1024] != values[0], axis=0)
        if found.all():
            break
    return np.asarray(found & ~np.isnan(values[0]))


def empty(values: Array) -> NDArray[np.bool_]:
    """Which columns (C,) of values (N, C) are no number throughout."""
    found = np.asarray(np.isnan(values[:1]).all(axis=0))
    return np.asarray(np.isnan(values).all(axis=0)) if found.any() else found
