"""Where a model fails: its residual as a function of what the vehicle was doing, one quantity or two at once.

For each quantity q (tilt, thrust, speed, ...) the samples are sorted into bins, and of each bin b this is told:

    mean, rms     of the residual r = W_meas - W_pred, per axis
    noise         rms of the sensor noise there
    share         max(0, sum_{k in b} r_k^2 - noise^2) / the same summed over all bins, against the share of time

per axis, and for the whole with newtons and newton metres on one scale (`Dataset.weights`). Two numbers say how much
of the error goes with the quantity; both are correlation ratios eta^2 (Fisher, "Statistical Methods for Research
Workers"), the share of a variance that lies between the bins:

    of the mean   sum_b n_b |w (mean_b - mean)|^2 / sum_k |w (r_k - mean)|^2       a systematic error
    of the size   the same for the energy e_k = |w r_k|^2                          larger here, whatever its sign

Chance alone gives eta^2 > 0, and more so when samples depend on each other. So the residual is rotated in time by a
random amount, cut into pieces about as long as the blocks of time of `Dataset`, put in random order within each flight,
and eta^2 computed again, many times. That keeps the dependence of neighbouring samples and the differences between
flights, and breaks the tie to q. Pieces differ in length (half to one and a half blocks), because a manoeuvre that
repeats with the length of a block would look the same in every order of equal pieces.

What is reported is the excess (eta^2 - E_0) / (1 - E_0) over the mean E_0 of chance, and p is corrected for having
looked at many quantities and axes: the share of random orders in which the largest standardised eta^2 of *any* of them
is at least this one's (Westfall and Young, "Resampling-Based Multiple Testing", 1993, max-T). Standardised is
artanh(eta), Fisher's transform, which is nearly normal under chance; otherwise slow quantities, whose chance is large
and skewed, would set the bar for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from wrenchgap.flight.flight import AXES, Array, Indices, Mask
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import length, means_by, weighted
from wrenchgap.learn.diagnose.quantities import Quantity, quantities


@dataclass(frozen=True)
class MapSettings:
    """How an error is mapped over one quantity."""

    bins: int = 8
    """Most bins of a quantity; sectors of 45 deg of an angle that wraps."""
    independent: float = 8.0
    """Fewest independent samples in a bin; sectors with fewer are put aside."""
    permutations: int = 400
    """Permutations of blocks by which chance is told."""


MAP = MapSettings()


@dataclass(frozen=True)
class Binned:
    """The residual by bins of one quantity. B bins, six axes.

    `low`, `high` (B,) in the quantity's unit; not a number for the samples at which the quantity has no meaning (no
    direction of tilt when level) or which are too few for a sector of their own; such a bin comes last.
    `samples` (B,), `time_share` (B,); `mean`, `rms`, `noise`, `share` (B, 6); `whole_rms`, `whole_noise` (B,) [N] and
    `whole_share` (B,) on the common scale.
    """

    low: Array
    high: Array
    samples: Indices
    time_share: Array
    mean: Array
    rms: Array
    noise: Array
    share: Array
    whole_rms: Array
    whole_noise: Array
    whole_share: Array

    def __len__(self) -> int:
        return len(self.low)


@dataclass(frozen=True)
class Dependence:
    """How the error goes with one quantity.

    `of_mean`, `of_size` are the shares of the variance of the residual and of its energy between the bins, beyond
    chance, on the common scale; `axes_mean` (6,) the first of them per axis. `p` is corrected for all quantities and
    axes; `axes` are those on which it is beyond chance by itself. `index` (K,) is the bin of each sample.
    """

    name: str
    label: str
    unit: str
    circular: bool
    binned: Binned
    of_mean: float
    of_size: float
    axes_mean: Array
    p: float
    axes: tuple[str, ...]
    index: Indices

    @property
    def significant(self) -> bool:
        """Whether chance would hardly do it."""
        return self.p < SIGNIFICANCE.level

    @property
    def score(self) -> float:
        """What the quantities are ranked by: the larger of the two shares."""
        return max(self.of_mean, self.of_size)


@dataclass(frozen=True)
class FailureMap:
    """Quantities, those first with which most of the error goes; a map over two; what the logs lack, with reasons.

    `cell` (K,) is that of each sample in the map, row by row; -1 where it is in none.
    """

    dependences: tuple[Dependence, ...]
    grid: Grid | None
    lacking: dict[str, str]
    cell: Indices

    @property
    def significant(self) -> tuple[Dependence, ...]:
        """Those beyond chance."""
        return tuple(d for d in self.dependences if d.significant)


def failure_map(data: Dataset, residual: Array, *, permutations: int = MAP.permutations, seed: int = 0) -> FailureMap:
    """Map a residual (K, 6), measured minus predicted, of `data`."""
    found, lacking = quantities(data)
    every = [(q, _bins(q, data)) for q in found]
    sorted_in = [(q, bins) for q, bins in every if bins is not None]
    lacking |= {q.name: "too few samples for two bins" for q, bins in every if bins is None}
    if not sorted_in:
        return FailureMap((), None, lacking, np.full(len(residual), -1))
    test = _Test(data, residual, [bins.index for _, bins in sorted_in])
    observed, p, beyond = test.run(permutations, np.random.default_rng(seed))
    dependences = [
        Dependence(
            q.name,
            q.label,
            q.unit,
            q.circular,
            _binned(data, residual, bins),
            float(observed[i, 0]),
            float(observed[i, 1]),
            observed[i, 2:],
            float(p[i]),
            tuple(axis for axis, sure in zip(AXES, beyond[i], strict=True) if sure),
            bins.index,
        )
        for i, (q, bins) in enumerate(sorted_in)
    ]
    dependences.sort(key=lambda d: (not d.significant, -d.score))
    grid, cell = error_grid(data, residual, found)
    return FailureMap(tuple(dependences), grid, lacking, cell)


@dataclass(frozen=True)
class _Bins:
    """`index` (K,) of each sample's bin, B where it is in none; edges (B,)."""

    index: Indices
    low: Array
    high: Array


