"""The error over two quantities at once, as a map of cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import length
from wrenchgap.learn.diagnose.quantities import Quantity

Indices = NDArray[np.intp]


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
    samples: NDArray[np.intp]
    force: Array
    torque: Array
    mean: Array
    fewest: ClassVar[float] = 4.0


def error_grid(data: Dataset, residual: Array, found: Sequence[Quantity], known: float = 0.2) -> Grid | None:
    """Tilt against its direction; where the vehicle hardly tilts (or that is not logged), thrust against rate.

    Tilt and its direction are mapped where they are `known` for this share of the time.
    """
    by_name = {q.name: q for q in found}
    pair = [by_name.get("tilt"), by_name.get("direction")]
    if any(q is None or np.isfinite(q.values).mean() < known for q in pair):
        pair = [by_name.get("thrust"), by_name.get("rate")]
    first, second = pair
    if first is None or second is None:
        return None
    inside = np.isfinite(first.values) & np.isfinite(second.values)
    (x, x_edges), (y, y_edges) = (_sides(q, inside) for q in (first, second))
    shape = (len(x_edges) - 1, len(y_edges) - 1)
    cell = (x * shape[1] + y)[inside]
    size = shape[0] * shape[1]
    samples = np.bincount(cell, minlength=size)
    enough = samples >= Grid.fewest / data.independence

    def mean_of(values: Array) -> Array:
        sums = np.bincount(cell, weights=values[inside], minlength=size)
        return np.where(enough, sums / np.maximum(samples, 1), np.nan).reshape(shape)

    return Grid(
        first.name,
        second.name,
        f"{first.label} [{first.unit}]",
        f"{second.label} [{second.unit}]",
        x_edges,
        y_edges,
        samples.reshape(shape),
        np.sqrt(mean_of(length(residual[:, :3]) ** 2)),
        np.sqrt(mean_of(length(residual[:, 3:]) ** 2)),
        np.stack([mean_of(column) for column in residual.T], axis=2),
    )


def _sides(quantity: Quantity, inside: NDArray[np.bool_], sectors: int = 8, cells: int = 6) -> tuple[Indices, Array]:
    """Bins of equal width along one side of the map: `cells`, of an angle `sectors`, the first about +-180 deg."""
    values = np.where(inside, quantity.values, 0.0)
    if quantity.circular:
        edges = np.linspace(-180.0 - 180.0 / sectors, 180.0 - 180.0 / sectors, sectors + 1)
        values = (values - edges[0]) % 360.0 + edges[0]
    else:
        edges = np.linspace(values[inside].min(), values[inside].max(), cells + 1)
    index = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    return index, edges
