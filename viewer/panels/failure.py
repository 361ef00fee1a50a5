"""Where the model fails: a map of the error that one can click into, the worst stretches, the error budget."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from wrenchgap.viewer import markup
from wrenchgap.viewer.analysis import UNITS, VIEWS, Budget, Cell, Failure, Failures
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.html_links import Links
from wrenchgap.viewer.job_controls import JobControls
from wrenchgap.viewer.panel import Panel, is_long
from wrenchgap.viewer.scene import Scene

PARTS = (
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

    asks = "failures"

    def __init__(self, host: Host, failures: Failures) -> None:
        super().__init__(host)
        self.failures = failures
        self.failure: Failure | None = None
        self.budget: tuple[Budget, ...] = ()
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
            self.map.content = markup.sentences(f"looking at {name} ...", look="wg-pale")
        self.look_up(partial(self.failures.of, name), self._show, beside=beside)

    def _show(self, failure: Failure) -> None:
        self.failure, self.budget = failure, failure.budget
        for k in range(len(VIEWS)):
            self._most.setdefault((failure.flight, k), _largest(failure, k))
        self._draw()

    def _ask(self) -> None:
        name = self.host.scene.name

        def done(found: tuple[Budget, ...]) -> None:
            self.budget = found
            self.parts.content = self._budget()

        self.work.start(lambda report: self.failures.full_budget(name, report), done)

    def _draw(self) -> None:
        if self.failure is None:
            return
        self.links.start()
        failure, scale = self.failure, self._scale(self.failure)

        def cells(row: Sequence[Cell | None]) -> list[dict[str, str] | None]:
            return [None if c is None else self._cell(c, scale) for c in row]

        grid = failure.grid
        upwards = [] if grid is None else zip(reversed(grid.y_words), reversed(grid.rows), strict=True)
        self.map.content = markup.render(
            "failure",
            failure=failure,
            shown=self.shown.value,
            unit=scale.unit,
            quantities=[(quantity, cells(quantity.cells)) for quantity in failure.quantities],
            grid=grid,
            rows=[(words, cells(row)) for words, row in upwards],
            worst=[(s, self.links.to(partial(self.host.cursor.go, 0.5 * (s.start + s.stop)))) for s in failure.worst],
        )
        self.parts.content = self._budget()

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
        back, front = markup.heat(share)
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

    def _budget(self) -> str:
        rows = []
        for row in self.budget:
            shares = {name: getattr(row, name) or 0.0 for name, _, _ in PARTS}
            whole = sum(max(v, 0.0) for v in shares.values()) or 1.0
            parts = [
                (max(shares[n], 0.0) / whole, colour, f"{words}: {markup.percent(shares[n])}")
                for n, colour, words in PARTS
            ]
            rows.append((row, parts, shares["unexplained"]))
        known = any(row.process is not None for row in self.budget)
        legend = [(colour, words) for name, colour, words in PARTS if known or name != "process"]
        return markup.render("budget", legend=legend, rows=rows)


def _largest(failure: Failure, k: int) -> float:
    grid = () if failure.grid is None else failure.grid.rows
    cells = [c for q in failure.quantities for c in q.cells] + [c for row in grid for c in row if c is not None]
    return max((float(c.rms[k]) for c in cells if np.isfinite(c.rms[k])), default=1.0)