def _bins(quantity: Quantity, data: Dataset) -> _Bins | None:
    """Bins of equal count, or sectors; samples of bins that hold too few are in none. None where there are no two."""
    values = quantity.values
    known = np.isfinite(values)
    fewest = MAP.independent / data.independence
    if quantity.circular:
        width = 360.0 / MAP.bins
        low = np.asarray(-180.0 + width * (np.arange(MAP.bins) - 0.5), dtype=np.float64)
        high = low + width
        index = np.floor((np.where(known, values, 0.0) - low[0]) % 360.0 / width).astype(np.intp)
    else:
        count = int(min(MAP.bins, known.sum() // fewest))
        if count < 2:
            return None
        edges = np.unique(np.quantile(values[known], np.linspace(0.0, 1.0, count + 1)))
        low, high = edges[:-1], edges[1:]
        index = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(low) - 1)
    index[~known] = len(low)
    counts = np.bincount(index, minlength=len(low) + 1)[: len(low)]
    kept = np.flatnonzero(counts >= fewest)
    if len(kept) + (len(index) - counts[kept].sum() >= fewest) < 2:
        return None
    place = np.full(len(low) + 1, len(kept))
    place[kept] = np.arange(len(kept))
    return _Bins(place[index], low[kept], high[kept])


def _binned(data: Dataset, residual: Array, bins: _Bins) -> Binned:
    rest = int((bins.index == len(bins.low)).any())
    count, edge = len(bins.low) + rest, np.full(rest, np.nan)
    samples = np.bincount(bins.index, minlength=count)
    noise = np.concatenate([np.broadcast_to(r.noise**2, (len(r), 6)) for r in data.records])
    mean, square, floor = (means_by(bins.index, values, count) for values in (residual, residual**2, noise))
    scale = data.weights**2
    excess = np.maximum(samples[:, None] * (square - floor), 0.0)
    whole = np.maximum(samples * weighted(square - floor, scale).sum(axis=1), 0.0)
    return Binned(
        np.concatenate((bins.low, edge)),
        np.concatenate((bins.high, edge)),
        samples,
        samples / samples.sum(),
        mean,
        np.sqrt(square),
        np.sqrt(floor),
        excess / np.maximum(excess.sum(axis=0), 1e-300),
        np.sqrt(weighted(square, scale).sum(axis=1)),
        np.sqrt(weighted(floor, scale).sum(axis=1)),
        whole / max(float(whole.sum()), 1e-300),
    )


class _Test:
    """Correlation ratios of all quantities (Q,) at once: of mean, of size, and of the mean of each axis: (Q, 8)."""

    def __init__(self, data: Dataset, residual: Array, indices: Sequence[Indices]) -> None:
        from scipy.sparse import csr_matrix  # here: others need not wait for it

        self.known = data.measured_axes
        scaled = weighted(residual, data.weights)
        series = np.column_stack((scaled, np.sum(scaled**2, axis=1)))
        self.series = series - series.mean(axis=0)
        self.total = np.sum(self.series**2, axis=0)
        self.flights = [np.flatnonzero(data.flight == f) for f in np.unique(data.flight)]
        self.piece = len(residual) / (int(data.block.max()) + 1)
        sizes = [int(i.max()) + 1 for i in indices]
        self.starts = np.cumsum([0, *sizes[:-1]])
        rows = np.concatenate([i + s for i, s in zip(indices, self.starts, strict=True)])
        columns = np.tile(np.arange(len(residual)), len(indices))
        self.sums = csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(sum(sizes), len(residual)))
        self.counts = np.maximum(np.asarray(self.sums.sum(axis=1)).ravel(), 1.0)

    def ratios(self, order: Indices | None = None) -> Array:
        """eta^2 (Q, 8) of the series, in another order where one is given."""
        series = self.series if order is None else self.series[order]
        between = (self.sums @ series) ** 2 / self.counts[:, None]
        by_quantity = np.add.reduceat(between, self.starts, axis=0)
        whole = by_quantity[:, :6].sum(axis=1) / max(float(self.total[:6].sum()), 1e-300)
        single = by_quantity / np.maximum(self.total, 1e-300)
        return np.column_stack((whole, single[:, 6], single[:, :6]))

    def order(self, rng: np.random.Generator) -> Indices:
        """Samples of each flight rotated, cut into pieces of random length, and these shuffled."""
        out = np.empty(len(self.series), dtype=np.intp)
        for rows in self.flights:
            turned = np.roll(rows, int(rng.integers(len(rows))))
            lengths = rng.uniform(0.5, 1.5, 1 + int(2 * len(rows) / self.piece)) * self.piece
            cuts = np.cumsum(lengths).astype(np.intp)
            pieces = np.split(turned, cuts[cuts < len(rows)])
            out[rows] = np.concatenate([pieces[i] for i in rng.permutation(len(pieces))])
        return out

    def run(self, count: int, rng: np.random.Generator) -> tuple[Array, Array, Mask]:
        """Shares beyond chance (Q, 8), corrected p (Q,), and whether each axis is beyond chance (Q, 6)."""
        chance = np.stack([self.ratios(self.order(rng)) for _ in range(count)])
        observed, centre = self.ratios(), chance.mean(axis=0)
        # Fisher's transform of eta, from eta^2
        transformed, found = (np.arctanh(np.sqrt(np.clip(eta2, 0.0, 1.0 - 1e-12))) for eta2 in (chance, observed))
        middle, spread = transformed.mean(axis=0), transformed.std(axis=0) + 1e-12
        largest = ((transformed - middle) / spread).max(axis=(1, 2))
        p = (1.0 + np.sum(largest[:, None, None] >= (found - middle) / spread, axis=0)) / (1.0 + count)
        share = np.maximum((observed - centre) / np.maximum(1.0 - centre, 1e-9), 0.0)
        share[:, 2:][:, ~self.known] = np.nan
        return share, p.min(axis=1), p[:, 2:] < SIGNIFICANCE.level


