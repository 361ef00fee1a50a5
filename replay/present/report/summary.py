"""A report in a few lines, in plain types and as a table of pandas."""

from __future__ import annotations

from typing import Any

from wrenchgap.flight.flight import AXES
from wrenchgap.plant import trajectory_file
from wrenchgap.replay.present import explanation, learning, staircase, timing, where
from wrenchgap.replay.present.checks import checks_json
from wrenchgap.replay.present.design import advice
from wrenchgap.replay.present.notes import sentences
from wrenchgap.replay.present.numbers import entries, unmeasured
from wrenchgap.replay.present.report.repetition import Repetition, Request
from wrenchgap.replay.present.report.words import rest, where_on, why_not
from wrenchgap.replay.present.tables import Line, Part
from wrenchgap.replay.report.contents import NextFlight, Report


def parts(report: Report) -> list[Part]:
    """The verdict, and by how much the error is reduced."""
    return [
        Line(explanation.summary(report.explanation), "bold"),
        *(Line(staircase.sentence(case)) for case in report.staircases),
    ]


def to_json(report: Report, repetition: Repetition | None = None) -> dict[str, Any]:
    """The body of the `report` schema; without a `repetition`, one is made with the model's own name."""
    repetition = repetition or Repetition.of(report, Request(str(report.model.path or report.model.name)))
    absorbed = report.rest.absorption
    return {
        "axes": list(AXES),
        "unmeasured": unmeasured(report.explanation.noise),
        "summary": explanation.summary(report.explanation),
        "explain": explanation.to_json(report.explanation),
        "staircases": [staircase.to_json(case) for case in report.staircases],
        "absorbs": None if absorbed is None else learning.absorption_json(absorbed),
        "where": {"on": where_on(report), **{k: where.to_json(getattr(report, k)) for k in ("before", "after")}},
        "next_flights": [_next_flight_json(flight) for flight in report.next_flights],
        "fitted_model": repetition.fitted_model,
        "commands": list(repetition.commands),
        "options": dict(repetition.options),
        "packages": dict(repetition.versions),
        **checks_json(report),
        "notes": [*([rest(report.rest)] if report.rest.absent else []), *sentences(report.notes)],
        "timing": [timing.to_json(one) for one in report.explanation.timing],
    }


def _next_flight_json(flight: NextFlight) -> dict[str, Any]:
    design = flight.design
    if design is None:
        return {"effects": list(flight.names), "trajectory": None, "why_not": why_not(flight)}
    names = ("separable", "separation_before=before.separation", "separation_expected=expected.separation")
    return {
        "effects": list(flight.names),
        "trajectory": trajectory_file.dumps(design.file),
        "segments": [str(s) for s in design.segments],
        **entries(design, *names),
        "advice": list(advice(design)),
    }


def frame(report: Report) -> list[dict[str, Any]]:
    """One row for each step of each staircase: time, step, error in all and by axis."""
    rows = []
    for case in report.staircases:
        for stair in (*case.stairs, case.noise):
            axes = {f"rms.{axis}": float(v) for axis, v in zip(AXES, stair.rms, strict=True)}
            rows.append({"on": str(case.basis), "step": staircase.label(stair), "in_all": stair.in_all, **axes})
    return rows
