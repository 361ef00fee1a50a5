"""The plots next to the scene: one chart each over a common range of time, with the cursor on top.

While the flight plays, only the cursor's line and the values at it are sent; a chart's data are sent when its range or
its flight changes. Zooming is therefore done here and not in the charts, which also keeps peaks
(`flight.stamps.envelope`).
"""

import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import viser

from wrenchgap.flight.flight import Array
from wrenchgap.flight.stamps import envelope
from wrenchgap.viewer import markup
from wrenchgap.viewer.colours import GAP, PALETTE, css
from wrenchgap.viewer.plots import Plot, limits, ticks
from wrenchgap.viewer.session import Stretch

TICKS = {"size": 4, "width": 1}


@dataclass(frozen=True)
class Geometry:
    """Sizes of a chart [px], and the half width of a band in standard deviations.

    `x_axis` and `y_axis` hold the numbers of the axes. viser draws `margin` and `border` around a chart, which is wider
    than the area between the borders by one border.
    """

    height: int = 128
    x_axis: int = 24
    y_axis: int = 48
    right: int = 10
    margin: float = 9.25
    border: float = 1.0
    band_sigmas: float = 3.0


CHART = Geometry()


@dataclass(frozen=True)
class View:
    """Common settings of all charts: range [s], marks A and B [s], and gaps to shade."""

    start: float
    stop: float
    marks: tuple[tuple[str, float], ...] = ()
    gaps: tuple[Stretch, ...] = ()
    loop: tuple[float, float] | None = None

    def place(self, time: float) -> float | None:
        """Place of an instant, from 0 (left) to 1 (right); None outside."""
        share = (time - self.start) / max(self.stop - self.start, 1e-9)
        return share if -1e-9 <= share <= 1.0 + 1e-9 else None


@dataclass
class Chart:
    """The handles of one plot: its head with the values, marks, cursor, and the chart itself."""

    plot: Plot
    head: Any
    marks: Any
    cursor: Any
    chart: Any
    last: dict[str, str] = field(default_factory=dict)

    def remove(self) -> None:
        """Remove the chart from the page."""
        for handle in (self.head, self.marks, self.cursor, self.chart):
            handle.remove()

    def put(self, part: str, content: str) -> None:
        """Set one of the HTML parts if it changes."""
        if self.last.get(part) != content:
            self.last[part] = content
            getattr(self, part).content = content