@dataclass(frozen=True)
class Grid:
    """Root mean square of the error over two quantities; (X, Y) cells, not a number where hardly flown.

    `x_edges` (X + 1,), `y_edges` (Y + 1,) in their units; `samples` (X, Y); `force`, `torque` (X, Y) the rms of the
    vectors [N, Nm]; `mean` (X, Y, 6). Cells of fewer than `fewest` independent samples are left empty.
    """

    x: str
    y: str
    x_label: str
    y_label: str
    x_edges: Array
    y_edges: Array
    samples: Indices
    force: Array
    torque: Array
    mean: Array
    fewest: ClassVar[float] = 4.0


def error_grid(
    data: Dataset, residual: Array, found: Sequence[Quantity], known: float = 0.2
) -> tuple[Grid | None, Indices]:
    """Tilt against its direction; where the vehicle hardly tilts (or that is not logged), thrust against rate; and the
    cell (K,) of each sample, -1 where it is in none.

    Tilt and its direction are mapped where they are `known` for this share of the time.
    """  # noqa: D205
    by_name = {q.name: q for q in found}
    pair = [by_name.get("tilt"), by_name.get("direction")]
    if any(q is None or np.isfinite(q.values).mean() < known for q in pair):
        pair = [by_name.get("thrust"), by_name.get("rate")]
    first, second = pair
    if first is None or second is None:
        return None, np.full(len(residual), -1)
    inside = np.isfinite(first.values) & np.isfinite(second.values)
    (x, x_edges), (y, y_edges) = (_sides(q, inside) for q in (first, second))
    shape = (len(x_edges) - 1, len(y_edges) - 1)
    size, every = shape[0] * shape[1], np.where(inside, x * shape[1] + y, -1)
    cell = every[inside]
    samples = np.bincount(cell, minlength=size)
    enough = samples >= Grid.fewest / data.independence
    values = np.column_stack((length(residual[:, :3]) ** 2, length(residual[:, 3:]) ** 2, residual))[inside]
    means = np.where(enough[:, None], means_by(cell, values, size), np.nan).reshape(*shape, 8)
    grid = Grid(
        first.name,
        second.name,
        f"{first.label} [{first.unit}]",
        f"{second.label} [{second.unit}]",
        x_edges,
        y_edges,
        samples.reshape(shape),
        np.sqrt(means[..., 0]),
        np.sqrt(means[..., 1]),
        means[..., 2:],
    )
    return grid, every


def _sides(quantity: Quantity, inside: Mask, sectors: int = 8, cells: int = 6) -> tuple[Indices, Array]:
    """Bins of equal width along one side of the map: `cells`, of an angle `sectors`, the first about +-180 deg."""
    values = np.where(inside, quantity.values, 0.0)
    if quantity.circular:
        edges = np.linspace(-180.0 - 180.0 / sectors, 180.0 - 180.0 / sectors, sectors + 1)
        values = (values - edges[0]) % 360.0 + edges[0]
    else:
        edges = np.linspace(values[inside].min(), values[inside].max(), cells + 1)
    index = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    return index, edges
