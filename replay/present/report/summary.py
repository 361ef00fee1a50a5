"""A report in sentences, in plain types and as a table of pandas."""

from typing import Any

from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.design.design_result import Design
from wrenchgap.plant.trajectory import file as trajectory_file
from wrenchgap.replay.present import answer, explanation, fitted_effects, learning, staircase, timing, where
from wrenchgap.replay.present.design import advice
from wrenchgap.replay.present.notes import checks_json, sentences
from wrenchgap.replay.present.numbers import by_axis, entries, separation, unmeasured
from wrenchgap.replay.present.report.repetition import Repetition
from wrenchgap.replay.present.tables import Line, Part
from wrenchgap.replay.report import Absent, NextFlight, Report, Rest

ABSENT = {
    Absent.NOISE: "The residual of the last step is sensor noise: a Gaussian process has nothing to learn.",
    Absent.SHORT: "There is too little data to hold anything out for a Gaussian process.",
    Absent.USELESS: "A Gaussian process of the commanded wrench does not reduce the error on held-out time.",
}


def rest(found: Rest) -> str:
    """What the Gaussian process among the steps is, or why there is none."""
    process = found.process
    if process is None:
        return "" if found.absent is None else ABSENT[found.absent]
    axes = ", ".join(process.gp.outputs)
    if process.given:
        return f"The given GP predicts {axes}; it is added to the model as given."
    return (
        f"A Gaussian process of the commanded wrench, learnt for this report from the residual of the last step, "
        f"reduces the error of {axes}; on held-out time it is predicted by processes that did not see that time. It "
        "has no physical name: it shows how much remains to be explained."
    )


def where_on(report: Report) -> str:
    """On which flights the models are examined."""
    if report.unseen:
        return "the unseen flights"
    return f"the given logs{', to which the effects were fitted (in-sample)' if report.addition.model.effects else ''}"


def why_not(flight: NextFlight) -> str:
    """Why there is no designed flight."""
    return flight.why_not or f"not searched for this page; see `wrenchgap design {' '.join(flight.names)}`."


def designed(found: Design) -> str:
    """The designed flight, and what to expect of it."""
    moves = ", then ".join(str(s) for s in found.segments)
    expected, before = separation(found.expected.separation), separation(found.before.separation)
    said = (
        f"Fly {found.file.trajectory.duration:.0f} s: {moves}. Expected separation {expected}, on the given logs "
        f"{before}; the effects are separable above {SIGNIFICANCE.indistinct:g}."
    )
    return said if found.separable else f"{said} No flight that was tried separates them reliably."


def parts(report: Report) -> list[Part]:
    """The verdict, and by how much the error is reduced."""
    return [
        Line(answer.in_full(report.explanation), "bold"),
        *(Line(text) for text in (fitted_effects.already_in(report.model),) if text),
        *(Line(staircase.sentence(case)) for case in report.staircases),
    ]


def to_json(report: Report, repetition: Repetition | None = None) -> dict[str, Any]:
    """The body of the `report` schema; without a `repetition`, one is made with the model's own name."""
    repetition = repetition or Repetition.of(report)
    absorbed = report.rest.absorption
    return {
        "axes": list(AXES),
        "unmeasured": unmeasured(report.explanation.noise),
        "summary": answer.summary(report.explanation),
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
            own = {"on": str(case.basis), "step": staircase.label(stair), "in_all": stair.in_all}
            rows.append({**own, **by_axis("rms", stair.rms)})
    return rows
