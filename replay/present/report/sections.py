"""What each section of the page shows: one function a section, its values by name for the template of that section.

Texts are escaped by the templates, never here.
"""

from __future__ import annotations

import base64
import inspect
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchgap.learn import Explanation, Verdict, Where
from wrenchgap.learn.identify.least_squares import MISFIT
from wrenchgap.learn.identify.staircase import Staircase
from wrenchgap.plant.effects import find
from wrenchgap.plant.trajectory import file as trajectory_file
from wrenchgap.replay.present import (
    comparison,
    design,
    detection,
    explanation,
    history,
    learning,
    prediction,
    staircase,
    timing,
    where,
)
from wrenchgap.replay.present.figures import report as charts
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.figures import where as where_figures
from wrenchgap.replay.present.notes import not_tried, sentences
from wrenchgap.replay.present.numbers import UNIT_HEADS, capitalised, label, number, row, separation, share, unit
from wrenchgap.replay.present.report import summary
from wrenchgap.replay.present.report.repetition import FITTED, Repetition
from wrenchgap.replay.present.tables import Table, captioned, first_only, styled, table
from wrenchgap.replay.report import NextFlight, Report

Content = Mapping[str, Any]


@dataclass(frozen=True)
class Image:
    """A chart inside the page, a text for those who do not see it, and a caption."""

    src: str
    alt: str
    caption: str

    @classmethod
    def of(cls, picture: style.Picture, alt: str, caption: str, form: str = "png") -> Image:
        """A picture; a dense one as PNG, a sparse one as SVG, which stays sharp on paper."""
        stream = io.BytesIO()
        style.save(picture, stream, form)
        kind = "svg+xml" if form == "svg" else form
        return cls(data_uri(stream.getvalue(), f"image/{kind}"), alt, caption)


@dataclass(frozen=True)
class Saved:
    """A text that the page shows and lets a reader save as a file."""

    name: str
    text: str

    @property
    def href(self) -> str:
        """The file inside a link."""
        return data_uri(self.text.encode(), "application/toml")


