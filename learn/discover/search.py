"""What atoms gain on residuals, all atoms and many residuals at once (`evidence` has the equations)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.learn.discover.atoms import Atom
from wrenchgap.learn.discover.evidence import Evidence
from wrenchgap.learn.discover.settings import SETTINGS


def gains_of(on: Evidence, targets: Array) -> tuple[Array, Array]:
    """What atoms (A,) gain on each of some targets (rows, N): gains (A, N), and weights of all columns (P, N)."""
    cells = len(on.count)
    order = np.argsort(on.cell, kind="stable")
    cuts = np.searchsorted(on.cell[order], np.arange(cells + 1))
    P, N = on.X.shape[1], targets.shape[1]
    b, power = np.zeros((cells, P, N)), np.zeros((cells, N))
    grams = [np.zeros((cells, s.stop - s.start, s.stop - s.start)) for s in on.of]
    squares = np.zeros((cells, P))
    for c in range(cells):
        rows = order[cuts[c] : cuts[c + 1]]
        if not len(rows):
            continue
        x, t = on.X[rows].astype(np.float64), targets[rows]
        b[c], power[c], squares[c] = x.T @ t, (t**2).sum(axis=0), (x**2).sum(axis=0)
        for k, s in enumerate(on.of):
            if s.stop - s.start > 1:
                grams[k][c] = x[:, s].T @ x[:, s]
            else:
                grams[k][c] = squares[c, s]
    size = np.maximum(np.bincount(on.cell, minlength=cells), 1)
    gains, theta = np.empty((len(on.atoms), N)), np.empty((P, N))
    floor = on.floor[:, None]
    before = np.maximum(power / size[:, None], floor)
    single = np.array([k for k, s in enumerate(on.of) if s.stop - s.start == 1])
    many = [k for k, s in enumerate(on.of) if s.stop - s.start > 1]
    if len(single):
        cols = np.array([on.of[k].start for k in single])
        B, G = b[:, cols], squares[:, cols]
        weight = np.ones((cells, 1, 1))
        for _ in range(2):
            t = (weight * B).sum(axis=0) / np.maximum((weight * G[:, :, None]).sum(axis=0), 1e-12)
            left = (power[:, None] - 2.0 * t * B + t**2 * G[:, :, None]) / size[:, None, None]
            left = np.maximum(left, floor[:, :, None])
            weight = 1.0 / np.maximum(left, 1e-3)
        gains[single] = 0.5 * np.einsum("c,cpn->pn", on.count, np.log(before[:, None] / left))
        theta[cols] = t
    for k in many:
        s, G = on.of[k], grams[k]
        B = b[:, s]
        weight = np.ones((cells, N))
        for _ in range(2):
            whole = np.einsum("cn,cij->nij", weight, G)
            whole += 1e-9 * np.trace(whole, axis1=1, axis2=2)[:, None, None] * np.eye(G.shape[1])
            t = np.linalg.solve(whole, np.einsum("cn,cin->ni", weight, B)[:, :, None])[:, :, 0].T
            left = (power - 2.0 * np.einsum("in,cin->cn", t, B) + np.einsum("in,cij,jn->cn", t, G, t)) / size[:, None]
            left = np.maximum(left, floor)
            weight = 1.0 / np.maximum(left, 1e-3)
        gains[k] = 0.5 * on.count @ np.log(before / left)
        theta[s] = t
    return gains - np.array([a.price for a in on.atoms])[:, None], theta


@dataclass(frozen=True)
class Step:
    """The atom that gains most: its number, what it gains, what chance gains (N,), and those that are alike."""

    atom: int
    gain: float
    chance: Array
    alike: tuple[int, ...]

    @property
    def false_alarm(self) -> float:
        """Share of residuals of chance in which as much was found."""
        return float((1 + np.sum(self.chance >= self.gain)) / (1 + len(self.chance)))

    @property
    def bar(self) -> float:
        """What chance gains in one of twenty residuals."""
        return float(np.quantile(self.chance, 1.0 - SETTINGS.false_alarms))


def gain_beside(on: Evidence, X: Array, others: Sequence[int]) -> float:
    """What the columns (rows, P) of one law gain when other atoms are there, without its price."""
    y = on.y
    if others:
        u, s, _ = np.linalg.svd(on.columns(others), full_matrices=False)
        basis = u[:, s > 1e-6 * s.max()]
        X, y = (m - basis @ (basis.T @ m) for m in (X, y))
    alone = replace(on, atoms=(Atom("", "", ()),), of=(slice(0, X.shape[1]),), X=X)
    return float(gains_of(alone, y[:, None])[0][0, 0])


def step(on: Evidence, alike: float) -> Step:
    """Search the residual, and the residuals of chance; atoms at most `alike` nats behind the best are like it."""
    gains = gains_of(on, on.y[:, None])[0][:, 0]
    chance = gains_of(on, on.nulls)[0].max(axis=0)
    order = np.argsort(-gains)
    near = tuple(int(k) for k in order[1:] if gains[k] > gains[order[0]] - alike)
    return Step(int(order[0]), float(gains[order[0]]), chance, near)


def best_on(on: Evidence, keep: NDArray[np.bool_]) -> int:
    """The atom that gains most on some of the rows."""
    part = on.rows(keep)
    return int(np.argmax(gains_of(part, part.y[:, None])[0][:, 0]))


def coefficients(X: Array, y: Array, moment: NDArray[np.intp]) -> tuple[Array, Array]:
    """Weights (P,) of columns (rows, P) and their covariance, by the sandwich over pairs of blocks of time.

    Source: clustered sandwich, Liang and Zeger, Biometrika 1986.
    """
    whole = X.T @ X
    inverse = np.linalg.inv(whole + 1e-9 * np.trace(whole) * np.eye(len(whole)))
    theta = inverse @ (X.T @ y)
    _, cluster = np.unique(moment // 2, return_inverse=True)
    scores = np.zeros((cluster.max() + 1, X.shape[1]))
    np.add.at(scores, cluster, X * (y - X @ theta)[:, None])
    many = len(scores) / max(len(scores) - 1, 1)
    return theta, many * inverse @ (scores.T @ scores) @ inverse
