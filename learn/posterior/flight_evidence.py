"""What one flight says about all candidates, kept small enough to be stored, and exact enough to be merged.

A search over sets (`learn.posterior.subset_search`) needs of the flights only products of linear columns, by band of
frequency and axis. Where the columns of two flights are derivatives at the same values, the products of both together
are their sum: ranking a fleet costs one pass over each log, and leaving a flight out is a subtraction. So columns are
linearised at declared values (`declared`), the same for every flight, and not where they fit one flight best.

Products P = C'C of coefficients C (n, Q) are kept as a root R with R'R = P: C itself where it has few rows, else the
triangle of its QR decomposition; that takes min(n, Q) Q numbers for a band and axis, and loses no digits to squaring.
Trims (`learn.identify.bias_and_trim`) are unknowns of each flight, and enter through one sum a flight
(`Evidence.trimmed`).
"""

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wrenchgap.flight.errors import FitError, ModelError
from wrenchgap.flight.flight import AXES, Array, Indices
from wrenchgap.flight.repeats import signature
from wrenchgap.learn.data.archive import DAMAGED, check_sizes, line, numbers
from wrenchgap.learn.data.candidates import candidates, inapplicable, unexcited
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.data.errors import sums_by
from wrenchgap.learn.data.input_errors import EDGES
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.data.sensor_noise import coefficient_shapes
from wrenchgap.learn.diagnose.timing import answering_axes, timing_of
from wrenchgap.learn.identify.air import companions
from wrenchgap.learn.identify.bias_and_trim import trim_of
from wrenchgap.learn.identify.least_squares import Problem, left_by
from wrenchgap.learn.posterior.columns import Column, away_from_zero, given_values, linearised
from wrenchgap.learn.posterior.single_effects import uncertain_effects
from wrenchgap.learn.posterior.spectrum import Spectrum, transformed
from wrenchgap.plant.effects import acting_effects, catalogue, find
from wrenchgap.plant.model import Model

BANDS = len(EDGES) + 1
"""Bands of frequency, whether a flight has coefficients in all of them or not."""
FORMAT = 3
"""Version of what `packed` writes."""
LARGEST_HEAD = 2**24
"""Bytes of the part that is text; that of all effects is 44 kB."""

Points = Mapping[str, Sequence[float]]
"""Values (P,) at which candidates are linearised, by `Column.key`, where these are not the declared ones."""


@dataclass(frozen=True)
class Evidence:
    """Of one flight; L axes, Q quantities: what the model leaves, parameters and offset of each column, known effects.

    `columns` and `known` (the model's own uncertain effects) have no samples. `roots` (L, N, Q) are the roots of all
    bands below one another, `rows` (bands,) how many belong to each. `count` (bands,) are coefficients, `usable`
    (bands, L) those that say something of the vehicle, `error` (bands, L) the sum of squares that their commands may
    err by, `power` (bands, L) the sum of squares of what the model leaves, `shapes` (bands, 2) those of the sensor
    noise of forces and torques, `noise` (6,) [N, Nm]. `trimmed` (A, Q) are the sums of each of A trims times the
    quantities, `trims` (A,) of the trims squared, `trim_axes` (A,) out of L. `unexcited` names what this flight alone
    would not try. `signature` (up to 256,) tells the flight from others by its samples (`flight.repeats.signature`).
    """

    flight: str
    seconds: float
    blocks: int
    axes: Indices
    columns: tuple[Column, ...]
    known: tuple[Column, ...]
    roots: Array
    rows: Indices
    count: Array
    usable: Array
    power: Array
    error: Array
    shapes: Array
    noise: Array
    trimmed: Array
    trims: Array
    trim_axes: Indices
    trim_scale: Array
    calmed: int
    answering: tuple[int, ...]
    unexcited: tuple[str, ...]
    signature: Indices

    @property
    def keys(self) -> tuple[str, ...]:
        """Of the columns."""
        return tuple(c.key for c in self.columns)


def evidence(flight: OpenFlight, model: Model, names: Sequence[str] = (), points: Points | None = None) -> Evidence:
    """What a flight says about `names`, by default the catalogue.

    Commands that answer the motion, and blocks of time that are far louder than others, are seen to flight by flight.
    Raises ModelError for unknown names, FitError for a flight that is too short or allows none of the effects.
    """
    answering = answering_axes([timing_of(flight, model)])
    data = dataset(flight.records, model, answering)
    chosen, idle = _names(data, model, names)
    columns = declared(data, model, chosen, points)
    if not columns:
        raise FitError(f"{flight.flight.name}: no effect can be tried on this flight")
    found = evidence_of(data, model, columns, uncertain_effects(data, model), idle)
    return replace(found, signature=signature(flight.flight))


