"""The plots beside the scene: one chart each, all over one range of time, with the cursor drawn on top.

While the flight plays, only the cursor's line and the values at it are sent; a chart's data are sent when its range or
its flight changes. Zooming is therefore done here and not in the charts, which also keeps peaks (`flight.decimate`).
"""

from __future__ import annotations

import html
import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from wrenchgap.viewer.colours import CURSOR, GAP, MARKS, css
from wrenchgap.flight.decimate import envelope
from wrenchgap.viewer.lines import Plot
from wrenchgap.viewer.session import Stretch

Array = NDArray[np.float64]

HEIGHT = 128
"""Of a chart [px]."""
X_AXIS, Y_AXIS, RIGHT = 24, 48, 10
"""Room for the axes' numbers and on the right [px]."""
MARGIN, BORDER = 9.25, 1.0
"""Around a chart, as viser sets it [px]; its charts are wider than the room between the borders by one border."""
TICKS = {"size": 4, "width": 1}
READ_PERIOD = 0.1
"""Values at the cursor are renewed so often at most while it moves [s]: nobody reads faster."""
BAND_SIGMAS = 3.0
INK = "#495057"


@dataclass(frozen=True)
class View:
    """What all charts share: the range [s] they show, the marks A and B [s], stretches to shade, by style."""

    start: float
    stop: float
    marks: tuple[tuple[str, float], ...] = ()
    gaps: tuple[Stretch, ...] = ()
    loop: tuple[float, float] | None = None

    def place(self, time: float) -> float | None:
        """Where an instant lies, 0 left to 1 right; None outside."""
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
        """Take it off the page."""
        for handle in (self.head, self.marks, self.cursor, self.chart):
            handle.remove()

    def put(self, part: str, content: str) -> None:
        """Renew one of the HTML parts if it changes."""
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
        """The tab of a group, made when it is first asked for."""
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
                    self.charts[name] = self._made(plot)
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

    def move(self, time: float, *, quick: bool = False) -> None:
        """Draw the cursor at an instant; with `quick`, the values at it are left for later if just renewed."""
        self._time = time
        line = _over(_upright(self.view.place(time), css(CURSOR), 1.5))
        read = not quick or clock.monotonic() - self._read_at > READ_PERIOD
        if read:
            self._read_at = clock.monotonic()
        for chart in self.charts.values():
            chart.put("cursor", line)
            if read:
                chart.put("head", _head(chart.plot, time, self.view.marks))

    def _mark(self) -> None:
        """Gaps, the loop and the marks, in all charts."""
        boxes = [_box(self.view, gap.start, gap.stop, GAP) for gap in self.view.gaps]
        if self.view.loop is not None:
            boxes.append(_box(self.view, *self.view.loop, css(MARKS[0], 0.08)))
        for (name, time), colour in zip(self.view.marks, MARKS, strict=False):
            boxes.append(_upright(self.view.place(time), css(colour), 1.0, name))
        content = _over("".join(boxes))
        for chart in self.charts.values():
            chart.put("marks", content)

    def _made(self, plot: Plot) -> Chart:
        empty = self._gui.add_html
        head, marks, cursor = empty(_head(plot, np.nan, ())), empty(""), empty("")
        data, scales = self._data(plot)
        return Chart(plot, head, marks, cursor, self._chart(plot, data, scales))

    def _send(self, chart: Chart) -> None:
        chart.chart.data, chart.chart.scales = self._data(chart.plot)

    def _chart(self, plot: Plot, data: tuple[Array, ...], scales: dict[str, Any]) -> Any:
        series: list[Any] = [viser.uplot.Series(label="t [s]")]
        bands = []
        for line in plot.lines:
            colour = css(line.colour)
            series.append(viser.uplot.Series(label=line.name, stroke=colour, width=line.width, points={"show": False}))
            if line.sigma is not None:
                edge = viser.uplot.Series(label="3 sigma", stroke=css(line.colour, 0.25), width=0.5)
                edge["points"] = {"show": False}
                bands.append(
                    viser.uplot.Band(series=(len(series), len(series) + 1), fill=css(line.colour, 0.16), dir=-1)
                )
                series += [edge, edge]
        return self._gui.add_uplot(
            data,
            tuple(series),
            bands=tuple(bands) or None,
            scales=scales,
            axes=({"size": X_AXIS, "ticks": TICKS}, {"size": Y_AXIS, "space": 20, "ticks": TICKS}),
            cursor=viser.uplot.Cursor(
                sync={"key": "wrenchgap", "scales": ("x", None)}, drag={"x": False, "y": False, "setScale": False}
            ),
            legend=viser.uplot.Legend(show=False),
            height=HEIGHT,
            padding=(4, RIGHT, 0, 0),
        )

    def _data(self, plot: Plot) -> tuple[tuple[Array, ...], dict[str, Any]]:
        """Columns of a chart and its scales for the range shown, which is fixed: uPlot would stumble over a nan."""
        rows: list[Array] = []
        for line in plot.lines:
            rows.append(line.values)
            if line.sigma is not None:
                rows += [line.values + BAND_SIGMAS * line.sigma, line.values - BAND_SIGMAS * line.sigma]
        start, stop = self.view.start, self.view.stop
        time, values = envelope(plot.time, np.stack(rows), start, stop)
        within = values[:, (time >= start) & (time <= stop)]
        low, high = _limits(within)
        return (time, *values), {
            "x": viser.uplot.Scale(time=False, range=(start, stop)),
            "y": viser.uplot.Scale(range=(low, high)),
        }


