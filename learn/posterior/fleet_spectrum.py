"""Evidence of many flights merged: what a search over sets asks of a spectrum, with the flights' trims eliminated.

Products add up over flights; so do counts, the sensors' shapes and powers (`learn.posterior.flight_evidence`). Trims
are eliminated (`learn.posterior.linear_problem`).
"""

from collections.abc import Iterable, Sequence

import numpy as np

from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import AXES, Array, Indices
from wrenchgap.learn.posterior.flight_evidence import BANDS, Evidence
from wrenchgap.learn.posterior.linear_problem import LinearProblem, Trims
from wrenchgap.learn.posterior.spectrum import leaking


class FleetSpectrum(LinearProblem):
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
            rows, at = chosen_rows(one, self.keys), chosen_axes(one, self.axes)
            products = products_of(one, rows, at)
            if first is None:
                first, summed = one, np.zeros_like(products)
                count, shapes = np.zeros(BANDS), np.zeros((BANDS, 2))
                power, usable, error = np.zeros((3, BANDS, len(at)))
                noise, total = np.zeros(len(AXES)), 0.0
            summed += products
            count, power, shapes = count + one.count, power + one.power[:, at], shapes + one.shapes
            usable, error = usable + one.usable[:, at], error + one.error[:, at]
            noise, total = noise + one.count.sum() * np.nan_to_num(one.noise) ** 2, total + one.count.sum()
            trimmed = [list(one.axes[one.trim_axes]).index(a) for a in self._trim_axes(one)]
            sums.append(one.trimmed[trimmed][:, rows])
            squares.append(one.trims[trimmed])
            self.flights.append(one.flight)
            self.seconds.append(one.seconds)
            self.blocks += one.blocks
        if first is None:
            raise FitError("no flight to rank effects on: every log of this vehicle failed")
        by_key = {c.key: c for c in first.columns}
        always = [
            np.concatenate([np.zeros(0), *(getattr(c, of) for c in first.known)]) for of in ("low", "high", "scale")
        ]
        super().__init__([by_key[k] for k in self.keys], *always)
        self.bands = np.flatnonzero(count)
        self.count = usable[self.bands]
        self._products = summed[self.bands] / np.maximum(self.count, 1.0)[:, :, None, None]
        on = self._trim_axes(first)
        scale = first.trim_scale[[list(first.axes[first.trim_axes]).index(a) for a in on]]
        where = np.searchsorted(self.axes, on).astype(np.intp)
        self.trims = Trims(np.array(sums), np.array(squares), where, scale)
        self.leak = leaking(power[self.bands] / count[self.bands, None], self.axes, self.settings.leak)
        self.leak += error[self.bands] / np.maximum(self.count, 1.0)
        mean = shapes.sum(axis=0) / count.sum()  # of a coefficient from sensors alone, as `spectrum.sensor_spectrum`
        of_band = (shapes[self.bands] / count[self.bands, None] / mean)[:, [0, 0, 0, 1, 1, 1]]
        self.sensor = np.maximum((of_band * noise / total)[:, self.axes], 1e-30)

    @property
    def products(self) -> Array:
        """Means over coefficients (bands, A, Q, Q)."""
        return self._products

    def _trim_axes(self, one: Evidence) -> list[int]:
        return [int(a) for a in one.axes[one.trim_axes] if a in self.axes]


def chosen_axes(one: Evidence, axes: Indices) -> Indices:
    """Where a flight has these axes."""
    return np.array([list(one.axes).index(a) for a in axes], dtype=np.intp)


def chosen_rows(one: Evidence, keys: Sequence[str]) -> Indices:
    """Rows of a flight's quantities: what is left, the columns of `keys` with their offsets, what is known."""
    at, start = 1, {}
    for c in one.columns:
        start[c.key] = np.arange(at, at + len(c.theta) + 1)
        at += len(c.theta) + 1
    known = np.arange(at, at + sum(len(c.theta) for c in one.known))
    return np.concatenate([np.zeros(1, dtype=np.intp), *(start[k] for k in keys), known]).astype(np.intp)


def products_of(one: Evidence, rows: Indices, axes: Indices) -> Array:
    """Sums of products (bands, L, Q, Q) of a flight's quantities `rows` (Q,) on its `axes` (L,)."""
    out = np.zeros((BANDS, len(axes), len(rows), len(rows)))
    ends = np.cumsum([0, *one.rows])
    for band in range(BANDS):
        for k, axis in enumerate(axes):
            root = one.roots[axis, ends[band] : ends[band + 1]][:, rows]
            out[band, k] = root.T @ root
    return out
