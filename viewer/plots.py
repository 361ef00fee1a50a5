"""The plots of a flight: from the quantities of a scene to titles, colours and lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.viewer.axis import prefixed
from wrenchgap.viewer.colours import Colour, colour_of, line_colours
from wrenchgap.viewer.scene import Scene

WRENCHES, RESIDUAL, CHANNELS = "Wrench", "Residual", "Log"
GROUPS = (WRENCHES, RESIDUAL, "Tracking", "Actuators", "Compensation", CHANNELS)
"""Tabs of the plots, in their order; a series may bring another."""
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Line:
    """One line of a plot: `values` (N,), and the standard deviation (N,) of which three make its band, or None."""

    name: str
    colour: Colour
    values: Array
    sigma: Array | None = None

    @property
    def width(self) -> float:
        """Width [px]: the measurement is wide, so that it stays visible under a prediction that agrees."""
        return 2.2 if self.name == "measured" else 1.2


@dataclass(frozen=True)
class Plot:
    """Lines over one `time` (N,) [s]; `group` is the tab in which it stands. The title is unique within the group.

    Values are in `unit`; a chart shows `factor` times them, in `shown_unit`, over a range of at least `floor` [unit].
    """

    group: str
    title: str
    unit: str
    time: Array
    lines: tuple[Line, ...]
    floor: float = 0.0
    factor: float = 1.0
    shown_unit: str = ""

    @property
    def largest(self) -> float:
        """The largest size of its lines, or half the least range where that is more [unit]; 0 of no values."""
        sizes = np.abs(np.concatenate([np.zeros(1), *(line.values for line in self.lines)]))
        return max(float(np.nanmax(sizes)), 0.5 * self.floor)

    @property
    def key(self) -> tuple[Any, ...]:
        """The properties that must agree for a chart to take the data of another plot."""
        return (
            self.group,
            self.title,
            self.shown_unit,
            *((ln.name, ln.colour, ln.sigma is not None) for ln in self.lines),
        )

    def at(self, time: float) -> Array:
        """Values of all lines at the last sample that is not after `time`; nan where there is none."""
        return self._at(time, [line.values for line in self.lines])

    def sigma_at(self, time: float) -> Array:
        """Standard deviations of all lines at that sample, nan where there is none."""
        return self._at(time, [line.sigma for line in self.lines])

    def _at(self, time: float, columns: Sequence[Array | None]) -> Array:
        k = int(np.searchsorted(self.time, time + 1e-9, side="right")) - 1
        return np.array([np.nan if c is None or not 0 <= k < len(c) else c[k] for c in columns])


def plots_of(scene: Scene) -> list[Plot]:
    """The plots of a flight, tab by tab: torques first, because most effects show there first."""
    series = [Plot(s.group, s.title, s.unit, s.time, _lines(s.values), s.floor) for s in scene.series]
    return _in_units([*_wrenches(scene), *_residuals(scene), *series])


def _in_units(plots: Sequence[Plot]) -> list[Plot]:
    """The same, shown in units with prefixes: one for all plots of a tab in the same unit, so that they compare.

    A plot of less than 1 % of the largest of them has one of its own: its ticks would have too many digits.
    """
    largest: dict[tuple[str, str], float] = {}
    for plot in plots:
        tab = (plot.group, plot.unit)
        largest[tab] = max(largest.get(tab, 0.0), plot.largest)
    most = [largest[plot.group, plot.unit] for plot in plots]
    sizes = [plot.largest if plot.largest < 0.01 * of else of for plot, of in zip(plots, most, strict=True)]
    shown = [prefixed(plot.unit, size) for plot, size in zip(plots, sizes, strict=True)]
    return [replace(p, factor=factor, shown_unit=unit) for p, (factor, unit) in zip(plots, shown, strict=True)]


def channel_plot(name: str, channel: tuple[Array, Array]) -> Plot:
    """The plot of one channel of the log."""
    return Plot(CHANNELS, name, "", channel[0], (Line(name, line_colours((name,))[0], channel[1]),))


def _wrenches(scene: Scene) -> list[Plot]:
    plots = []
    for kind, unit, first in (("torque", "Nm", 3), ("force", "N", 0)):
        for column, axis in enumerate(AXES, first):
            lines = tuple(
                Line(name, colour_of(name), wrench[:, column], _column(scene.sigma, name, column))
                for name, wrench in scene.wrenches.items()
                if np.isfinite(wrench[:, column]).any()
            )
            if lines:
                plots.append(Plot(WRENCHES, f"{kind} {axis}", unit, scene.time, lines, scene.floors.get(unit, 0.0)))
    return plots


def _column(sigma: Mapping[str, Array], name: str, column: int) -> Array | None:
    values = sigma.get(name)
    return None if values is None or not np.isfinite(values[:, column]).any() else values[:, column]


def _residuals(scene: Scene) -> list[Plot]:
    """Measured minus predicted, axis by axis in one plot; the same of every other model in a plot of its own."""
    measured = scene.wrenches.get("measured")
    if measured is None:
        return []
    plots = []
    models = [name for name in scene.wrenches if name not in ("measured", "desired")]
    models.sort(key=lambda name: name != scene.residual_of)
    for name in models:
        left = measured - scene.wrenches[name]
        for kind, unit, part in (("torque", "Nm", left[:, 3:]), ("force", "N", left[:, :3])):
            if np.isfinite(part).any():
                lines = _lines({a: v for a, v in zip(AXES, part.T, strict=True) if np.isfinite(v).any()})
                title, floor = f"{kind}: measured - {name}", scene.floors.get(unit, 0.0)
                plots.append(Plot(RESIDUAL, title, unit, scene.time, lines, floor))
    return plots


def _lines(values: Mapping[str, Array]) -> tuple[Line, ...]:
    colours = line_colours(tuple(values))
    return tuple(Line(n, c, np.asarray(v, dtype=float)) for (n, v), c in zip(values.items(), colours, strict=True))