def data_uri(content: bytes, kind: str) -> str:
    """Content as an address that fetches nothing."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def of_timing(report: Report, _: Repetition) -> Content:
    """Offsets between the topics of each flight, and what to do about them."""
    return {
        "flights": [
            (one.flight, table("", ("offset",), [[text] for text in timing.sentences(one)]), timing.warnings(one))
            for one in report.explanation.timing
        ]
    }


def of_error(report: Report, _: Repetition) -> Content:
    """The error step by step."""
    said = " ".join(map(staircase.sentence, report.staircases))
    caption = (
        "Each step adds one effect; all effects up to there are fitted together. Left: all axes on one scale, newton "
        "metres divided by a length of the vehicle's size. Right: RMS by axis, logarithmic; dashed: sensor noise "
        "behind the filter. Held-out time is predicted by parameters that were fitted without it; on unseen flights "
        "the accelerometer's bias is not estimated."
    )
    absorbed = report.rest.absorption
    absorbs = "" if absorbed is None else learning.absorption_in_words(absorbed) or "the GP absorbs no known effect."
    return {
        "chart": Image.of(charts.picture(report), f"Error step by step. {said}", caption, "svg"),
        "tables": [_steps(case) for case in report.staircases],
        "rest": summary.rest(report.rest),
        "residual": _residual(report),
        "absorbs": capitalised(absorbs),
    }


def _steps(case: Staircase) -> Table:
    stairs = (*case.stairs, case.noise)
    names = [staircase.label(s) + (" (learnt on these logs: in-sample)" if s.learnt_here else "") for s in stairs]
    caption = f"RMS on {staircase.title(case)}. All axes: share of the nominal error."
    caption += " In italics: no step, for comparison." if any(s.beside for s in stairs) else ""
    out = table("", ("", "all axes", *UNIT_HEADS), caption=caption)
    for name, s in zip(names, stairs, strict=True):
        out.add_row(name, staircase.remains(case, s), *row(s.rms), style="italic" if s.beside else "")
    return out


def _residual(report: Report) -> Image | None:
    """The residual over time before and after all steps, on the first unseen flight."""
    compared, case = report.comparison, report.staircases[-1]
    if compared is None or len(case.falling) < 2:
        return None
    last = case.stairs.index(case.falling[-1])
    alt = f"Measured minus predicted wrench over time on {compared.flights[0]}, before and after."
    caption = "Residual: measured minus predicted wrench. The table above has its RMS."
    return Image.of(charts.residuals(compared, 0, last), alt, caption)


def of_ranking(report: Report, _: Repetition) -> Content:
    """Candidates, the steps of the search, the members of the set."""
    found = report.explanation
    if not found.ranking:
        return {"chart": None}
    alt = f"Effects ranked by the share of the error energy that each removes; first {found.ranking[0].name}."
    caption = "Each effect fitted alone, on top of the given model; judged on held-out time."
    named = captioned(explanation.members(found), f"Named. {explanation.MEMBERS_LEGEND}.")
    return {
        "chart": Image.of(explanation.picture(found), alt, caption, "svg"),
        "first": captioned(explanation.ranking(found, 12), f"Each effect alone. {explanation.RANKING_LEGEND}."),
        "classes": explanation.open_in_words(found),
        "members": named if found.members else None,
        "groups": "; ".join(" or ".join(group) for group in found.groups),
    }


def of_parameters(report: Report, _: Repetition) -> Content:
    """The fitted parameters with intervals, and what each effect is."""
    fitted = report.addition.fit
    rows = []
    names = first_only(name for name, _ in fitted.parameters)
    for first, (name, p), value, std in zip(names, fitted.parameters, fitted.theta, fitted.std, strict=True):
        low, high = (number(float(value + side * std)) for side in (-1.96, 1.96))
        limits = f"{number(p.low)} to {number(p.high)}" + (" !" if f"{name}.{p.name}" in fitted.at_bound else "")
        named = label(p.name, report.addition.model.vehicle)
        rows.append([first, named, unit(p.unit), number(float(value), 4), f"{low} to {high}", limits])
    caption = (
        "All effects of the model, fitted together to all given logs. The intervals follow from the scatter between "
        "blocks of time, as neighbouring samples are not independent; a standard deviation is never below "
        f"{100 * MISFIT:.0f} % of the value, because the forms of effects are right to a few per cent only."
    )
    heads = ("effect", "parameter", "unit", "value", "95 % interval", "plausible")
    return {
        "table": table("", heads, rows, left=3, caption=caption) if rows else None,
        "at_bound": ", ".join(fitted.at_bound),
        "effects": [(name, inspect.cleandoc(find(name).__class__.__doc__ or "")) for name in names if name],
    }


def of_where(report: Report, _: Repetition) -> Content:
    """Where the given and the fitted model fail."""
    pair = [("Given model", report.before)]
    if report.after is not report.before:
        pair.append(("Fitted model", report.after))
    return {"on": summary.where_on(report), "models": [{"title": title, **_maps(found)} for title, found in pair]}


def _maps(found: Where) -> dict[str, Any]:
    shown = where_figures.shown(found)
    alt = f"Error of {found.name} against {', '.join(d.label for d in shown)}."
    caption = "RMS of the force and of the torque residual against what the vehicle did; pale: sensor noise."
    grid = found.failure_map.grid
    over = "" if grid is None else f"{grid.x_label} and {grid.y_label}"
    empty = grid is not None and np.isnan([grid.force, grid.torque]).all()
    alone = f"RMS over {over}; empty where samples are too few."
    return {
        "summary": where.summary(found),
        "maps": Image.of(where_figures.maps_picture(found), alt, caption) if shown else None,
        "table": where.quantities(found),
        "grid": grid
        and not empty
        and Image.of(where_figures.grid_picture(found), alone, f"{alone} Each map has its own scale."),
        "no_grid": f"No map over {over}: no cell has {grid.fewest:g} independent samples; that takes a longer flight."
        if grid is not None and empty
        else "",
        "worst": comparison.worst(found.name, found.worst),
    }


def of_ahead(report: Report, _: Repetition) -> Content:
    """How far the models are off when they predict the motion without correction."""
    found = report.ahead
    if found is None:
        return {"summary": report.not_ahead, "chart": None, "table": None}
    said, errors = prediction.summary(found), captioned(prediction.errors(found), f"{prediction.LEGEND.capitalize()}.")
    caption = f"From the recorded state, by the logged commands alone; on {summary.where_on(report)}."
    return {"summary": said, "chart": Image.of(prediction.picture(found), said[0], caption, "svg"), "table": errors}


def of_residual(report: Report, _: Repetition) -> Content:
    """What the nominal error is made of, and what the residual of the fitted model looks like."""
    found, names = report.after, where_figures.NAMES
    parts = (f"{names[part].capitalize()} {share(value)}" for part, value in found.budget.whole().items())
    alt = f"Of the nominal error energy: {', '.join(parts)}"
    predicted = "Shares of the residual's variance on held-out time that the inputs predict."
    energy = "What the nominal error energy is made of, by axis."
    return {
        "budget": Image.of(where_figures.budget_picture(found), alt, energy),
        "shares": where.budget_table(found.budget),
        "white": where.whiteness(found),
        "correlations": Image.of(
            where_figures.correlation_picture(found),
            "Autocorrelation of the residual, and its strongest correlation with an input.",
            "Grey: what filtered sensor noise would show, and its band.",
        ),
        "inputs": captioned(where.relevance(found), predicted),
    }


def of_next(report: Report, _: Repetition) -> Content:
    """Flights that would separate what is indistinguishable, and what these flights cannot show."""
    unknown = report.explanation.verdict is Verdict.UNKNOWN
    chosen = report.after.relevance.chosen if unknown else ()
    return {
        "flights": [_next_flight(flight, place) for place, flight in enumerate(report.next_flights, 1)],
        "unshown": _shown_by(report.unshown) if report.unshown else None,
        **_sensitivity(report.explanation),
        "depends": ", ".join(g.label for g in chosen),
    }


def _sensitivity(found: Explanation) -> Content:
    """What these flights could have shown."""
    if not found.limits:
        return {"limits": None}
    caption = "Each parameter by itself, beside what is named. A short bar says that only a large change would show."
    alt = "The smallest change of each effect that would have been firm, as a share of what is plausible."
    heads = ("effect", "parameter", "unit", "firm from", "plausible to", "instead")
    rows = []
    for one in found.limits:
        named, sizes = label(one.parameter, found.model.vehicle), (number(one.size, 2), number(one.plausible, 2))
        rows.append([one.effect, named, unit(one.unit), *sizes, " or ".join(one.instead)])
    return {
        "limits": Image.of(detection.picture(found), alt, caption, "svg"),
        "said": detection.sentences(found),
        "sizes": table(
            "", heads, rows, left=3, texts=(5,), caption="The smallest change of each that would have been firm."
        ),
    }


def _shown_by(names: Sequence[str]) -> Table:
    return table("", ("effect", "what shows it"), [[name, find(name).excited_by] for name in names], left=2)


def _next_flight(flight: NextFlight, place: int) -> dict[str, Any]:
    title, shown_by = f"To separate {' from '.join(flight.names)}", _shown_by(flight.names)
    found = flight.design
    if found is None:
        return {"title": title, "shown_by": shown_by, "file": None, "why_not": summary.why_not(flight)}
    rows = [
        [f.truth, imitator, separation(value), f"{np.degrees(f.tilt_max):.0f}", f"{f.speed_max:.1f}"]
        for f in found.flown
        for imitator, value in f.separation.items()
    ]
    heads = ("effect in the vehicle", "effect in the model", "separation", "largest tilt [deg]", "speed [m/s]")
    caption = "The same flight on the simulated vehicle."
    return {
        "title": title,
        "shown_by": shown_by,
        "file": Saved(f"next-flight-{place}.toml", trajectory_file.dumps(found.file)),
        "words": summary.designed(found),
        "table": table("", heads, rows, left=2, caption=caption) if found.flown else None,
        "advice": () if found.separable else design.advice(found),
    }


def of_not_tried(report: Report, _: Repetition) -> Content:
    """Effects that these logs or this model do not allow, by reason."""
    reasons = not_tried(report.explanation.untried)
    return {"reasons": [f"{', '.join(names)}: {reason}" for reason, names in reasons.items()]}


def of_repetition(report: Report, repetition: Repetition) -> Content:
    """Commands, inputs, options, versions, the fitted model."""
    inputs = [(role, file, styled(sha256, "code")) for role, file, sha256 in repetition.inputs]
    return {
        "commands": "\n".join(repetition.commands),
        "inputs": table("", ("input", "file", "SHA-256"), inputs, left=3),
        "options": table("", ("option", "value"), repetition.options, left=2),
        "versions": table("", ("package", "version"), repetition.versions, left=2),
        "history": history.table_of_versions(report.model) if report.model.history else None,
        "fitted": Saved(FITTED, repetition.fitted_model),
        "notes": sentences(report.notes),
    }


SECTIONS: tuple[tuple[str, str, Callable[[Report, Repetition], Content]], ...] = (
    ("timing", "Timing", of_timing),
    ("error", "Error step by step", of_error),
    ("ranking", "Which effect is missing", of_ranking),
    ("parameters", "Parameters", of_parameters),
    ("where", "Where the model fails", of_where),
    ("ahead", "How far it predicts the motion", of_ahead),
    ("left", "Residual", of_residual),
    ("fly", "What to fly next", of_next),
    ("not-tried", "What was not tried", of_not_tried),
    ("repeat", "How to repeat this", of_repetition),
)
"""Anchor, which is also the name of the template, title and content of each section."""
