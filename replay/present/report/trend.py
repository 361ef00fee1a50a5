"""What `trend` found as one HTML page: sentences, the picture, where on the vehicle, tables, and how to repeat it."""

from __future__ import annotations

import numpy as np

from wrenchgap.learn.identify.course import Verdict
from wrenchgap.learn.identify.trend import ParameterTrend, Trend
from wrenchgap.plant.vehicle import PART
from wrenchgap.replay.present import trend as words
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.figures import vehicle as top_view
from wrenchgap.replay.present.numbers import label, number, quantity, unit
from wrenchgap.replay.present.report.elements import Image, Table
from wrenchgap.replay.present.report.flights import rendered


def page(found: Trend, command: str = "") -> str:
    """The whole page."""
    figure = style.figure_of(words.picture(found))
    caption = (
        f"Every flight fitted by itself. Band: {words.SIGMAS:g} times the scatter of the flights about their level; "
        "dashed: a step."
    )
    return rendered(
        "trend",
        found.flights,
        title=f"{found.model.name}: {', '.join(found.effects)} over {len(found.flights)} flights",
        vehicle=found.model.vehicle.name,
        verdict="unknown" if found.changed else "nothing",
        summary=words.summary(found),
        caveat=words.CAVEAT if found.changed else "",
        chart=Image.of(figure, "Parameters over the flights.", caption, "svg"),
        view=view(found),
        tables=[_parameters(found), *([_steps(found)] if found.changed else []), _values(found)],
        notes=words.notes(found),
        command=command,
    )


def view(found: Trend) -> Image | None:
    """The vehicle from above with the rotors and arms whose parameters changed; None where none did."""
    marks, moved = marked(found)
    if not marks:
        return None
    figure = style.figure_of(top_view.picture(found.model.vehicle, marks, moved_B=moved))
    alt = f"The vehicle from above; marked: {', '.join(words.places(found))}."
    caption = "The change from the first flights to the last; an arrow shows a direction, no size."
    return Image.of(figure, alt, caption, "svg")


def marked(found: Trend) -> tuple[dict[str, str], np.ndarray | None]:
    """Parts of the vehicle to mark, with their change in words; by how much the centre of mass moved (3,) [m]."""
    marks, moved = {}, np.zeros(3)
    for p in found.changed:
        change = float(p.course.level[-1] - p.course.level[0])
        if PART.fullmatch(p.name):
            marks[p.name] = f"{p.effect} {'+' if change > 0 else ''}{quantity(change, p.unit, 2)}"
        elif p.effect == "com_offset":
            moved["xyz".index(p.name)] = change
    if np.any(moved):
        marks["com"] = f"moved by {style.written(float(np.linalg.norm(moved)), 'm')}"
    return marks, moved if np.any(moved) else None


def _name(p: ParameterTrend, found: Trend) -> str:
    return f"{p.effect} {label(p.name, found.model.vehicle)}"


def _parameters(found: Trend) -> Table:
    rows = []
    for p in found.parameters:
        sizes = (float(p.values.mean()), p.course.scatter, float(np.median(p.errors)))
        rows.append([_name(p, found), words.WORDS[p.course.verdict], *(number(v) for v in sizes), unit(p.unit)])
    heads = ("parameter", "over the flights", "mean", "scatter", "error", "unit")
    return Table(heads, rows, left=2, texts=(5,), caption=f"Parameters. {words.LEGEND}.")


def _steps(found: Trend) -> Table:
    rows = []
    for p in found.changed:
        for s in p.course.steps:
            sizes = [number(v) for v in (s.before, s.after, s.size)]
            interval = f"{number(s.low)} to {number(s.high)}"
            place = f"{s.flight + 1} {found.names[s.flight]}"
            rows.append([_name(p, found), place, *sizes, interval, unit(p.unit), f"{s.t:.1f}", f"{s.p:.1g}"])
        if (line := p.course.drift) is not None and not p.course.steps:
            interval = f"{number(line.low)} to {number(line.high)}"
            ends = [number(float(p.course.level[k])) for k in (0, -1)]
            place = "drift, a flight"
            rows.append([_name(p, found), place, *ends, number(line.slope), interval, unit(p.unit)])
            rows[-1] += [f"{line.t:.1f}", f"{line.p:.1g}"]
    heads = ("parameter", "from flight", "before", "after", "size", "95 % interval", "unit", "t", "p")
    return Table(heads, rows, left=2, texts=(6,), caption="Steps and drifts.")


def _values(found: Trend) -> Table:
    shown = [p for p in found.parameters if p.course.verdict is not Verdict.OPEN]
    heads = ["", "flight", *(f"{_name(p, found)}{f' [{p.unit}]' if unit(p.unit) else ''}" for p in shown)]
    rows = [
        [str(k + 1), name, *(f"{number(p.values[k])} ± {number(p.errors[k], 2)}" for p in shown)]
        for k, name in enumerate(found.names)
    ]
    return Table(heads, rows, left=2, caption="Values by flight, with the standard error of that flight by itself.")
