"""The numbers of a quantity out of the fields of a topic, and in which frame they are.

The frame of a velocity, rate or acceleration is asked of the pose, whose derivative it is (`best_frame`).
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from wrenchgap.flight.errors import LogError
from wrenchgap.flight.filters import smooth
from wrenchgap.flight.flight import Array, Mask
from wrenchgap.flight.formats import Table
from wrenchgap.flight.roles import PART_QUANTITY, Source
from wrenchgap.flight.row_kernels import empty
from wrenchgap.flight.stamps import away_from_gaps, spread

VECTORS: dict[str, tuple[str, ...]] = {
    "wrench": ("force.x", "force.y", "force.z", "torque.x", "torque.y", "torque.z"),
    "imu": tuple(f"{name}.{axis}" for name in ("angular_velocity", "linear_acceleration") for axis in "xyz"),
    **dict.fromkeys(("gyroscope", "accelerometer"), ("x", "y", "z")),
    "pose": (*(f"position.{axis}" for axis in "xyz"), *(f"orientation.{axis}" for axis in "xyzw")),
    **dict.fromkeys(
        ("twist", "acceleration"), tuple(f"{name}.{axis}" for name in ("linear", "angular") for axis in "xyz")
    ),
}
"""Fields of a quantity, in the order of its columns."""


def vector(table: Table, source: Source, quantity: str, where: str = "log") -> Array:
    """A quantity's numbers (N, K) from a table: the columns of an array, or the named fields of a message."""
    array = table.columns.get(source.field)
    if array is not None:
        values = np.asarray(array, dtype=float).reshape(len(table), -1)
        chosen = values if source.columns is None else values[:, list(source.columns)]
        expected = len(VECTORS.get(quantity, ())) or (1 if quantity == "voltage" else chosen.shape[1])
        if chosen.shape[1] != expected:
            raise LogError(f"{where}: {source} gives {chosen.shape[1]} columns, but a {quantity} has {expected}")
        return chosen
    prefix = f"{source.field}." if source.field else ""
    names = [prefix + name for name in VECTORS.get(quantity, ())]
    if quantity == "pose" and names[0] not in table.columns:
        names = [name.replace("position.", "translation.").replace("orientation.", "rotation.") for name in names]
    missing = [name for name in names if name not in table.columns]
    if missing or not names:
        raise LogError(f"{where}: {source.topic} ({table.type}) has no field {(missing or [source.field])[0]!r}")
    for name in names:
        if (values := table.columns[name]).ndim != 1 or values.dtype.kind not in "iufb":
            raise LogError(f"{where}: {source.topic} ({table.type}): field {name!r} is not one number in each message")
    return np.stack([np.asarray(table.columns[name], dtype=float) for name in names], axis=1)


def empty_columns(values: Array, name: str) -> list[int]:
    """Columns that the log leaves empty (all NaN): of a twist or acceleration a half, of an IMU any axis."""
    if PART_QUANTITY[name] == "imu":
        return np.flatnonzero(empty(values)).tolist()
    if PART_QUANTITY[name] not in ("twist", "acceleration"):
        return []
    none = empty(values)
    return [i for half in (range(3), range(3, 6)) if none[list(half)].all() for i in half]


def sound_rows(values: Array, absent: Sequence[int], absurd_from: float = 1e12) -> tuple[Mask, Mask]:
    """Rows (N,) of values (N, K) that are numbers but for `absent` columns, and those that are absurd numbers.

    No quantity of a flight is as large in SI: a damaged sample.
    """
    finite, absurd = np.ones(len(values), dtype=bool), np.zeros(len(values), dtype=bool)
    within = values.size and values.min() >= -absurd_from and values.max() <= absurd_from  # not if one is no number
    if absent or not within:
        for column in (values[:, k] for k in range(values.shape[1]) if k not in absent):  # hours are long
            finite &= np.isfinite(column)
            absurd |= np.abs(column) > absurd_from
    return finite, absurd & finite


Rows = Callable[[slice], Array]
"""Some rows of a quantity."""
Slope = Callable[[Array, slice], Array]
"""A derivative at the times of some rows."""


def in_other_axes(values: Array, matrix: Array) -> Array:
    """Vectors (N, 3) in other axes; as they are where these are their own."""
    return values if np.array_equal(matrix, np.eye(3)) else np.asarray(values @ matrix.T)


def slope_of(values: Array) -> Slope:
    """The derivative of values (N, C) at the times of some of their rows."""
    return lambda time, rows: smooth(time, values[rows], derivative=1)


def best_frame(
    readings: Mapping[str, Rows], truth: Slope, time: Array, default: str, rows: int = 12_000, run: int = 4_000
) -> tuple[str, dict[str, float]]:
    """The frame whose reading fits a derivative: `default` unless another is clearly better; and the rms misfits.

    Of a long flight, so many `rows` are compared, in runs of `run` that are spread over it. `time` (N,) [s] is that of
    all rows.
    """
    squares: dict[str, list[float]] = {frame: [] for frame in readings}
    sizes: list[float] = []
    for some in spread(len(time), rows, run):
        part = time[some]
        inside = away_from_gaps(part)
        expected = truth(part, some)[inside]
        sizes.append(float(np.mean(expected**2)))
        for frame, values in readings.items():
            squares[frame].append(float(np.mean((smooth(part, values(some))[inside] - expected) ** 2)))
    misfit = {frame: float(np.sqrt(np.mean(found))) for frame, found in squares.items()}
    best = min(misfit, key=lambda frame: misfit[frame])
    scale = float(np.sqrt(np.mean(sizes)))
    better = misfit[best] < 0.5 * misfit[default] and misfit[default] > 0.03 * scale
    return best if better else default, misfit