def _names(data: Dataset, model: Model, names: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Effects that have columns here, and which of them this flight alone would not try. A flight that does not excite
    an effect says little about it, and that little is merged all the same.
    """  # noqa: D205
    tried = candidates(data.records, model, names).tried
    possible = [n for n in (names or catalogue()) if inapplicable(n, model, data.records) is None]
    idle = [n for n in possible if n not in tried and unexcited(n, model, data.records) is not None]
    idle = [n for n in idle if find(n).known(model.vehicle) is None]
    present = [e.name for e in model.effects]
    acting = acting_effects([n for n in possible if n in tried or n in idle], present)
    return tuple(n for n in possible if n in acting), tuple(n for n in acting if n in idle)


def declared(data: Dataset, model: Model, names: Sequence[str], points: Points | None = None) -> list[Column]:
    """Columns linearised at `points`, else at the model's values, else at the start values of their parameters.

    A derivative at no lag at all says nothing of lags: where a parameter starts away from zero, it is linearised at its
    typical size at least. Effects that the model refuses there are left out.
    """
    base = left_by(data, model)
    own = tuple(e.name for e in model.effects)
    single = [n for n in names if n in acting_effects([n], own)]
    out = []
    for added in [s for n in single for s in ((n,), *((n, other) for other in companions(n, own, names)))]:
        problem = Problem(data, model, added)
        part, key = slice(0, problem.size), " + ".join(added)
        try:
            x = problem.start(None).x.copy()
            away_from_zero([p for _, p in problem.parameters], x)
            if points and key in points:
                x[part] = np.clip(points[key], problem.low[part], problem.high[part])
            out.append(linearised(problem, given_values(model, added), base, problem.at(x)))
        except ModelError:  # an inertia that no body has, say
            continue
    return out


def evidence_of(
    data: Dataset, model: Model, columns: Sequence[Column], known: Sequence[Column] = (), idle: Sequence[str] = ()
) -> Evidence:
    """The evidence of one flight's data on these columns."""
    trim = trim_of(model)
    base = left_by(data, model)
    space = Spectrum(data, base, columns, trim, known)
    space.calm(space.saturated()[1])
    trims, axes = space.always[: len(trim.axes)], space.axes
    here = np.flatnonzero(data.measured_axes[trim.axes])
    where = np.searchsorted(axes, trim.axes[here])
    kept = np.setdiff1d(np.arange(space.low.size), trims)
    constant, band = space.hertz == 0.0, np.digitize(space.hertz, EDGES)
    levels = [space.coefficients[constant, at, trims[k]] for k, at in zip(here, where, strict=True)]
    sums = [a @ space.coefficients[constant, at][:, kept] for a, at in zip(levels, where, strict=True)]
    roots = [_roots(space.coefficients[band == k][:, :, kept]) for k in range(BANDS)]
    given = transformed(data.records, base[:, axes], space.settings.block)[0]
    shapes = coefficient_shapes(space.hertz, band, data.records[0].cutoff_hz)
    return Evidence(
        flight=data.records[0].flight,
        seconds=float(sum(len(r) * r.dt_kept for r in data.records)),
        blocks=space.blocks,
        axes=axes,
        columns=tuple(c.without_samples() for c in columns),
        known=tuple(c.without_samples() for c in known),
        roots=np.concatenate(roots, axis=1),
        rows=np.array([r.shape[1] for r in roots]),
        count=np.bincount(band, minlength=BANDS).astype(float),
        usable=sums_by(band, ~space.silent, BANDS),
        power=sums_by(band, given**2, BANDS),
        error=sums_by(band, space.error * ~space.silent, BANDS),
        shapes=sums_by(band, shapes, BANDS),
        noise=data.noise,
        trimmed=np.array(sums).reshape(len(here), len(kept)),
        trims=np.array([float(a @ a) for a in levels]),
        trim_axes=where,
        trim_scale=trim.scale[here],
        calmed=int(np.sum(space.factors < 1.0)),
        answering=data.answering,
        unexcited=tuple(idle),
        signature=np.empty(0, dtype=np.int64),
    )


def _roots(coefficients: Array) -> Array:
    """R (L, min(n, Q), Q) with R'R = C'C of coefficients C (n, L, Q), axis by axis."""
    n, _, q = coefficients.shape
    by_axis = np.moveaxis(coefficients, 1, 0)
    return by_axis if n <= q else np.asarray(np.linalg.qr(by_axis, mode="r"))


def packed(found: Evidence) -> bytes:
    """As bytes: numbers in an npz archive, without code."""
    arrays = {k: v for k, v in vars(found).items() if isinstance(v, np.ndarray)}
    about = {k: v for k, v in vars(found).items() if k not in arrays and k not in ("columns", "known")}
    lines = {name: [_plain(c) for c in getattr(found, name)] for name in ("columns", "known")}
    head = json.dumps({"format": FORMAT, **about, **lines})
    with io.BytesIO() as stream:
        members: dict[str, Any] = {"head": np.array(head), **arrays}
        np.savez_compressed(stream, **members)
        return stream.getvalue()


def unpacked(content: bytes | None, where: str = "stored evidence") -> Evidence:
    """From `packed`; raises FitError, which begins with `where`, for anything else."""
    try:
        with zipfile.ZipFile(io.BytesIO(content or b"")) as archive:
            check_sizes(archive, {"head.npy": LARGEST_HEAD})
            names = [n.removesuffix(".npy") for n in archive.namelist() if n != "head.npy"]
            arrays: dict[str, Any] = {n: numbers(archive, f"{n}.npy", ("<f8", "<i8")) for n in names}
            head: dict[str, Any] = json.loads(str(np.load(io.BytesIO(archive.read("head.npy")), allow_pickle=False)))
        if head.pop("format") != FORMAT:
            raise ValueError("another version")
        head |= {name: tuple(_line(c) for c in head[name]) for name in ("columns", "known")}
        head |= {name: tuple(head[name]) for name in ("answering", "unexcited")}
        found = Evidence(**arrays, **head)
        _check(found)
    except (*DAMAGED, KeyError, TypeError, AttributeError, ModelError) as error:
        raise FitError(
            f"{where}: the evidence that is kept there cannot be read ({line(error)}); to do its log again, run the "
            "same `wrenchgap batch` with --again"
        ) from None
    return found


def _check(found: Evidence) -> None:
    """Raise ValueError for numbers that no flight leaves: shapes that differ, axes that are none, no number."""
    quantities = 1 + sum(len(c.theta) + 1 for c in found.columns) + sum(len(c.theta) for c in found.known)
    axes, trims = len(found.axes), len(found.trims)
    shapes = {
        "axes": (axes,), "roots": (axes, int(np.sum(found.rows)), quantities), "rows": (BANDS,), "count": (BANDS,),
        "power": (BANDS, axes), "usable": (BANDS, axes), "error": (BANDS, axes),
        "shapes": (BANDS, 2), "noise": (len(AXES),), "trimmed": (trims, quantities),
        "trims": (trims,), "trim_axes": (trims,), "trim_scale": (trims,),
        "signature": (found.signature.size,),
    }  # fmt: skip
    for name, shape in shapes.items():
        value = getattr(found, name)
        kind = "i" if name in ("axes", "rows", "trim_axes", "signature") else "f"
        if value.shape != shape or value.dtype.kind != kind:
            raise ValueError(f"{name} is {value.dtype} {value.shape}, expected {shape}")
        if name != "noise" and not np.isfinite(value).all():
            raise ValueError(f"{name} has numbers that are not finite")
        if name not in ("roots", "trimmed", "noise", "signature") and np.any(value < 0):
            raise ValueError(f"{name} has negative numbers")
    for name, most in (("axes", len(AXES)), ("trim_axes", axes)):
        value = getattr(found, name)
        if np.any(np.diff(value) <= 0) or np.any(value >= most):
            raise ValueError(f"{name} are not in order, or none: {value.tolist()}")
    counted = [float(np.sum(found.count)), float(found.seconds), *found.trim_scale]
    if not axes or not found.columns or len(set(found.keys)) < len(found.columns) or not min(counted) > 0.0:
        raise ValueError("no axis, column, coefficient or second, or a column twice")
    if not (isinstance(found.flight, str) and isinstance(found.blocks, int) and np.isfinite(found.seconds)):
        raise ValueError("name, length or blocks of the flight are none")


def _plain(line: Column) -> dict[str, Any]:
    kept = ("names", "origin", "theta", "low", "high", "scale", "sparse", "accuracy")
    return {k: np.asarray(getattr(line, k)).tolist() for k in kept}


def _line(values: dict[str, Any]) -> Column:
    """A column without samples. Raises ValueError where it is none, ModelError for an effect that is not known."""
    arrays = {k: np.array(values[k], dtype=float) for k in ("origin", "theta", "low", "high", "scale")}
    sparse, accuracy = np.array(values["sparse"], dtype=bool), float(values["accuracy"])
    names, size = tuple(find(name).name for name in values["names"]), len(values["theta"])
    finite = np.isfinite([*arrays["origin"], *arrays["theta"], *arrays["scale"], accuracy]).all()
    alike = all(a.shape == (size,) for a in (*arrays.values(), sparse))
    if not (names and size and alike and finite) or not np.all(arrays["low"] <= arrays["high"]):
        raise ValueError(f"the column of {', '.join(names)} is none")
    return Column(
        names,
        **arrays,
        offset=np.empty((0, 6)),
        jacobian=np.empty((0, 6, size)),
        sparse=sparse,
        accuracy=accuracy,
        price=0.0,
        per_place=1,
    )
