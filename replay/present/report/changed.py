"""What changed between flights as one HTML page: verdict, picture, tables, what to inspect, how to repeat it."""

from __future__ import annotations

from wrenchgap.learn.changed.changed import Changed, Verdict
from wrenchgap.replay.present import changed as words
from wrenchgap.replay.present import what_to_inspect
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.numbers import UNIT_HEADS, number, row, unit
from wrenchgap.replay.present.posterior import classes_in_words
from wrenchgap.replay.present.report.elements import Image, Table
from wrenchgap.replay.present.report.flights import rendered

BOXES = {Verdict.CHANGED: "effect", Verdict.NOTHING: "nothing", Verdict.UNKNOWN: "unknown"}
"""How the box of the verdict looks: as that of `explain`."""


def page(found: Changed, command: str = "") -> str:
    """The whole page."""
    figure = style.figure_of(words.picture(found))
    caption = (
        "Left: what the given model leaves on average of each flight, in what healthy flights differ by. Middle: each "
        "change by itself. Right: where it is."
    )
    odd = [f"{o.flight} was given as healthy and is not: {o.effect} ({words.odds(o.odds)})." for o in found.odd]
    lacking = [f"not compared, {n.quantity}: {n.reason}." for n in found.not_compared]
    changes = [_sizes(found)] if found.parameters and found.verdict is not Verdict.NOTHING else []
    return rendered(
        "changed",
        found.flights,
        title=f"{found.model.name}: what changed on {', '.join(found.suspect)}",
        vehicle=found.model.vehicle.name,
        verdict=BOXES[found.verdict],
        summary=[words.summary(found), *odd, *classes_in_words(found.classes)],
        caveat=" ".join(s[0].upper() + s[1:] for s in (words.baseline(found), *words.feedback(found))),
        chart=Image.of(figure, "Flights, changes, and the vehicle from above.", caption, "svg"),
        view=None,
        tables=[
            *changes,
            _alone(found),
            _flights(found),
            *([_values(found)] if any(r.values for r in found.rows) else []),
        ],
        inspect=what_to_inspect.sentences(found),
        notes=[*lacking, *words.notes(found)],
        command=command,
    )


def _sizes(found: Changed) -> Table:
    rows = [
        [
            *(p.effect, p.name, p.where),
            *(number(v) for v in (p.healthy, p.scatter, p.suspect, p.change)),
            *(number(p.std, 2), unit(p.unit), f"{p.significance:.1f}"),
        ]
        for p in found.parameters
    ]
    heads = ("effect", "parameter", "where", "healthy", "scatter", "suspect", "change", "±", "unit", "significance")
    return Table(heads, rows, left=3, texts=(8,), caption=f"Changes. {words.SIZES_LEGEND}.")


def _alone(found: Changed) -> Table:
    rows = [
        [a.effect, s.name, s.where, number(s.change), unit(s.unit), f"{s.significance:.1f}", f"{a.odds:.1f}"]
        for a, s in ((a, a.largest) for a in found.alone[: words.MOST])
    ]
    heads = ("effect", "parameter", "where", "change", "unit", "significance", "log odds")
    return Table(heads, rows, left=3, texts=(4,), caption=f"Each change by itself. {words.ALONE_LEGEND}.")


def _flights(found: Changed) -> Table:
    rows = [[r.flight, r.role, *row(r.mean)] for r in found.rows]
    rows.append(["scatter", "", *row(found.scatter)])
    heads = ("flight", "", *UNIT_HEADS)
    return Table(heads, rows, left=2, caption="Mean residual of the given model by flight, signed.")


def _values(found: Changed) -> Table:
    heads, rows, left = words.by_flight(found)
    return Table(heads, rows, left=left, caption="What changed, on each flight by itself.")
