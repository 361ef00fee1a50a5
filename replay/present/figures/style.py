"""How pictures look: colours, units on axes, legends beside the curves, long series as bands.

Data are drawn in SI units; where these are small (the torques of a small vehicle) the numbers on an axis are printed
with a prefix, which the axis' label names. So whatever a user draws into the same axes is in SI as well.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from wrenchgap._escaping import figure_text
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.flight.stamps import envelope
from wrenchgap.replay.present.numbers import number

COMMANDED, MEASURED, NOISE, WARNING = "0.6", "black", "#55a868", "tab:red"
MODELS = ("tab:blue", "tab:orange", "tab:purple", "tab:brown", "tab:olive", "tab:cyan")
FORCE, TORQUE = "tab:blue", "tab:orange"
QUANTITIES = tuple((f"{kind} {axis}", unit) for kind, unit in (("force", "N"), ("torque", "Nm")) for axis in "xyz")
"""Name and unit of the six axes of a wrench."""
SMALL, USUAL = 8, 9
"""Sizes of text [points]."""

LONGEST_LINE, LONGEST_LABEL = 300, 60
"""Characters of a title and of a label: what fits 15 and 4 inches; a longer label leaves no room for the axes."""
PREFIXES = ((0.1, 1.0, ""), (1e-4, 1e3, "m"), (0.0, 1e6, "µ"))
"""(smallest of the largest values, factor, SI prefix)."""
PREFIXED = ("N", "Nm", "m")
"""Units that take a prefix."""


@dataclass(frozen=True)
class Picture:
    """What a result looks like: `draw(axes)` fills axes of `shape`, () for a single one.

    `size` is that of a new figure [inch], `heights` the relative heights of its rows. `split` makes the axes of a new
    figure where a grid with a common time axis will not do.
    """

    shape: tuple[int, ...]
    size: tuple[float, float]
    draw: Callable[[Any], None]
    title: str = ""
    heights: Sequence[float] | None = None
    share: str | bool = False
    split: Callable[[Any], Any] | None = field(default=None)


def plot(picture: Picture, axes: Any = None) -> Any:
    """Draw into `axes`, in a new figure of pyplot where there are none; returns the axes.

    Raises UsageError for axes of another shape.
    """
    if axes is None:
        import matplotlib.pyplot as plt

        return _filled(plt.figure(figsize=picture.size, layout="constrained"), picture)
    given = np.asarray(axes, dtype=object)
    if given.size != np.prod(picture.shape, dtype=int):
        asked = f"axes of shape {picture.shape}" if picture.shape else "one axes"
        how = "".join(str(n) + ", " for n in picture.shape).rstrip(", ")
        raise UsageError(
            f"plot: got axes of shape {given.shape}, expected {asked}; make them with figure.subplots({how}), or give "
            "none and take those that are returned"
        )
    into = given.reshape(picture.shape)
    picture.draw(into if picture.shape else into.item())
    for panel in into.ravel():
        _literal(panel)
    return axes


def figure_of(picture: Picture) -> Any:
    """The picture as a figure that no window and no notebook knows."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=picture.size, layout="constrained")
    FigureCanvasAgg(figure)
    _filled(figure, picture)
    return figure


def save(picture: Picture, partial: Path | IO[bytes], form: str = "png") -> None:
    """Write the picture, as it looks everywhere: a matplotlibrc of the working folder is data, and is not obeyed."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        figure_of(picture).savefig(partial, format=form, dpi=110, metadata={"Date": None} if form == "svg" else None)


def _filled(figure: Any, picture: Picture) -> Any:
    if picture.split is not None:
        axes = picture.split(figure)
    elif not picture.shape:
        axes = figure.subplots()
    else:
        rows, columns = picture.shape
        ratios = {} if picture.heights is None else {"height_ratios": picture.heights}
        axes = figure.subplots(rows, columns, squeeze=False, sharex=picture.share, gridspec_kw=ratios)
    picture.draw(axes)
    if picture.title:
        figure.suptitle(picture.title, x=0.01, ha="left", fontsize=11)
    _literal(figure)
    return axes


def _literal(drawn: Any) -> None:
    """All texts of a figure or of axes as they are, those of ticks that have names too: a `$` begins no formula."""
    from matplotlib.axis import Axis, Tick
    from matplotlib.legend import Legend
    from matplotlib.text import Text
    from matplotlib.ticker import FuncFormatter

    class Names(FuncFormatter):
        """Of ticks that have names; those of numbers may be formulae (10^-2)."""

    def named(of: Any) -> Names:
        return Names(lambda value, place=None: figure_text(of(value, place), LONGEST_LABEL).replace("$", r"\$"))

    axes = drawn.findobj(Axis)
    for axis in axes:
        if type(axis.get_major_formatter()) is FuncFormatter:
            axis.set_major_formatter(named(axis.get_major_formatter()))
    of_ticks = {label for tick in drawn.findobj(Tick) for label in (tick.label1, tick.label2)}
    labels = {axis.label for axis in axes} | {text for one in drawn.findobj(Legend) for text in one.get_texts()}
    for text in set(drawn.findobj(Text)) - of_ticks:
        text.set_text(figure_text(text.get_text(), LONGEST_LABEL if text in labels else LONGEST_LINE))
        text.set_parse_math(False)


def labelled(panel: Any, name: str, unit: str, side: str = "y", size: float = USUAL) -> None:
    """Name and unit on an axis, with an SI prefix that suits its range; the numbers without offset and exponent."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    ends = panel.get_ylim() if side == "y" else panel.get_xlim()
    factor, prefix = prefixed(max(map(abs, ends)), unit)
    axis = panel.yaxis if side == "y" else panel.xaxis
    axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10], min_n_ticks=3))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{round(value * factor, 9):g}"))
    words = f"{name} [{prefix}{unit}]" if unit else name
    (panel.set_ylabel if side == "y" else panel.set_xlabel)(words, fontsize=size)
    axis.set_tick_params(labelsize=SMALL)


