"""The linear problem that sets of effects are scored on: products of what is linear, by band of frequency and axis.

The stacked quantities q_k are: what the model leaves, then of each column its parameters and its offset, then what is
always there. Flights give them by a transform of their samples (`learn.posterior.spectrum`), fleets by sums over stored
evidence (`learn.posterior.fleet_spectrum`).

The trim t of a flight on an axis enters through the sums s = sum_k c_k q_k and N = sum_k c_k^2 alone, c_k its
coefficients, where it is no quantity of its own. With weights w of the quantities, g the precision of a coefficient and
sigma the trim's size,

    t = -g s.w / (g N + sigma^-2)             the likeliest trim
    -g^2 (s.w)^2 / (g N + sigma^-2)           what it takes off g |C w|^2
    -1/2 log(1 + g N sigma^2)                 its Occam factor

so thousands of flights cost sums, and no unknowns. Source: the Schur complement of a block-arrow matrix, Golub and Van
Loan, "Matrix Computations", 4th ed., 4.5. The limits of trims (`learn.identify.bias_and_trim.trim_of`, five standard
deviations) are not enforced then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.flight import Array, Indices, Mask
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.settings import DEFAULT


@dataclass(frozen=True)
class Trims:
    """Sums (F, A, Q) and squares (F, A) of the trims of F flights on axes (A,); their standard deviations (A,)."""

    sums: Array
    squares: Array
    axes: Indices
    scale: Array

    def of(self, rows: Indices | None = None, flight: int | None = None) -> Trims:
        """Of these quantities (R,) alone, or of one flight alone."""
        some = slice(None) if flight is None else slice(flight, flight + 1)
        sums = self.sums[some] if rows is None else self.sums[some][:, :, rows]
        return Trims(sums, self.squares[some], self.axes, self.scale)

    def precision(self, g: Array) -> Array:
        """Of the trims (F, A), at precisions (A,) of a coefficient."""
        return np.asarray(g * self.squares + self.scale**-2.0)

    def likeliest(self, g: Array, weights: Array) -> Array:
        """Trims (F, A) at these weights (Q,), in the sign in which they add to what is left."""
        return np.asarray(-g * (self.sums @ weights) / self.precision(g))

    def eliminated_from(self, whole: Array, g: Array) -> Array:
        """Products (Q, Q) that g weighs, without what trims take off them."""
        if not self.axes.size:
            return whole
        flights, axes, q = self.sums.shape
        rows = (self.sums * (g / np.sqrt(self.precision(g)))[:, :, None]).reshape(flights * axes, q)
        return np.asarray(whole - rows.T @ rows)

    def occam(self, g: Array) -> float:
        """Log of what the integral over them adds, without the prior at the likeliest ones."""
        return -0.5 * float(np.sum(np.log1p(g * self.squares * self.scale**2)))

    def squares_left(self, trims: Array, weights: Array) -> Array:
        """What trims (F, A) add to the sums of squares of what is left, by flight and axis (F, A)."""
        return np.asarray(2.0 * trims * (self.sums @ weights) + trims**2 * self.squares)

    def added_to(self, left: Array, trims: Array, weights: Array, count: Array) -> Array:
        """Mean squares (bands, L) of what is left, with trims (F, A) beside the weights; over `count` coefficients."""
        if not self.axes.size:
            return left
        out = left.copy()
        out[0, self.axes] += self.squares_left(trims, weights).sum(axis=0) / count[0, self.axes]
        return out

    @classmethod
    def none(cls, quantities: int) -> Trims:
        """Of flights whose trims are quantities of their own."""
        return cls(np.zeros((0, 0, quantities)), np.zeros((0, 0)), np.zeros(0, dtype=np.intp), np.zeros(0))


class LinearProblem:
    """Where each quantity stands, with its limits and size; products of all of them.

    `columns` by key; `parameters` and `offset` are the rows of each, `always` those of what is always there. `low`,
    `high`, `scale` and `sparse` (Q,) are of all quantities. `axes` (A,) out of six; `count` (bands, A) coefficients,
    `sensor` (bands, A) the variance that sensors leave in one, `blocks` of time. `leak` (bands, A) is the mean square
    below which nothing is told by what is left on an axis. `trims` are those of flights, where they are no quantities.
    `settings` are those of the search that asks. Of flights at hand, and not of fleets, the coefficients are known:
    `band` and `block` (K,) of each, `starts` (blocks,) of the blocks and their `factors` (`Spectrum.down_weight`).
    """

    band: Indices
    block: Indices
    starts: Indices
    factors: Array
    axes: Indices
    count: Array
    sensor: Array
    leak: Array
    blocks: int
    trims: Trims
    settings = DEFAULT

    def __init__(self, columns: Sequence[Column], low: Array, high: Array, scale: Array) -> None:
        """`low`, `high` and `scale` (N,) are of what is always there."""
        self.columns = {c.key: c for c in columns}
        self.parameters: dict[str, Indices] = {}
        self.offset: dict[str, int] = {}
        at = 1
        for c in columns:
            size = len(c.theta)
            self.parameters[c.key], self.offset[c.key] = np.arange(at, at + size), at + size
            at += size + 1
        self.always = np.arange(at, at + len(scale))
        self.low = self._of_all([c.low for c in columns], low)
        self.high = self._of_all([c.high for c in columns], high)
        self.scale = self._of_all([c.scale for c in columns], scale, first=1.0)
        self.place = self._of_all([c.sparse / c.per_place for c in columns], np.zeros(len(scale)))
        self.sparse = self.place > 0.0
        self.trims = Trims.none(len(self.scale))

    @property
    def within(self) -> Mask:
        """Which coefficients (K,) are not the mean of a block."""
        out = np.ones(len(self.block), dtype=bool)
        out[self.starts] = False
        return out

    def rows(self, *keys: str) -> Indices:
        """Of candidates: the parameters and the offset of each."""
        own = [row for key in keys for row in (*self.parameters[key], self.offset[key])]
        return np.array(own, dtype=np.intp)

    @staticmethod
    def _of_all(each: Sequence[Array], always: Array, first: float = 0.0) -> Array:
        """Of all quantities (Q,): `first` of what the model leaves and of every offset."""
        one = np.array([first])
        return np.concatenate([one, *(x for own in each for x in (own, one)), always])

    @property
    def products(self) -> Array:
        """Means over coefficients (bands, A, Q, Q)."""
        raise NotImplementedError

    def combined(self, weights: Array) -> Array:
        """Sum (K, A) of the coefficients of the quantities times these weights (Q,)."""
        raise NotImplementedError

    def calm(self, weights: Array) -> None:
        """Take weight off blocks of time in which these weights (Q,) leave far more than in others: not of fleets, of
        which every flight has lost it by itself.
        """  # noqa: D205

    def inexact(self, rows: Indices) -> Array:
        """Products (bands, A, R, R) of some quantities as far as no trim takes up what their laws are off by."""
        return self.products[:, :, rows[:, None], rows]

    def saturated(self, rounds: int = 3) -> tuple[Array, Array]:
        """What everything at once leaves, where the noise starts: mean squares (bands, A), and weights (Q,)."""
        unknown = np.concatenate([*self.parameters.values(), self.always]).astype(np.intp)
        trims, left = replace(self.trims, scale=0.5 * self.trims.scale), self.products[:, :, 0, 0]
        weights = np.zeros(self.scale.size)
        weights[0] = 1.0
        narrow = np.diag((0.5 * self.scale[unknown]) ** -2.0)
        for _ in range(rounds):
            variance = np.maximum(left, self.sensor)
            g = (1.0 / variance)[0, trims.axes]
            whole = np.tensordot(self.count / variance, self.products, axes=([0, 1], [0, 1]))
            whole = trims.eliminated_from(whole, g)
            weights[unknown] = -np.linalg.solve(whole[np.ix_(unknown, unknown)] + narrow, whole[unknown, 0])
            t = trims.likeliest(g, weights)
            left = np.maximum(trims.added_to(quadratic(self.products, weights), t, weights, self.count), 0.0)
        return left, weights


def quadratic(products: Array, weights: Array) -> Array:
    """The form w' P w (bands, axes) of products P (bands, axes, Q, Q) and weights (Q,). What numpy's indexing
    of the last two axes returns lies in memory with them in front; so it is read in that order.
    """  # noqa: D205
    inner = np.ascontiguousarray(products.transpose(2, 3, 0, 1))
    once = weights @ inner.reshape(len(weights), -1)
    return np.asarray(weights @ once.reshape(len(weights), -1)).reshape(products.shape[:2])
