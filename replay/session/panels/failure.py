"""Where the model fails: a map of the error that one can click into, the worst stretches, the error budget."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.comparison import Stretch
from wrenchgap.learn.data.errors import whole
from wrenchgap.learn.diagnose.budget import Budget, Source
from wrenchgap.learn.diagnose.failure_map import Dependence
from wrenchgap.replay.present.where import dependence_in_words
from wrenchgap.replay.session.failure import UNITS, VIEWS, Cell, Failure, SessionFailures
from wrenchgap.replay.session.panels import html
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.markup import sentences
from wrenchgap.viewer.panel import JobControls, Links, Panel, is_long
from wrenchgap.viewer.scene import Scene

COLOURS = (
    ("noise", "#b9b9b9", "sensor noise"),
    ("physics", "#3b82c4", "explained by the model's effects"),
    ("process", "#8e5fbf", "a Gaussian process would explain"),
    ("unexplained", "#d9483b", "unexplained"),
)
SHOWN = ("rms", "mean")


@dataclass(frozen=True)
class Scale:
    """How cells of a view are written and coloured: darkest at `most` [N, Nm], numbers times `factor` in `unit`."""

    view: int
    most: float
    factor: float
    unit: str
    decimals: int


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
            self.view.on_update(host.guarded(lambda _: self._draw()))
            self.shown = gui.add_dropdown("shown is its", SHOWN, initial_value=SHOWN[0])
            self.shown.on_update(host.guarded(lambda _: self._draw()))
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
        failure, scale = self.failure, self._scale(self.failure)

        def cells(row: Sequence[Cell | None]) -> list[dict[str, str] | None]:
            return [None if c is None else self._cell(c, scale) for c in row]

        def to(stretch: Stretch) -> str:
            return self.links.to(partial(self.host.cursor.go, 0.5 * (stretch.start + stretch.stop)))

        rows, grid = zip(failure.map.dependences, failure.cells, strict=True), failure.grid
        upwards = [] if grid is None else zip(reversed(grid.y_words), reversed(grid.rows), strict=True)
        self.map.content = html.render(
            "failure",
            failure=failure,
            shown=self.shown.value,
            unit=scale.unit,
            quantities=[(d, _title(d, own), cells(own)) for d, own in rows],
            rows=[(words, cells(row)) for words, row in upwards],
            worst=[(s, to(s)) for s in failure.worst],
        )
        self.parts.content = budget_html(self.budget)

    def _cell(self, cell: Cell, scale: Scale) -> dict[str, str] | None:
        """A cell that can be clicked; white at the noise, darkest at the most that this flight showed at first.

        None for what was not measured.
        """
        k = scale.view
        if np.isnan(cell.rms[k]):
            return None
        rms, mean, noise, at = (float(values[k]) for values in (cell.rms, cell.mean, cell.noise, cell.time))
        most = max(scale.most, 3.0 * noise)
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
            "number": f"{round(scale.factor * value, scale.decimals) + 0.0:.{scale.decimals}f}",  # no -0
        }

    def _scale(self, failure: Failure) -> Scale:
        """Colours as the flight was opened, so that they fade when an effect takes the error off; letters as it is."""
        k = VIEWS.index(self.view.value)
        largest, most = _largest(failure, k), self._most[failure.flight, k]
        milli = largest < 0.1
        shown = largest * (1e3 if milli else 1.0)
        decimals = max(0, 1 - int(np.floor(np.log10(max(shown, 1e-3)))))
        return Scale(k, most, 1e3 if milli else 1.0, f"m{UNITS[k]}" if milli else UNITS[k], decimals)


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