class Board:
    """The panel of plots. Tabs are the groups of the plots; a tab keeps its place whatever flight is opened."""

    def __init__(self, gui: Any) -> None:
        self._gui = gui
        self.panel = gui.add_panel()
        self._tabs: dict[str, Any] = {}
        self.charts: dict[tuple[str, str], Chart] = {}
        self.view = View(0.0, 1.0)
        self._read_at, self._time = 0.0, np.nan

    def tab(self, group: str) -> Any:
        """The tab of a group, created on first use."""
        if group not in self._tabs:
            self._tabs[group] = self.panel.add_tab(group)
        return self._tabs[group]

    def fill(self, plots: Sequence[Plot], view: View) -> None:
        """Show these plots and no others; charts of the same kind stay and get new data."""
        self.view = view
        wanted = {(plot.group, plot.title): plot for plot in plots}
        for name in [n for n, chart in self.charts.items() if n not in wanted or chart.plot.key != wanted[n].key]:
            self.charts.pop(name).remove()
        for name, plot in wanted.items():
            if name in self.charts:
                self.charts[name].plot = plot
                self._send(self.charts[name])
            else:
                with self.tab(plot.group):
                    head, marks, cursor = map(self._gui.add_html, (_head(plot, np.nan, ()), "", ""))
                    self.charts[name] = Chart(plot, head, marks, cursor, self._chart(plot))
        self._mark()

    def look(self, view: View) -> None:
        """Show another range or other marks."""
        moved = (view.start, view.stop) != (self.view.start, self.view.stop)
        self.view = view
        if moved:
            for chart in self.charts.values():
                self._send(chart)
        self._mark()
        self.move(self._time)

    def move(self, time: float, *, quick: bool = False, period: float = 0.1) -> None:
        """Draw the cursor at an instant; with `quick`, update the values only every `period` [s]."""
        self._time = time
        share = self.view.place(time)
        line = _over([], [] if share is None else [("", 100.0 * share, css(PALETTE.cursor), 1.5)])
        read = not quick or clock.monotonic() - self._read_at > period
        if read:
            self._read_at = clock.monotonic()
        for chart in self.charts.values():
            chart.put("cursor", line)
            if read:
                chart.put("head", _head(chart.plot, time, self.view.marks))

    def _mark(self) -> None:
        """Gaps, the loop and the marks, in all charts."""
        stretches = [box for gap in self.view.gaps for box in _stretch(self.view, gap.start, gap.stop, GAP)]
        if self.view.loop is not None:
            stretches += _stretch(self.view, *self.view.loop, css(PALETTE.marks[0], 0.08))
        uprights = [
            (name, 100.0 * share, css(colour), 1.0)
            for (name, time), colour in zip(self.view.marks, PALETTE.marks, strict=False)
            if (share := self.view.place(time)) is not None
        ]
        content = _over(stretches, uprights)
        for chart in self.charts.values():
            chart.put("marks", content)

    def _send(self, chart: Chart) -> None:
        chart.chart.data, chart.chart.scales, chart.chart.axes = self._data(chart.plot)

    def _chart(self, plot: Plot) -> Any:
        data, scales, axes = self._data(plot)
        series: list[Any] = [viser.uplot.Series(label="t [s]")]
        bands = []
        for line in plot.lines:
            colour = css(line.colour)
            series.append(viser.uplot.Series(label=line.name, stroke=colour, width=line.width, points={"show": False}))
            if line.sigma is not None:
                faint, pair = css(line.colour, 0.25), (len(series), len(series) + 1)
                edge = viser.uplot.Series(label="3 sigma", stroke=faint, width=0.5, points={"show": False})
                bands.append(viser.uplot.Band(series=pair, fill=css(line.colour, 0.16), dir=-1))
                series += [edge, edge]
        sync: Any = {"key": "wrenchgap", "scales": ("x", None)}
        drag: Any = {"x": False, "y": False, "setScale": False}
        return self._gui.add_uplot(
            data,
            tuple(series),
            bands=tuple(bands) or None,
            scales=scales,
            axes=axes,
            cursor=viser.uplot.Cursor(sync=sync, drag=drag),
            legend=viser.uplot.Legend(show=False),
            height=CHART.height,
            padding=(4, CHART.right, 0, 0),
        )

    def _data(self, plot: Plot) -> tuple[tuple[Array, ...], dict[str, Any], Any]:
        """Columns of a chart, its scales for the range shown, which is fixed: uPlot would stumble over a nan; its axes.

        All of them in the plot's shown unit.
        """
        rows: list[Array] = []
        for line in plot.lines:
            rows.append(line.values)
            if line.sigma is not None:
                rows += [line.values + CHART.band_sigmas * line.sigma, line.values - CHART.band_sigmas * line.sigma]
        start, stop = self.view.start, self.view.stop
        time, values = envelope(plot.time, plot.factor * np.stack(rows), start, stop)
        low, high = limits(values[:, (time >= start) & (time <= stop)], plot.factor * plot.floor)
        x, y = viser.uplot.Scale(time=False, range=(start, stop)), viser.uplot.Scale(range=(low, high))
        places, words = ticks(low, high)
        upright = {"size": CHART.y_axis, "ticks": TICKS, "splits": places, "values": words}
        return (time, *values), {"x": x, "y": y}, ({"size": CHART.x_axis, "ticks": TICKS}, upright)


def _head(plot: Plot, time: float, marks: tuple[tuple[str, float], ...]) -> str:
    """Title and unit; every line's name in its colour, its value at the cursor, and how much it changes from A to B."""
    values = plot.factor * plot.at(time)
    change = np.full(len(values), np.nan)
    if len(marks) == 2:
        change = plot.factor * (plot.at(marks[1][1]) - plot.at(marks[0][1]))
    sigmas = plot.factor * plot.at(time, "sigma")
    lines = [
        {
            "name": line.name if line.name != plot.title else "value",
            "colour": css(line.colour),
            "value": _number(value) if np.isfinite(value) else "",
            "band": f"{CHART.band_sigmas * sigma:.3g}" if np.isfinite(sigma) else "",
            "change": f"{by:+.3g}" if np.isfinite(by) else "",
        }
        for line, value, sigma, by in zip(plot.lines, values, sigmas, change, strict=True)
    ]
    return markup.render("plot_head", title=plot.title, unit=plot.shown_unit, lines=lines)


def _number(value: float) -> str:
    """The value with a fixed width."""
    return f"{value:+.3f}" if abs(value) < 10 else f"{value:+.2f}" if abs(value) < 1000 else f"{value:+.0f}"


def _over(stretches: Sequence[tuple[float, float, str]], uprights: Sequence[tuple[str, float, str, float]]) -> str:
    """Stretches (left, width [%], colour) and uprights (name, left [%], colour, width [px]) over a plotting area."""
    return markup.render(
        "plot_overlay",
        left=CHART.margin + CHART.border + CHART.y_axis,
        right=CHART.margin - CHART.border + CHART.right,
        top=CHART.margin + CHART.border + 4,
        height=CHART.height - CHART.x_axis - 4,
        stretches=stretches,
        uprights=uprights,
    )


def _stretch(view: View, start: float, stop: float, colour: str) -> list[tuple[float, float, str]]:
    span = max(view.stop - view.start, 1e-9)
    left, right = max((start - view.start) / span, 0.0), min((stop - view.start) / span, 1.0)
    return [(100.0 * left, 100.0 * (right - left), colour)] if left <= 1.0 and right >= 0.0 else []