def _limits(values: Array) -> tuple[float, float]:
    """Range of an axis: all finite values with a little air; never empty."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return -1.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    air = 0.06 * (high - low) or max(0.05 * abs(high), 1e-6)
    return low - air, high + air


def _head(plot: Plot, time: float, marks: tuple[tuple[str, float], ...]) -> str:
    """Title and unit; every line's name in its colour, its value at the cursor, and how much it changes from A to B."""
    values = plot.at(time)
    change = plot.at(marks[1][1]) - plot.at(marks[0][1]) if len(marks) == 2 else None
    parts = []
    for i, line in enumerate(plot.lines):
        text = "" if not np.isfinite(values[i]) else f" {_number(values[i])}"
        if line.sigma is not None and np.isfinite(time):
            k = int(np.searchsorted(plot.time, time + 1e-9, side="right")) - 1
            if 0 <= k < len(line.sigma) and np.isfinite(line.sigma[k]):
                text += f" &plusmn; {BAND_SIGMAS * line.sigma[k]:.3g}"
        if change is not None and np.isfinite(change[i]):
            text += f" (A&rarr;B {change[i]:+.3g})"
        name = html.escape(line.name) if line.name != plot.title else "value"
        parts.append(f'<span style="color:{css(line.colour)};white-space:nowrap"><b>{name}</b>{text}</span>')
    unit = f" [{html.escape(plot.unit)}]" if plot.unit else ""
    return (
        f'<div style="font-size:11px;line-height:1.3;color:{INK};margin:7px {MARGIN + 2}px -8px;'
        'font-variant-numeric:tabular-nums;overflow-wrap:anywhere">'
        f"<b>{html.escape(plot.title)}</b>{unit} &nbsp;{' &nbsp;'.join(parts)}</div>"
    )


def _number(value: float) -> str:
    """Some digits, and always as wide as its neighbours."""
    return f"{value:+.3f}" if abs(value) < 10 else f"{value:+.2f}" if abs(value) < 1000 else f"{value:+.0f}"


def _over(content: str) -> str:
    """Something drawn over the plotting area of the chart that follows, measured from its left in per cent."""
    left, right = MARGIN + BORDER + Y_AXIS, MARGIN - BORDER + RIGHT
    return (
        '<div style="position:relative;height:0;z-index:3;pointer-events:none">'
        f'<div style="position:absolute;left:{left}px;right:{right}px;top:{MARGIN + BORDER + 4}px;'
        f'height:{HEIGHT - X_AXIS - 4}px">{content}</div></div>'
    )


def _upright(share: float | None, colour: str, width: float, name: str = "") -> str:
    if share is None:
        return ""
    label = f'<span style="position:absolute;top:-2px;left:3px;font-size:10px;color:{colour}"><b>{name}</b></span>'
    return (
        f'<div class="wg-{name or "cursor"}" style="position:absolute;left:{100 * share:.3f}%;top:0;bottom:0;'
        f'margin-left:{-0.5 * width:g}px;border-left:{width:g}px {"dashed" if name else "solid"} {colour}">'
        f"{label if name else ''}</div>"
    )


def _box(view: View, start: float, stop: float, colour: str) -> str:
    span = max(view.stop - view.start, 1e-9)
    left, right = (start - view.start) / span, (stop - view.start) / span
    if right < 0 or left > 1:
        return ""
    left, right = max(left, 0.0), min(right, 1.0)
    return (
        f'<div style="position:absolute;left:{100 * left:.3f}%;width:{100 * (right - left):.3f}%;top:0;bottom:0;'
        f'background:{colour}"></div>'
    )
