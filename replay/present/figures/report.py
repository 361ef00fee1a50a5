"""Pictures of a report: the error step by step, the residual before and after, what changed between flights.

`picture` is the first of them; its axes are (7,): the error in all, then one for each axis of the wrench.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.changed.changed import Changed, Verdict
from wrenchgap.learn.data.comparison import Comparison
from wrenchgap.learn.identify.staircase import Basis, Staircase
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.numbers import AXIS_HEADS, quantity, share, unit_of
from wrenchgap.replay.present.staircase import label, remains
from wrenchgap.replay.present.what_to_inspect import INSPECTION
from wrenchgap.replay.report import Report

COLOURS = {Basis.HELD_OUT: "#4c72b0", Basis.UNSEEN: "#dd8452"}
TITLES = {Basis.HELD_OUT: "held-out time", Basis.UNSEEN: "unseen flights"}


def picture(report: Report) -> style.Picture:
    """The error step by step: in all as a share of the nominal one, and rms by axis, with the noise."""

    def split(figure: Any) -> Any:
        left, right = figure.subfigures(1, 2, width_ratios=[1.0, 1.5])
        return np.array([left.subplots(), *right.subplots(2, 3, sharex=True).ravel()], dtype=object)

    def draw(axes: Any) -> None:
        _in_all(axes[0], report.staircases)
        for axis, panel in enumerate(axes[1:]):
            _by_axis(panel, report.staircases, axis)

    return style.Picture((7,), (12.0, 4.8), draw, split=split)


def _in_all(panel: Any, cases: Sequence[Staircase]) -> None:
    names = [*map(label, cases[0].falling), "sensor noise"]
    stairs = [(*case.falling, case.noise) for case in cases]
    rows = [
        (TITLES[case.basis], COLOURS[case.basis], [100.0 * case.share(s) for s in own])
        for case, own in zip(cases, stairs, strict=True)
    ]
    for case, own, bars in zip(cases, stairs, style.bars(panel, rows), strict=True):
        panel.bar_label(bars, [remains(case, s).removesuffix(" %") for s in own], fontsize=style.SMALL, padding=1)
        bars[-1].set(facecolor="white", edgecolor=COLOURS[case.basis], linestyle="--")
    panel.set_xticks(range(len(names)), names, rotation=25, ha="right", fontsize=style.USUAL)
    panel.set_ylabel("RMS error, all axes [% of nominal]")
    panel.margins(y=0.12)
    style.legend(panel)
    style.grid(panel)


def _by_axis(panel: Any, cases: Sequence[Staircase], axis: int) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    unit = unit_of(axis)
    if np.isnan([s.rms[axis] for case in cases for s in case.falling]).all():
        style.nothing(panel, f"{AXIS_HEADS[axis]}: not measured")
        return
    factor, prefix = style.prefixed(float(np.nanmax([s.rms[axis] for case in cases for s in case.falling])), unit)
    for case in cases:
        values = [float(s.rms[axis]) for s in case.falling]
        colour = COLOURS[case.basis]
        panel.plot(np.arange(len(values)), values, color=colour, marker="o", ms=4, lw=1.0, drawstyle="steps-mid")
        panel.axhline(float(case.noise.rms[axis]), color=colour, lw=0.9, ls="--")
    names = [*map(label, cases[0].falling)]
    panel.set_xticks(np.arange(len(names)), names, rotation=35, ha="right", fontsize=7)
    panel.set_title(f"{AXIS_HEADS[axis]} [{prefix}{unit}]", fontsize=style.USUAL, loc="left")
    panel.set_yscale("log")
    low, high = panel.get_ylim()
    panel.set_ylim(low / 1.2, max(high * 1.2, low * 10.0))
    panel.yaxis.set_major_locator(LogLocator(10.0, (1.0, 3.0)))
    panel.yaxis.set_minor_locator(NullLocator())
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value * factor:.3g}"))
    panel.tick_params(axis="y", labelsize=style.SMALL)
    style.grid(panel)


def residuals(comparison: Comparison, first: int, last: int) -> style.Picture:
    """Residual of two of the compared models over time on the first flight, all axes, with twice the noise."""
    flight = comparison.flights[0]
    parts = [k for k, record in enumerate(comparison.records) if record.flight == flight]
    ends = (float(comparison.records[parts[0]].time[0]), float(comparison.records[parts[-1]].time[-1]))

    def draw(axes: Any) -> None:
        for axis in range(6):
            panel = axes[axis % 3][1 if axis < 3 else 0]
            if np.isnan(comparison.noise[axis]):
                style.nothing(panel, f"{style.QUANTITIES[axis][0]}: not measured")
                continue
            style.band(panel, ends, 2.0 * float(comparison.noise[axis]), "2 sigma of the sensors")
            for k in parts:
                record = comparison.records[k]
                share = float(record.time[-1] - record.time[0]) / (ends[1] - ends[0])
                for index, colour, name in (
                    (first, "0.65", "nominal"),
                    (last, COLOURS[Basis.HELD_OUT], "with all steps"),
                ):
                    residual = record.measured[:, axis] - comparison.evaluations[index].predictions[k][:, axis]
                    style.curve(panel, record.time, residual, colour, name, share=share)
            name, unit = style.QUANTITIES[axis]
            style.labelled(panel, name, unit, size=style.SMALL)
            panel.margins(x=0.01)
            style.grid(panel)
        for panel in axes[2]:
            panel.set_xlabel(f"time in {flight} [s]")
        style.legend(axes[0][1])

    return style.Picture((3, 2), (12.0, 5.2), draw, share="col")


ROLE_COLOURS = {"healthy": "0.55", "odd": "tab:orange", "suspect": "tab:red"}


def vehicle_marks(found: Changed) -> tuple[dict[str, str], Array | None]:
    """Parts of the vehicle to mark, with a few words on each, and where the centre of mass moved (3,) [m], if it did.

    Of nothing that changed nothing is marked.
    """
    marks: dict[str, str] = {}
    moved_B: Array | None = None
    if found.verdict is Verdict.NOTHING:
        return marks, moved_B
    by_name = {(p.effect, p.name): p for p in found.parameters}
    for place in found.places:
        if place.probability >= INSPECTION.likely:
            size = by_name.get((place.effect, place.parameter))
            change = ""
            if size is not None:
                by = f"{100 * size.change:+.0f} %" if size.unit == "1" else quantity(size.change, size.unit, 2)
                change = f"{place.effect} {by}"
            sure = "" if place.probability >= INSPECTION.sure else f"{share(place.probability)}"
            marks[place.parameter] = ", ".join(filter(None, (change, sure)))
    for name in found.names:
        if name.startswith("imu_") or name == "accelerometer_bias":
            marks["imu"] = name
        if name in ("com_offset", "payload"):
            moved_B = np.array([by_name[name, a].change if (name, a) in by_name else 0.0 for a in "xyz"])
            marks["com"] = "moved"
    return marks, moved_B


def means(found: Changed, panel: Any, band: float = 2.0) -> None:
    """Signed means of the residual by flight, in standard deviations between healthy flights; a band of +- `band`."""
    known = np.flatnonzero(np.isfinite(found.scatter))
    usual = np.mean([r.mean for r in found.rows if r.role == "healthy"], axis=0)
    panel.axhspan(-band, band, color=style.NOISE, alpha=0.15, lw=0, label=f"{band:g} scatter of healthy flights")
    for k, role in enumerate(ROLE_COLOURS):
        for r in [r for r in found.rows if r.role == role]:
            at = np.arange(len(known)) + 0.16 * (k - 1)
            heights = ((r.mean - usual) / found.scatter)[known]
            panel.plot(at, heights, "o", color=ROLE_COLOURS[role], ms=6, alpha=0.8, label=role)
    panel.set_xticks(range(len(known)), [AXIS_HEADS[k] for k in known])
    style.labelled(panel, "mean residual from that of healthy flights", "scatter")
    style.grid(panel)
    style.legend(panel)


def changes(found: Changed, panel: Any, most: int = 12) -> None:
    """Each change by itself, in standard deviations; the likeliest `most`."""
    shown = found.alone[:most][::-1]
    if not shown:
        style.nothing(panel, "no effect of the catalogue could be tried")
        return
    colours = ["tab:red" if a.effect in found.names else "0.75" for a in shown]
    largest = [a.largest for a in shown]
    names = [f"{s.effect}: {s.where if s.name.startswith(('rotor_', 'arm_')) else s.name}" for s in largest]
    panel.barh(range(len(shown)), [s.significance for s in largest], 0.7, color=colours)
    panel.set_yticks(range(len(shown)), names, fontsize=style.SMALL)
    style.labelled(panel, "each change by itself", "standard deviations", "x")
    style.grid(panel, without="y")
