"""What atoms gain on residuals, all atoms and many residuals at once (`evidence` has the equations)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.flight import Array, Indices, Mask
from wrenchgap.learn.data.errors import sums_by
from wrenchgap.learn.discover.atoms import Atom
from wrenchgap.learn.discover.evidence import Evidence, projected_out
from wrenchgap.learn.discover.settings import SETTINGS


def gains_of(on: Evidence, targets: Array) -> tuple[Array, Array]:
    """What atoms (A,) gain on each of some targets (rows, N): gains (A, N), and weights of all columns (P, N).

    Cells count alike at first, then by what is left in them; atoms with as many columns are worked out at once.
    """
    cells = len(on.count)
    rows = [np.flatnonzero(on.cell == c) for c in range(cells)]
    size = np.array([max(len(own), 1) for own in rows])[:, None]
    power = np.stack([(targets[own] ** 2).sum(axis=0) for own in rows]) / size
    before = np.maximum(power, on.floor[:, None])
    gains, theta = np.empty((len(on.atoms), targets.shape[1])), np.empty((on.X.shape[1], targets.shape[1]))
    widths = np.array([own.stop - own.start for own in on.of])
    for width in np.unique(widths):
        some = np.flatnonzero(widths == width)
        columns = np.array([on.of[k].start for k in some])[:, None] + np.arange(width)
        parts = [on.X[own][:, columns].astype(np.float64) for own in rows]
        gram = np.stack([np.einsum("rai,raj->aij", x, x) for x in parts]) / size[:, :, None, None]
        cross = np.stack([np.tensordot(x, targets[own], (0, 0)) for x, own in zip(parts, rows, strict=True)])
        cross /= size[:, :, None, None]
        weight = np.broadcast_to(size[:, None], (cells, len(some), targets.shape[1]))
        for _ in range(2):
            whole = np.einsum("can,caij->anij", weight, gram)
            whole += 1e-9 * np.trace(whole, axis1=2, axis2=3)[:, :, None, None] * np.eye(width) + 1e-12 * np.eye(width)
            t = np.linalg.solve(whole, np.einsum("can,cain->ani", weight, cross)[..., None])[..., 0]
            left = power[:, None] - 2.0 * np.einsum("ani,cain->can", t, cross)
            left += np.einsum("ani,caij,anj->can", t, gram, t, optimize=True)
            left = np.maximum(left, on.floor[:, None, None])
            weight = size[:, None] / np.maximum(left, 1e-3)
        gains[some] = 0.5 * np.einsum("c,can->an", on.count, np.log(before[:, None] / left))
        theta[columns] = t.transpose(0, 2, 1)
    return gains - np.array([a.price for a in on.atoms])[:, None], theta


@dataclass(frozen=True)
class Step:
    """The atom that gains most: its number and gain, the largest of chance (N,), and atoms that predict the same."""

    atom: int
    gain: float
    null_gains: Array
    equivalents: tuple[int, ...]

    @property
    def p_value(self) -> float:
        """Share of residuals of chance in which as much was found."""
        return float((1 + np.sum(self.null_gains >= self.gain)) / (1 + len(self.null_gains)))

    @property
    def null_quantile(self) -> float:
        """What chance gains in one of twenty residuals."""
        return float(np.quantile(self.null_gains, 1.0 - SETTINGS.p_value))


def gain_beside(on: Evidence, X: Array, others: Sequence[int]) -> float:
    """What the columns (rows, P) of one law gain when other atoms are there, without its price."""
    X, y = projected_out(on.columns(others), X, on.y) if others else (X, on.y)
    alone = replace(on, atoms=(Atom("", "", ()),), of=(slice(0, X.shape[1]),), X=X)
    return float(gains_of(alone, y[:, None])[0][0, 0])


def step(on: Evidence, equivalent: float) -> Step:
    """Search the residual, and the residuals of chance; what is at most `equivalent` nats behind predicts the same."""
    gains = gains_of(on, on.y[:, None])[0][:, 0]
    null_gains = gains_of(on, on.nulls)[0].max(axis=0)
    order = np.argsort(-gains)
    near = tuple(int(k) for k in order[1:] if gains[k] > gains[order[0]] - equivalent)
    return Step(int(order[0]), float(gains[order[0]]), null_gains, near)


def best_on(on: Evidence, keep: Mask) -> int:
    """The atom that gains most on some of the rows."""
    part = on.rows(keep)
    return int(np.argmax(gains_of(part, part.y[:, None])[0][:, 0]))


def coefficients(X: Array, y: Array, moment: Indices) -> tuple[Array, Array]:
    """Weights (P,) of columns (rows, P), covariance: sandwich over pairs of blocks (Liang, Zeger, Biometrika 1986)."""
    whole = X.T @ X
    inverse = np.linalg.inv(whole + 1e-9 * np.trace(whole) * np.eye(len(whole)))
    theta = inverse @ (X.T @ y)
    _, cluster = np.unique(moment // 2, return_inverse=True)
    scores = sums_by(cluster, X * (y - X @ theta)[:, None])
    many = len(scores) / max(len(scores) - 1, 1)
    return theta, many * inverse @ (scores.T @ scores) @ inverse