def prefixed(largest: float, unit: str) -> tuple[float, str]:
    """Factor and SI prefix with which numbers up to `largest` of this unit read well; none for other than PREFIXED."""
    if unit not in PREFIXED or np.isnan(largest):
        return 1.0, ""
    return next((factor, prefix) for least, factor, prefix in PREFIXES if largest >= least)


def written(value: float, unit: str) -> str:
    """A number of two digits with its unit, e.g. `0.22 mNm`."""
    if np.isnan(value):
        return "-"
    factor, prefix = prefixed(abs(value), unit)
    return f"{number(value * factor, 2)} {prefix}{unit}"


def grid(panels: Any, without: str = "") -> None:
    """Thin lines behind the curves, but none from the axis `without`; no frame at the top and on the right."""
    for panel in np.ravel(np.asarray(panels, dtype=object)):
        panel.grid(alpha=0.25)
        if without:
            panel.grid(visible=False, axis=without)
        panel.set_axisbelow(True)
        for side in ("top", "right"):
            panel.spines[side].set_visible(False)


def over_time(panels: Any, name: str = "time") -> None:
    """What panels (R, C) over one time have in common: margins, the axis of time below, labels in line."""
    for panel in np.ravel(panels):
        panel.margins(x=0.01)
    for panel in panels[-1]:
        labelled(panel, name, "s", "x")
    grid(panels)
    panels[0, 0].get_figure(root=False).align_ylabels(list(np.ravel(panels)))


def legend(panel: Any, *others: Any, above: float = 0.0) -> None:
    """Above a panel, `above` lines of text higher than its edge, where it covers no curve; each name once.

    It is for `others` as well, which have the same colours.
    """
    once: dict[str, Any] = {}
    for one in (panel, *others):
        for handle, label in zip(*one.get_legend_handles_labels(), strict=True):
            once.setdefault(label, handle)
    if not once:
        return
    figure = panel.get_figure(root=True)
    room = panel.get_position().width * figure.get_size_inches()[0] * 72.0
    widths = np.array([(0.55 * len(name) + 3.4) * SMALL for name in once])
    fitting = [n for n in range(1, len(once) + 1) if sum(max(widths[k::n]) for k in range(n)) <= 1.25 * room]
    place = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.2 + 1.3 * above, "borderpad": 0.1}
    look = {"fontsize": SMALL, "frameon": False, "handlelength": 1.6, "columnspacing": 1.2}
    panel.legend(once.values(), once.keys(), ncols=max(fitting, default=1), **place, **look)


def curve(
    panel: Any, time: Array, values: Array, colour: str, label: str = "", width: float = 0.9, **more: Any
) -> bool:
    """One series (N,) over time (N,): a line, or the band between its extremes where it would be a block of ink.

    It is a band where a column of pixels, 900 over the panel, holds more than eight samples, which span on average more
    than a twentieth of its whole range. No column loses a smallest or largest value. `width` is that of the line,
    `share` the part of the panel's width that the series takes; `more` is passed on to the line. Returns whether it is
    a band.
    """
    columns = max(8, round(900 * more.pop("share", 1.0)))
    x, y = envelope(time, values[None], float(time[0]), float(time[-1]), columns)
    if len(time) > 8 * columns:
        low, high = np.sort(y[0].reshape(-1, 2), axis=1).T
        whole = float(np.nanmax(high) - np.nanmin(low)) if np.isfinite(high).any() else 0.0
        if whole > 0 and float(np.nanmean(high - low)) > 0.05 * whole:
            middle = x.reshape(-1, 2).mean(axis=1)
            panel.fill_between(middle, low, high, color=colour, alpha=0.45, lw=0.3, label=label or None)
            return True
    panel.plot(x, y[0], color=colour, lw=width, label=label or None, **more)
    return False


def bars(panel: Any, rows: Sequence[tuple[str, str, Any]], noise: Any = None) -> list[Any]:
    """Groups of bars side by side from zero: `rows` of name, colour and a height for each group; the noise as lines."""
    width, made = 0.8 / len(rows), []
    for k, (name, colour, heights) in enumerate(rows):
        place = np.arange(len(heights)) + (k - (len(rows) - 1) / 2) * width
        made.append(panel.bar(place, heights, 0.95 * width, color=colour, label=name))
    if noise is not None:
        middle = np.arange(len(noise))
        panel.hlines(noise, middle - 0.45, middle + 0.45, color=NOISE, lw=2.0, label="sensor noise")
    return made


def band(panel: Any, ends: Sequence[float], half: float, label: str = "") -> None:
    """A noise floor: pale between -half and half, its edges above all curves."""
    panel.fill_between(ends, -half, half, color=NOISE, alpha=0.3, lw=0, label=label or None, zorder=0.5)
    panel.hlines((-half, half), *ends, color=NOISE, lw=0.9, zorder=3)


def nothing(panel: Any, words: str) -> None:
    """A panel without data says why."""
    panel.set_axis_off()
    panel.text(0.0, 0.5, words, fontsize=USUAL, color="0.35", transform=panel.transAxes, wrap=True)


def shortened(name: str, most: int = 28) -> str:
    """A long name with its middle left out."""
    return name if len(name) <= most else f"{name[: most // 2 - 1]}...{name[-(most // 2 - 2) :]}"
