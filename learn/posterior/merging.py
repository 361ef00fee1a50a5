"""Evidence of many flights merged: what a search over sets asks of a spectrum, with the flights' trims eliminated.

Products add up over flights; so do counts, the sensors' shapes and powers (`learn.posterior.evidence`). A flight's trim
t on an axis enters through the sums s = sum_k c_k q_k and N = sum_k c_k^2 alone, c_k its coefficients and q_k the
quantities. With weights w of the quantities, g the precision of a coefficient and sigma the trim's size,

    t = -g s.w / (g N + sigma^-2)             the likeliest trim
    -g^2 (s.w)^2 / (g N + sigma^-2)           what it takes off g |C w|^2
    -1/2 log(1 + g N sigma^2)                 its Occam factor

so thousands of flights cost sums, and no unknowns. Source: the Schur complement of a block-arrow matrix, Golub and Van
Loan, "Matrix Computations", 4th ed., 4.5. The limits of trims (`learn.identify.bias_and_trim.trim_of`, five standard
deviations) are not enforced here.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.evidence import BANDS, Evidence
from wrenchgap.learn.posterior.spectrum import leaking


@dataclass(frozen=True)
class Trims:
    """Sums (F, A, Q) and squares (F, A) of the trims of F flights on axes (A,); their standard deviations (A,)."""

    sums: Array
    squares: Array
    axes: NDArray[np.intp]
    scale: Array

    def of(self, rows: NDArray[np.intp], flight: int | None = None) -> Trims:
        """Of these quantities (R,) alone, and of one flight alone where one is named."""
        some = slice(None) if flight is None else slice(flight, flight + 1)
        return Trims(self.sums[some][:, :, rows], self.squares[some], self.axes, self.scale)

    def precision(self, g: Array, scale: Array) -> Array:
        """Of the trims (F, A), at precisions (A,) of a coefficient."""
        return np.asarray(g * self.squares + scale**-2.0)

    def likeliest(self, g: Array, weights: Array, scale: Array) -> Array:
        """Trims (F, A) at these weights (Q,), in the sign in which they add to what is left."""
        return np.asarray(-g * (self.sums @ weights) / self.precision(g, scale))

    def eliminated(self, g: Array, scale: Array) -> Array:
        """What they take off the products (Q, Q) that g weighs."""
        flights, axes, q = self.sums.shape
        rows = (self.sums * (g / np.sqrt(self.precision(g, scale)))[:, :, None]).reshape(flights * axes, q)
        return np.asarray(rows.T @ rows)

    def occam(self, g: Array, scale: Array) -> float:
        """Log of what the integral over them adds, without the prior at the likeliest ones."""
        return -0.5 * float(np.sum(np.log1p(g * self.squares * scale**2)))

    def squares_left(self, trims: Array, weights: Array) -> Array:
        """What trims (F, A) add to the sums of squares of what is left, by flight and axis (F, A)."""
        return np.asarray(2.0 * trims * (self.sums @ weights) + trims**2 * self.squares)


class FleetSpectrum:
    """Merged evidence in the shape of `learn.posterior.spectrum.Spectrum`; bands without a coefficient are left out.

    Quantities are the residual, columns and the model's uncertain effects; `always` are those last ones, trims are in
    `trims`. `flights` and `seconds` are their names and lengths, in the order of merging.
    """

    def __init__(
        self, parts: Sequence[Evidence] | Iterable[Evidence], keys: Sequence[str], axes: Sequence[int]
    ) -> None:
        self.keys, self.axes = tuple(keys), np.array(axes, dtype=np.intp)
        self.flights: list[str] = []
        self.seconds: list[float] = []
        self.blocks = 0
        sums, squares = [], []
        first: Evidence | None = None
        for one in parts:
            rows, at = self._chosen(one)
            products = products_of(one, rows, at)
            if first is None:
                first, self._products = one, np.zeros_like(products)
                count, power, shapes = np.zeros(BANDS), np.zeros((BANDS, len(at))), np.zeros((BANDS, 2))
                noise, total = np.zeros(len(AXES)), 0.0
            self._products += products
            count, power, shapes = count + one.count, power + one.power[:, at], shapes + one.shapes
            noise, total = noise + one.count.sum() * np.nan_to_num(one.noise) ** 2, total + one.count.sum()
            trimmed = [list(one.axes[one.trim_axes]).index(a) for a in self._trim_axes(one)]
            sums.append(one.trimmed[trimmed][:, rows])
            squares.append(one.trims[trimmed])
            self.flights.append(one.flight)
            self.seconds.append(one.seconds)
            self.blocks += one.blocks
        if first is None:
            raise FitError("no flight to rank effects on: every log of this vehicle failed")
        self._index(first)
        self.bands = np.flatnonzero(count)
        self.count = np.repeat(count[self.bands, None], len(self.axes), axis=1)
        self.products = self._products[self.bands] / self.count[:, :, None, None]
        del self._products
        on = self._trim_axes(first)
        scale = first.trim_scale[[list(first.axes[first.trim_axes]).index(a) for a in on]]
        where = np.searchsorted(self.axes, on).astype(np.intp)
        self.trims = Trims(np.array(sums), np.array(squares), where, scale)
        self.leak = leaking(power[self.bands] / self.count, self.axes)
        self.sensor = self._sensor(shapes, count, noise / total)

    def _trim_axes(self, one: Evidence) -> list[int]:
        return [int(a) for a in one.axes[one.trim_axes] if a in self.axes]

    def _chosen(self, one: Evidence) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows of a flight's quantities that are merged, and its axes."""
        return chosen_rows(one, self.keys), np.array([list(one.axes).index(a) for a in self.axes], dtype=np.intp)

    def _index(self, first: Evidence) -> None:
        """Where each column's parameters and offset are, and limits and sizes of all quantities."""
        by_key = {c.key: c for c in first.columns}
        self.columns: dict[str, Column] = {k: by_key[k] for k in self.keys}
        self.parameters: dict[str, NDArray[np.intp]] = {}
        self.offset: dict[str, int] = {}
        at = 1
        for key, c in self.columns.items():
            size = len(c.theta)
            self.parameters[key], self.offset[key] = np.arange(at, at + size), at + size
            at += size + 1
        known = first.known
        self.always = np.arange(at, at + sum(len(c.theta) for c in known))
        nothing, one = np.zeros(1), np.ones(1)
        columns = list(self.columns.values())
        self.low = np.concatenate([nothing, *(x for c in columns for x in (c.low, nothing)), *(c.low for c in known)])
        self.high = np.concatenate(
            [nothing, *(x for c in columns for x in (c.high, nothing)), *(c.high for c in known)]
        )
        self.scale = np.concatenate([one, *(x for c in columns for x in (c.scale, one)), *(c.scale for c in known)])
        no = np.zeros(1, dtype=bool)
        sparse = [no, *(x for c in columns for x in (c.sparse, no)), *(c.sparse for c in known)]
        self.sparse = np.concatenate(sparse)

    def _sensor(self, shapes: Array, count: Array, noise: Array) -> Array:
        """Variance (bands, axes) of a coefficient from sensors alone, as `learn.posterior.spectrum.sensor_spectrum`."""
        mean = shapes.sum(axis=0) / count.sum()
        of_band = (shapes[self.bands] / count[self.bands, None] / mean)[:, [0, 0, 0, 1, 1, 1]]
        return np.asarray(np.maximum((of_band * noise)[:, self.axes], 1e-30))


def chosen_rows(one: Evidence, keys: Sequence[str]) -> NDArray[np.intp]:
    """Rows of a flight's quantities: what is left, the columns of `keys` with their offsets, what is known."""
    at, start = 1, {}
    for c in one.columns:
        start[c.key] = np.arange(at, at + len(c.theta) + 1)
        at += len(c.theta) + 1
    known = np.arange(at, at + sum(len(c.theta) for c in one.known))
    return np.concatenate([np.zeros(1, dtype=np.intp), *(start[k] for k in keys), known]).astype(np.intp)


def products_of(one: Evidence, rows: NDArray[np.intp], axes: NDArray[np.intp]) -> Array:
    """Sums of products (bands, L, Q, Q) of a flight's quantities `rows` (Q,) on its `axes` (L,)."""
    out = np.zeros((BANDS, len(axes), len(rows), len(rows)))
    ends = np.cumsum([0, *one.rows])
    for band in range(BANDS):
        for k, axis in enumerate(axes):
            root = one.roots[axis, ends[band] : ends[band + 1]][:, rows]
            out[band, k] = root.T @ root
    return out
