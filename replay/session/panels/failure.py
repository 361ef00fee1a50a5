"""Where the model fails: a map of the error that one can click into, the worst stretches, the error budget."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from wrenchgap.flight.flight import AXES, Array, Indices, Mask
from wrenchgap.learn.data.candidates import Untried
from wrenchgap.learn.data.comparison import Stretch, worst_stretches
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import length, weighted, whole
from wrenchgap.learn.diagnose.failure_map import Dependence, FailureMap, Grid, failure_map
from wrenchgap.learn.diagnose.quantities import Quantity, quantities
from wrenchgap.learn.diagnose.where import Budget, Source, budget, held_out_process
from wrenchgap.replay.present.where import dependence_in_words
from wrenchgap.replay.session.panels import html
from wrenchgap.replay.session.worker import worker_result
from wrenchgap.replay.session.working_model import WorkingModel
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.markup import sentences
from wrenchgap.viewer.panel import JobControls, Links, Panel, is_long
from wrenchgap.viewer.session import Report, Scene

VIEWS = ("all axes", "force", "torque", *AXES)
"""What an error may be looked at: everything on one scale [N], the norms of force [N] and torque [Nm], one axis."""
UNITS = ("N", "N", "Nm", *("N" if axis.startswith("force") else "Nm" for axis in AXES))
COLOURS = (
    ("noise", "#b9b9b9", "sensor noise"),
    ("physics", "#3b82c4", "explained by the model's effects"),
    ("process", "#8e5fbf", "a Gaussian process would explain"),
    ("unexplained", "#d9483b", "unexplained"),
)


@dataclass(frozen=True)
class Cell:
    """The time in which something was within bounds.

    `words` are the bounds, `seconds` how long it was; per view (V,): `rms` of the error, its `mean` (of one axis with
    its sign, of several the norm), `noise` of the sensors, and `time` [s], the instant at which the error was largest.
    """

    words: str
    seconds: float
    rms: Array
    mean: Array
    noise: Array
    time: Array


@dataclass(frozen=True)
class CellGrid:
    """Cells over two quantities: `rows[i][j]` of the i-th bin of y and the j-th of x, or None; bounds of the bins."""

    rows: tuple[tuple[Cell | None, ...], ...]
    x_words: tuple[str, ...]
    y_words: tuple[str, ...]


@dataclass(frozen=True)
class Failure:
    """Where a model (by its name) fails on one flight.

    `cells` are those of the bins of every dependence of the map, `grid` those of its grid; `left_out` are effects that
    cannot be evaluated on the flight. The budget is without a Gaussian process unless one was given.
    """

    flight: str
    model: str
    map: FailureMap
    cells: tuple[tuple[Cell, ...], ...]
    grid: CellGrid | None
    budget: Budget
    worst: tuple[Stretch, ...]
    left_out: tuple[Untried, ...]


class SessionFailures:
    """Where the current model fails.

    A p value is that of so many random orders as `permutations` (one below 0.01 needs a hundred); the worst instant of
    a cell is that of the error's running mean over `smooth` [s], as one sample is noise.
    """

    def __init__(self, working: WorkingModel, permutations: int = 110, smooth: float = 0.2) -> None:
        self.working, self.permutations, self.smooth = working, permutations, smooth

    def of(self, flight: str) -> Failure:
        """Where the current model fails on a flight."""
        return self.working.cached(("failure", flight), lambda: self._made(flight))

    def full_budget(self, flight: str, report: Report) -> Budget:
        """The budget with what a Gaussian process of the command would explain on blocks that it has not seen."""
        with self.working.lock:
            data, (nominal, left) = self.working.data(flight), self._residuals(flight)

        bare = replace(data)  # without what its evaluators remember

        def work(tell: Report) -> Array | None:
            return held_out_process(bare, left, progress=lambda k, n: tell(k / n, f"Gaussian process, fold {k + 1}"))

        return budget(data, nominal, left, worker_result(work, report), Source.FITTED)

    def _made(self, flight: str) -> Failure:
        working = self.working
        data, residual, (nominal, left) = working.data(flight), working.residual(flight), self._residuals(flight)
        process = None if working.predictor.gp is None else left - residual
        mapped = failure_map(data, residual, permutations=self.permutations)
        values = {q.name: q for q in quantities(data)[0]}
        sizes = _Sizes(data, residual, self.smooth)
        return Failure(
            flight,
            working.predictor.name,
            mapped,
            tuple(tuple(itertools.starmap(sizes.cell, _members(d, values[d.name]))) for d in mapped.dependences),
            None if mapped.grid is None else _grid(mapped.grid, mapped.cell, values, sizes),
            budget(data, nominal, left, process, Source.GIVEN),
            worst_stretches(data.records, data.by_record(residual), data.weights),
            working.inapplicable_effects(working.model, flight),
        )

    def _residuals(self, flight: str) -> tuple[Array, Array]:
        """Of the nominal vehicle and of the current model (K, 6), without any GP."""
        model = self.working.model
        return self.working.model_residual(model.nominal, flight), self.working.model_residual(model, flight)


class _Sizes:
    """Squares of the residual by view (K, V), smoothed for finding the worst instant, and of the noise (V,)."""

    def __init__(self, data: Dataset, residual: Array, smooth: float) -> None:
        from scipy.ndimage import uniform_filter1d  # here: others need not wait for it

        self.residual, self.scale = residual, data.weights**2
        self.square = _views(residual**2, data.weights**2)
        self.noise = _views(data.noise[None] ** 2, data.weights**2)[0]
        self.time = np.concatenate([r.time for r in data.records])
        self.step = data.records[0].dt_kept
        width = max(1, round(smooth / self.step))
        parts = data.by_record(self.square)
        self.smooth = np.concatenate([uniform_filter1d(own, width, axis=0, mode="nearest") for own in parts])

    def cell(self, words: str, rows: Mask) -> Cell:
        """The samples `rows` (K,)."""
        worst = np.flatnonzero(rows)[np.argmax(np.nan_to_num(self.smooth[rows]), axis=0)]
        rms, mean = np.sqrt(self.square[rows].mean(axis=0)), self.residual[rows].mean(axis=0)
        signed = np.concatenate((np.sqrt(_views(mean[None] ** 2, self.scale)[0, :3]), mean))
        return Cell(words, float(rows.sum() * self.step), rms, signed, np.sqrt(self.noise), self.time[worst])


def _views(squares: Array, scale: Array) -> Array:
    """Squares (K, 6) as (K, V): all on one scale, force, torque, each axis."""
    force, torque = (length(np.sqrt(squares[:, part])) ** 2 for part in (slice(3), slice(3, 6)))
    return np.column_stack((weighted(squares, scale).sum(axis=1), force, torque, squares))


def _members(found: Dependence, values: Quantity) -> list[tuple[str, Mask]]:
    """The bins of a quantity in words, and which samples (K,) are in each."""
    bounds = zip(found.binned.low, found.binned.high, strict=True)
    words = ["no value or too few" if np.isnan(low) else _bounds(values, low, high) for low, high in bounds]
    return [(text, found.index == k) for k, text in enumerate(words)]


def _bounds(values: Quantity, low: float, high: float) -> str:
    if values.circular:
        return f"{(0.5 * (low + high) + 180.0) % 360.0 - 180.0:.0f} {values.unit}"
    digits = max(0, 1 - int(np.floor(np.log10(max(high - low, 1e-6) * 2.0))))
    return f"{low:.{digits}f} to {high:.{digits}f} {values.unit}"


def _grid(found: Grid, cells: Indices, values: dict[str, Quantity], sizes: _Sizes) -> CellGrid:
    x, y = values[found.x], values[found.y]
    x_words, y_words = (
        tuple(_bounds(of, low, high) for low, high in itertools.pairwise(edges))
        for of, edges in ((x, found.x_edges), (y, found.y_edges))
    )

    def cell(i: int, j: int) -> Cell | None:
        known = np.isfinite(found.force[i, j]) or np.isfinite(found.torque[i, j])
        words = f"{x.label} {x_words[i]}, {y.label} {y_words[j]}"
        return sizes.cell(words, cells == i * len(y_words) + j) if known else None

    rows = tuple(tuple(cell(i, j) for i in range(len(x_words))) for j in range(len(y_words)))
    return CellGrid(rows, x_words, y_words)


class FailurePanel(Panel):
    """The failure map of the flight shown; a click on a cell or a stretch moves the cursor there."""

    def __init__(self, host: Host, failures: SessionFailures) -> None:
        super().__init__(host)
        self.failures = failures
        self.failure: Failure | None = None
        self.budget: Budget | None = None
        self._most: dict[tuple[str, int], float] = {}
        with host.tab("Failure"):
            gui = host.gui
            self.view = gui.add_dropdown("error of", VIEWS, initial_value=VIEWS[0])
            self.shown = gui.add_dropdown("shown is its", ("rms", "mean"), initial_value="rms")
            for choice in (self.view, self.shown):
                host.connect(choice, lambda _: self._draw())
            self.map = gui.add_html("")
            self.parts = gui.add_html("")
            hint = "Fits a small one on other blocks of time than those on which it is judged; takes some seconds."
            self.work = JobControls(host, "What would a Gaussian process explain?", self._ask, hint)
            self.links = Links(host)

    def opened(self, scene: Scene) -> None:
        """Another flight, or another model. A long flight is looked at beside the page, which stands at once."""
        self.work.cancel()
        name, beside = scene.name, is_long(scene)
        if beside and (self.failure is None or self.failure.flight != name):
            self.failure, self.parts.content = None, ""
            self.map.content = sentences(f"looking at {name} ...", look="wg-pale")
        self.look_up(partial(self.failures.of, name), self._show, in_background=beside)

    def _show(self, failure: Failure) -> None:
        self.failure, self.budget = failure, failure.budget
        for k in range(len(VIEWS)):
            self._most.setdefault((failure.flight, k), _largest(failure, k))
        self._draw()

    def _ask(self) -> None:
        name = self.host.scene.name

        def done(found: Budget) -> None:
            self.budget = found
            self.parts.content = budget_html(found)

        self.work.start(lambda report: self.failures.full_budget(name, report), done)

    def _draw(self) -> None:
        if self.failure is None or self.budget is None:
            return
        self.links.start()
        failure, k = self.failure, VIEWS.index(self.view.value)
        largest, most = _largest(failure, k), self._most[failure.flight, k]
        factor, unit = (1e3, f"m{UNITS[k]}") if largest < 0.1 else (1.0, UNITS[k])
        decimals = max(0, 1 - int(np.floor(np.log10(max(factor * largest, 1e-3)))))

        def cells(row: Sequence[Cell | None]) -> list[dict[str, str] | None]:
            return [None if c is None or np.isnan(c.rms[k]) else self._cell(c, k, most, factor, decimals) for c in row]

        def to(stretch: Stretch) -> str:
            return self.links.to(partial(self.host.cursor.go, 0.5 * (stretch.start + stretch.stop)))

        rows, grid = zip(failure.map.dependences, failure.cells, strict=True), failure.grid
        upwards = [] if grid is None else zip(reversed(grid.y_words), reversed(grid.rows), strict=True)
        self.map.content = html.render(
            "failure",
            failure=failure,
            shown=self.shown.value,
            unit=unit,
            quantities=[(d, _title(d, own), cells(own)) for d, own in rows],
            rows=[(words, cells(row)) for words, row in upwards],
            worst=[(s, to(s)) for s in failure.worst],
        )
        self.parts.content = budget_html(self.budget)

    def _cell(self, cell: Cell, k: int, most: float, factor: float, decimals: int) -> dict[str, str]:
        """A cell of the k-th view that can be clicked, its number times `factor`.

        White at the noise, darkest at `most`, which this flight showed at first: an effect that takes the error off
        lets the colours fade.
        """
        rms, mean, noise, at = (float(values[k]) for values in (cell.rms, cell.mean, cell.noise, cell.time))
        most = max(most, 3.0 * noise)
        if self.shown.value == "mean":
            value, share = mean, mean / most
        else:
            value, share = rms, max(rms - noise, 0.0) / (most - noise)
        back, front = html.heat(share)
        return {
            "button": self.links.to(partial(self.host.cursor.go, at)),
            "title": f"{cell.words}: {rms:.3g} {UNITS[k]} rms, mean {mean:.3g}, in {cell.seconds:.1f} s "
            f"(noise {noise:.2g}); worst at {at:.2f} s",
            "back": back,
            "front": front,
            "number": f"{round(factor * value, decimals) + 0.0:.{decimals}f}",  # no -0
        }


def _title(found: Dependence, cells: Sequence[Cell]) -> str:
    """How the error depends on a quantity, and between which bounds it lies."""
    words = dependence_in_words(found) if found.score > 0.0 else "no significant dependence"
    bounds = f"; {cells[0].words} ... {cells[-1].words}" if cells else ""
    return f"{found.label} ({words}){bounds}"


def budget_html(found: Budget) -> str:
    """One bar for all axes together and one for each that was measured."""
    shares = found.shares()
    rows = [(VIEWS[0], UNITS[0], whole(np.sqrt(found.nominal), found.weights), found.whole())]
    for k, axis in enumerate(AXES):
        if np.isfinite(found.nominal[k]):
            own = {name: float(values[k]) for name, values in shares.items()}
            rows.append((axis, UNITS[VIEWS.index(axis)], float(np.sqrt(found.nominal[k])), own))

    def bar(parts: dict[str, float]) -> list[tuple[float, str, str]]:
        total = sum(max(v, 0.0) for v in parts.values()) or 1.0
        return [(max(parts[n], 0.0) / total, c, f"{words}: {html.percent(parts[n])}") for n, c, words in COLOURS]

    known = [c for c in COLOURS if c[0] != "process" or found.source is not Source.NONE]
    return html.render(
        "budget",
        legend=[(colour, words) for _, colour, words in known],
        rows=[(view, unit, rms, bar(parts), parts) for view, unit, rms, parts in rows],
    )


def _largest(failure: Failure, k: int) -> float:
    grid = () if failure.grid is None else failure.grid.rows
    cells = [c for row in (*failure.cells, *grid) for c in row if c is not None]
    return max((float(c.rms[k]) for c in cells if np.isfinite(c.rms[k])), default=1.0)
