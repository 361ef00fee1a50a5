"""The plots of a flight: from the quantities of a scene to titles, colours and lines."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.viewer.colours import Colour, colour_of, line_colours
from wrenchgap.viewer.session import Scene

WRENCHES, RESIDUAL, CHANNELS = "Wrench", "Residual", "Log"
GROUPS = (WRENCHES, RESIDUAL, "Tracking", "Actuators", "Correction", CHANNELS)
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
        lines = ((line.name, line.colour, line.sigma is not None) for line in self.lines)
        return (self.group, self.title, self.shown_unit, *lines)

    def at(self, time: float, of: str = "values") -> Array:
        """`values` or `sigma` of all lines at the last sample that is not after `time`; nan where there is none."""
        k = int(np.searchsorted(self.time, time + 1e-9, side="right")) - 1
        columns = [getattr(line, of) for line in self.lines]
        return np.array([np.nan if c is None or not 0 <= k < len(c) else c[k] for c in columns])


def plots_of(scene: Scene) -> list[Plot]:
    """The plots of a flight, tab by tab: torques first, because most effects show there first.

    All plots of a tab in the same unit have one prefix, so that they compare. A plot of less than 1 % of the largest
    of them has one of its own: its ticks would have too many digits.
    """
    series = [Plot(s.group, s.title, s.unit, s.time, _lines(s.values), s.floor) for s in scene.series]
    plots = [*_wrenches(scene), *_residuals(scene), *series]
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
            lines = []
            for name, wrench in scene.wrenches.items():
                sigma = scene.sigma[name][:, column] if name in scene.sigma else None
                if np.isfinite(wrench[:, column]).any():
                    known = sigma is not None and np.isfinite(sigma).any()
                    lines.append(Line(name, colour_of(name), wrench[:, column], sigma if known else None))
            if lines:
                floor = scene.floors.get(unit, 0.0)
                plots.append(Plot(WRENCHES, f"{kind} {axis}", unit, scene.time, tuple(lines), floor))
    return plots


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


PREFIXES = ((0.1, 1.0, ""), (1e-4, 1e3, "m"), (0.0, 1e6, "\u00b5"))
"""From which size on [unit], the factor of the shown numbers, and the letter of the SI."""
PREFIXED = ("N", "Nm", "rad", "rad/s", "m", "m/s")
"""Units that take a prefix; others have one already, or are not of the SI."""


def prefixed(unit: str, largest: float) -> tuple[float, str]:
    """Factor and unit in which sizes up to `largest` [unit] are shown, e.g. 1e3 and "mNm"."""
    if unit not in PREFIXED or not np.isfinite(largest):
        return 1.0, unit
    factor, letter = next((factor, letter) for least, factor, letter in PREFIXES if largest >= least)
    return factor, letter + unit


def limits(values: Array, floor: float = 0.0) -> tuple[float, float]:
    """Range of an axis: all finite values with a margin, about their middle.

    At least `floor`, 1e-6 [unit] and 1e-9 of the values high: below that a curve is rounding noise.
    """
    finite = values[np.isfinite(values)]
    if not finite.size:
        return -1.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    least = max(floor, 1e-6, 1e-9 * max(abs(low), abs(high)))
    half = max(0.56 * (high - low), 0.5 * least)
    middle = 0.5 * (low + high)
    return middle - half, middle + half


def ticks(low: float, high: float, most: int = 5, letters: int = 7) -> tuple[tuple[float, ...], tuple[str, ...]]:
    """Round numbers within a range, at most `most`, and each as text with the digits that tell it from the next.

    Where that takes more `letters` than fit beside a chart, as for a latitude, the first is written shortly and the
    others as what is added to it.
    """
    rough = (high - low) / most
    power = 10.0 ** np.floor(np.log10(rough))
    step = float(next(s for s in (1.0, 2.0, 2.5, 5.0, 10.0) if s * power >= rough * (1.0 - 1e-9)) * power)
    first, last = int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9))
    places = tuple(k * step for k in range(first, last + 1))
    decimals = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    decimals += round(step * 10.0**decimals, 6) % 1.0 > 0.0  # of a step of 2.5
    words = tuple(f"{place:.{decimals}f}" if k else "0" for k, place in enumerate(places, first))
    if max(map(len, words), default=0) > letters:
        words = (f"{places[0]:.5g}", *(f"+{k * step:.3g}" for k in range(1, len(places))))
    return places, words
