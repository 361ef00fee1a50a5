"""Where the model fails: a map of the error that one can click into, the worst stretches, the error budget."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from wrenchgap.viewer import markup
from wrenchgap.viewer.analysis import UNITS, VIEWS, Budget, Cell, Failure, Failures
from wrenchgap.viewer.background import Job
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.html_links import Links
from wrenchgap.viewer.job_controls import JobControls
from wrenchgap.viewer.panel import Panel
from wrenchgap.viewer.scene import Scene

PARTS = (
    ("noise", "#b9b9b9", "sensor noise"),
    ("physics", "#3b82c4", "explained by the model's effects"),
    ("process", "#8e5fbf", "a Gaussian process would explain"),
    ("unexplained", "#d9483b", "unexplained"),
)
LONG = 120.0
"""Flights longer than this are looked at beside the page [s]."""
SHOWN = ("rms", "mean")
SHARE = "flex:1 1 0;min-width:0;overflow:hidden"
CELL = "display:block;padding:3px 1px;text-align:center;margin:1px;font-size:11px;"


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

    def __init__(self, host: Host, failures: Failures) -> None:
        super().__init__(host)
        self.failures = failures
        self.failure: Failure | None = None
        self.budget: tuple[Budget, ...] = ()
        self._looking: Job | None = None
        self._most: dict[tuple[str, int], float] = {}
        with host.tab("Failure"):
            gui = host.gui
            self.view = gui.add_dropdown("error of", VIEWS, initial_value=VIEWS[0])
            self.view.on_update(host.guarded(lambda _: self._draw()))
            self.shown = gui.add_dropdown("shown is its", SHOWN, initial_value=SHOWN[0])
            self.shown.on_update(host.guarded(lambda _: self._draw()))
            self.map = gui.add_html("")
            self.parts = gui.add_html("")
            self.work = JobControls(
                host,
                "What would a Gaussian process explain?",
                self._ask,
                "Fits a small one on other blocks of time than those on which it is judged; takes some seconds.",
            )
            self.links = Links(host)

    @classmethod
    def of(cls, host: Host) -> Panel | None:
        """The panel of a session that can do this."""
        found = host.session.capabilities.failures
        return None if found is None else cls(host, found)

    def opened(self, scene: Scene) -> None:
        """Another flight, or another model. A long flight is looked at beside the page, which stands at once."""
        self.work.cancel()
        if self._looking is not None:
            self._looking.cancel()
            self._looking = None
        name = scene.name
        if scene.time[-1] - scene.time[0] <= LONG:
            self._show(self.failures.of(name))
            return
        if self.failure is None or self.failure.flight != name:
            self.failure, self.parts.content = None, ""
            self.map.content = markup.box(markup.paragraph(f"looking at {markup.text(name)} ...", colour="#777"))
        self._looking = self.host.background(
            lambda report: self.failures.of(name), lambda share, words: None, self._show
        )

    def _show(self, failure: Failure) -> None:
        """Draw what was found."""
        self.failure, self.budget = failure, failure.budget
        for k in range(len(VIEWS)):
            self._most.setdefault((failure.flight, k), _largest(failure, k))
        self._draw()

    def _ask(self) -> None:
        """Let a process say what it would explain."""
        name = self.host.scene.name

        def done(found: tuple[Budget, ...]) -> None:
            self.budget = found
            self.parts.content = self._budget()

        self.work.start(lambda report: self.failures.full_budget(name, report), done)

    def _draw(self) -> None:
        if self.failure is None:
            return
        self.links.start()
        scale = self._scale(self.failure)
        self.map.content = markup.box(
            *(markup.paragraph(markup.text(s)) for s in self.failure.sentences),
            self._quantities(self.failure, scale),
            self._grid(self.failure, scale),
            self._worst(self.failure),
            *(
                markup.paragraph(f"not looked at: {markup.text(words)}", colour="#777")
                for words in self.failure.lacking
            ),
        )
        self.parts.content = self._budget()

    def _quantities(self, failure: Failure, scale: Scale) -> str:
        """One row a quantity, one cell a bin."""
        rows = []
        for quantity in failure.quantities:
            cells = "".join(f'<div style="{SHARE}">{self._cell(c, scale)}</div>' for c in quantity.cells)
            ends = f"{quantity.cells[0].words} ... {quantity.cells[-1].words}" if quantity.cells else ""
            title, weight = markup.text(f"{quantity.words}; {ends}"), 600 if quantity.sure else 400
            rows.append(
                f'<div style="display:flex;align-items:stretch;opacity:{1.0 if quantity.sure else 0.45}">'
                f'<div style="width:31%;padding:3px 4px 0 0;font-weight:{weight}" title="{title}">'
                f"{markup.text(quantity.label)}</div>"
                f'<div style="width:69%;display:flex">{cells}</div></div>'
            )
        head = markup.heading(f"{self.shown.value} of the error [{scale.unit}], low to high; click: its worst instant")
        return head + "".join(rows) + markup.paragraph("pale rows: no more than chance", colour="#777")

    def _grid(self, failure: Failure, scale: Scale) -> str:
        """The error over two quantities, y upwards."""
        grid = failure.grid
        if grid is None:
            return ""
        lines = []
        for words, row in zip(reversed(grid.y_words), reversed(grid.rows), strict=True):
            cells = "".join(f'<div style="{SHARE}">{"" if c is None else self._cell(c, scale)}</div>' for c in row)
            lines.append(
                f'<div style="display:flex;min-height:23px"><div style="width:22%;padding-top:3px">{markup.text(words)}'
                f'</div><div style="width:78%;display:flex">{cells}</div></div>'
            )
        names = "".join(
            f'<div style="{SHARE};text-align:center">{markup.text(w.rsplit(" ", 1)[0])}</div>' for w in grid.x_words
        )
        foot = '<div style="display:flex;font-size:10px"><div style="width:22%"></div>'
        foot += f'<div style="width:78%;display:flex">{names}</div></div>'
        title = f"{markup.text(grid.y_label)} (up) and {markup.text(grid.x_label)} (right)"
        return markup.heading(title) + "".join(lines) + foot

    def _cell(self, cell: Cell, scale: Scale) -> str:
        """A cell that can be clicked; white at the noise, darkest at the most that this flight showed at first."""
        k = scale.view
        rms, mean, noise, at = (float(values[k]) for values in (cell.rms, cell.mean, cell.noise, cell.time))
        most = max(scale.most, 3.0 * noise)
        if self.shown.value == "mean":
            value, share = mean, mean / most
        else:
            value, share = rms, max(rms - noise, 0.0) / (most - noise)
        back, front = markup.heat(share)
        title = (
            f"{cell.words}: {rms:.3g} {UNITS[k]} rms, mean {mean:.3g}, in {cell.seconds:.1f} s (noise {noise:.2g}); "
            f"worst at {at:.2f} s"
        )
        style = f"{CELL}background:{back};color:{front};"
        content = f"{round(scale.factor * value, scale.decimals) + 0.0:.{scale.decimals}f}"  # no -0
        return self.links.to(partial(self.host.cursor.go, at), content, style, markup.text(title))

    def _scale(self, failure: Failure) -> Scale:
        """Colours as the flight was opened, so that they fade when an effect takes the error off; letters as it is."""
        k = VIEWS.index(self.view.value)
        largest, most = _largest(failure, k), self._most[failure.flight, k]
        milli = largest < 0.1
        shown = largest * (1e3 if milli else 1.0)
        decimals = max(0, 1 - int(np.floor(np.log10(max(shown, 1e-3)))))
        return Scale(k, most, 1e3 if milli else 1.0, f"m{UNITS[k]}" if milli else UNITS[k], decimals)

    def _worst(self, failure: Failure) -> str:
        """The worst stretches, each a link to its middle."""
        lines = [
            self.links.to(
                partial(self.host.cursor.go, 0.5 * (s.start + s.stop)),
                f"<b>{s.start:.1f} s</b> &nbsp;{markup.text(s.words)}",
                "display:block;padding:3px 4px;border-bottom:1px solid rgba(128,128,128,0.25)",
                "go there",
            )
            for s in failure.worst
        ]
        return markup.heading("worst stretches") + "".join(lines) if lines else ""

    def _budget(self) -> str:
        """What the nominal model's error is made of: one bar for all axes and one for each."""
        rows = []
        for row in self.budget:
            shares = {name: getattr(row, name) or 0.0 for name, _, _ in PARTS}
            whole = sum(max(v, 0.0) for v in shares.values()) or 1.0
            pieces = [
                (max(shares[n], 0.0) / whole, colour, f"{words}: {markup.percent(shares[n])}")
                for n, colour, words in PARTS
            ]
            worse = "" if shares["physics"] >= 0.0 else " (the effects do harm here)"
            rows.append(
                (
                    markup.text(row.view + worse),
                    markup.bar(pieces),
                    f"{markup.number(row.rms)} {row.unit}",
                    markup.percent(shares["unexplained"]),
                )
            )
        known = any(row.process is not None for row in self.budget)
        legend = "".join(markup.swatch(colour, words) for n, colour, words in PARTS if known or n != "process")
        head = markup.heading("what the nominal model's error is made of (mean square)")
        body = markup.table(("axis", markup.wide(110), "rms", "open"), rows, left=2)
        return markup.box(head, legend, body)


def _largest(failure: Failure, k: int) -> float:
    """The largest rms of any cell in a view."""
    grid = () if failure.grid is None else failure.grid.rows
    cells = [c for q in failure.quantities for c in q.cells] + [c for row in grid for c in row if c is not None]
    return max((float(c.rms[k]) for c in cells), default=1.0)
