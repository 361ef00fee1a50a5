"""Flights of a fleet one by one: how likely each is under a set of effects, and what all others predict of it.

Flights, and not blocks of time, are what is held out: theta without flight f solves (A - A_f) theta = b - b_f, so
predicting every flight from all others takes no second look at any log. The trim of a flight is its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.posterior import kernels
from wrenchgap.learn.posterior.fleet_spectrum import FleetSpectrum, chosen_rows, products_of
from wrenchgap.learn.posterior.flight_evidence import Evidence
from wrenchgap.learn.posterior.linear_problem import quadratic
from wrenchgap.learn.posterior.score import Scored, Scorer, SetRows


class FittedSet:
    """The least squares of one set on all flights, at the noise that it leaves; trims are eliminated."""

    def __init__(self, scorer: Scorer, scored: Scored) -> None:
        self.rows = SetRows(scorer.spectrum, scored.keys)
        self.weights = scored.weights[self.rows.every]
        self.sizes = scored.sizes
        self.g = scorer.share / scored.variance
        self.off = scored.doubt**2 * scored.inexact + scorer.spectrum.leak
        self.log = scorer.share * np.log(scored.variance)
        self.whole = self.rows.weighed(scorer.count / scored.variance, self.g[0, self.rows.trims.axes])

    def left(self, products: Array, flight: int, weights: Array) -> Array:
        """Sums of squares (bands, L) that weights (R,) leave of one flight, its own trim taken out."""
        trims = self.rows.trims.of(flight=flight)
        likeliest = trims.likeliest(self.g[0, trims.axes], weights, trims.scale)
        return np.maximum(trims.added_to(quadratic(products, weights), likeliest, weights, np.ones_like(self.g)), 0.0)

    def log_likelihood(self, left: Array, count: Array) -> float:
        """Of a flight of which the set leaves these sums of squares (bands, L), of `count` (bands, L)."""
        return -0.5 * float(np.sum(self.g * (left + self.off * count) + self.log * count))

    def without(self, products: Array, flight: int) -> Array:
        """Weights (R,) of the quantities that all other flights give."""
        trims = self.rows.trims.of(flight=flight)
        own = np.tensordot(self.g, products, axes=([0, 1], [0, 1]))
        theirs = self.whole - trims.eliminated_from(own, self.g[0, trims.axes], trims.scale)
        size, out = len(self.sizes), self.weights.copy()
        A, b = np.ascontiguousarray(theirs[:size, :size]), theirs[:size, size:] @ out[size:]
        out[:size] = -kernels.bounded(A, b, self.rows.low, self.rows.high, self.sizes)
        return out

    def deviations(self) -> dict[str, Array]:
        """Standard deviations by column: the width of the posterior at the noise that the set leaves."""
        size = len(self.sizes)
        curvature = self.whole[:size, :size] + np.diag(self.sizes**-2.0)
        return self.rows.by_column(np.sqrt(np.diag(np.linalg.inv(curvature))))


def by_flight(
    scorer: Scorer, space: FleetSpectrum, sets: Sequence[Scored], parts: Iterable[Evidence], *, held_out: bool
) -> tuple[Array, Array, Array]:
    """Log likelihoods (S, F) of each flight under each set; the same predicted; sums of squares (S, L) that are left.

    `held_out` predicts a flight with the parameters that all others give.
    """
    fitted = [FittedSet(scorer, s) for s in sets]
    likelihood, predicted = np.empty((2, len(sets), len(space.flights)))
    squares = np.zeros((len(sets), len(space.axes)))
    for f, one in enumerate(parts):
        at = np.array([list(one.axes).index(a) for a in space.axes], dtype=np.intp)
        products = products_of(one, chosen_rows(one, space.keys), at)[space.bands]
        count = one.usable[space.bands][:, at]
        for k, each in enumerate(fitted):
            own = products[:, :, each.rows.every[:, None], each.rows.every]
            left = each.left(own, f, each.weights)
            likelihood[k, f] = each.log_likelihood(left, count)
            if held_out:
                left = each.left(own, f, each.without(own, f))
            predicted[k, f] = each.log_likelihood(left, count)
            squares[k] += (left * (count > 0.0)).sum(axis=0)
    return likelihood, predicted, squares
