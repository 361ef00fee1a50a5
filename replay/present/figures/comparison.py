"""Figures (PNG): commanded, measured and predicted wrench over time; residuals by flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.learn.data.comparison import Comparison
from wrenchgap.replay.present.documents import atomic, claim

Array = NDArray[np.float64]

COLOURS = {"commanded": "0.6", "measured": "black"}
PREDICTED = ("tab:blue", "tab:orange", "tab:green", "tab:red", "tab:purple", "tab:brown")
LABELS = ("force x [N]", "force y [N]", "force z [N]", "torque x [Nm]", "torque y [Nm]", "torque z [Nm]")


@dataclass(frozen=True)
class Traces:
    """Wrenches (K, 6) of one stretch over `time` (K,) [s]; `sigma` (K, 6) belongs to the last of `predicted`."""

    flight: str
    time: Array
    commanded: Array | None
    measured: Array
    predicted: Mapping[str, Array] = field(default_factory=dict)
    sigma: Array | None = None


def traces(comparison: Comparison) -> list[Traces]:
    """What a comparison has to show, by record. The nominal prediction is left to the command, which it equals."""
    out = []
    for index, record in enumerate(comparison.records):
        predicted = {e.name: e.predictions[index] for e in comparison.evaluations}
        if _equal(predicted["nominal"], record.commanded):
            del predicted["nominal"]
        last = comparison.evaluations[-1]
        sigma = None if last.sigma is None else last.sigma[index]
        out.append(Traces(record.flight, record.time, record.commanded, record.measured, predicted, sigma))
    return out


def _equal(first: Array, second: Array) -> bool:
    """Whether two wrenches look the same: force and torque each within 1 % of its own size."""
    pairs = [(first[:, part], second[:, part]) for part in (slice(0, 3), slice(3, 6))]
    return all(np.max(np.abs(a - b)) <= 0.01 * np.max(np.abs(b)) for a, b in pairs)


def wrench_figure(
    stretches: Sequence[Traces],
    path: Path,
    *,
    title: str = "",
    residuals: Comparison | None = None,
    force: bool = False,
) -> None:
    """Torques on the left, forces on the right; flights one after the other. With several flights (and `residuals`)
    a last row shows the rms by flight.
    """  # noqa: D205
    claim({"--figure": path}, force=force)
    plt = _pyplot()
    with_bars = residuals is not None
    figure, axes = plt.subplots(
        4 if with_bars else 3, 2, figsize=(14, 10 if with_bars else 8), layout="constrained", squeeze=False
    )
    offsets = _offsets(stretches)
    for axis in range(6):
        panel = axes[axis % 3][1 if axis < 3 else 0]
        for stretch, offset in zip(stretches, offsets, strict=True):
            _draw(panel, stretch, stretch.time + offset, axis)
        panel.set_ylabel(LABELS[axis])
        panel.margins(x=0.01)
        panel.grid(alpha=0.3)
        if axis % 3 == 2:
            panel.set_xlabel("time [s]" if len({s.flight for s in stretches}) == 1 else "time [s], flight after flight")
        _separators(panel, stretches, offsets, axis)
    handles, labels = axes[0][0].get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc="outside upper right", ncols=len(unique), frameon=False)
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    if residuals is not None:
        _bars(axes[3], residuals)
    try:
        with atomic(path) as partial:
            figure.savefig(partial, dpi=110, format="png")
    finally:
        plt.close(figure)


def _draw(panel: Any, stretch: Traces, time: Array, axis: int) -> None:
    if stretch.commanded is not None:
        panel.plot(time, stretch.commanded[:, axis], color=COLOURS["commanded"], lw=1.0, label="commanded")
    panel.plot(time, stretch.measured[:, axis], color=COLOURS["measured"], lw=0.9, label="measured")
    last = ""
    for (name, values), colour in zip(stretch.predicted.items(), PREDICTED * 2, strict=False):
        panel.plot(time, values[:, axis], color=colour, lw=0.9, label=name)
        last = colour
    if stretch.sigma is not None and last and np.isfinite(stretch.sigma[:, axis]).all():
        centre = list(stretch.predicted.values())[-1][:, axis]
        band = 3.0 * stretch.sigma[:, axis]
        panel.fill_between(time, centre - band, centre + band, color=last, alpha=0.18, lw=0, label="3 sigma")


def _offsets(stretches: Sequence[Traces]) -> list[float]:
    """What to add to each stretch's time so that flights follow one another."""
    offsets: list[float] = []
    end = 0.0
    for index, stretch in enumerate(stretches):
        if index == 0:
            offset = 0.0
        elif stretch.flight == stretches[index - 1].flight:
            offset = offsets[-1]
        else:
            offset = end - float(stretch.time[0])
        offsets.append(offset)
        end = float(stretch.time[-1]) + offset + 1.0
    return offsets


def _separators(panel: Any, stretches: Sequence[Traces], offsets: Sequence[float], axis: int) -> None:
    names = [s.flight for s in stretches]
    if len(set(names)) == 1:
        return
    for index, (stretch, offset) in enumerate(zip(stretches, offsets, strict=True)):
        if index and names[index] == names[index - 1]:
            continue
        start = float(stretch.time[0]) + offset
        if index:
            panel.axvline(start - 0.5, color="0.5", lw=0.8, ls="--")
        if axis % 3 == 0:
            place = ("data", "axes fraction")
            panel.annotate(stretch.flight, (start, 1.0), xycoords=place, fontsize=8, va="bottom", rotation=8)


def _bars(axes: Sequence[Any], comparison: Comparison) -> None:
    """Root mean square of the residual by flight and axis, one bar for each model."""
    count = len(comparison.evaluations)
    for panel, rows, unit in ((axes[0], range(3, 6), "Nm"), (axes[1], range(3), "N")):
        place = np.arange(3 * len(comparison.flights))
        for index, one in enumerate(comparison.evaluations):
            colour = COLOURS["commanded"] if index == 0 else PREDICTED[(index - 1) % len(PREDICTED)]
            heights = [e.rms[a] for e in one.by_flight for a in rows]
            shift = (index - (count - 1) / 2) * 0.8 / count
            panel.bar(place + shift, heights, 0.8 / count, color=colour, label=one.name)
        panel.set_xticks(place, [f"{'M' if unit == 'Nm' else 'F'}{axis}" for _ in comparison.flights for axis in "xyz"])
        _names_below(panel, comparison.flights)
        panel.set_ylabel(f"residual rms [{unit}]")
        panel.legend(fontsize=8, frameon=False)
        panel.grid(alpha=0.3, axis="y")


def _names_below(panel: Any, flights: Sequence[str]) -> None:
    """The flights' names under their groups of three bars."""
    size = 8 if len(flights) < 4 else 6
    for index, flight in enumerate(flights):
        at = (3 * index + 1, -0.18)
        place = ("data", "axes fraction")
        panel.annotate(flight, at, xycoords=place, fontsize=size, ha="center", va="top", annotation_clip=False)
        if index:
            panel.axvline(3 * index - 0.5, color="0.5", lw=0.8, ls="--")


def _pyplot() -> Any:
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    return plt
