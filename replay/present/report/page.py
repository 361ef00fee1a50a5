"""Web pages: the report of a search, and what `check`, `changed` and `trend` found in several flights.

Nothing is fetched, every image is inside, and they are readable on paper.

Templates (templates/) escape whatever they are given, so that nothing of a log becomes markup
(docs/decisions/0015-report-templates.md).
"""

from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader

from wrenchgap._escaping import html_templates
from wrenchgap.flight import Flight, Inspection
from wrenchgap.flight.atomic import write_text
from wrenchgap.flight.autopilot import ParameterDifferences
from wrenchgap.learn.changed.changed import Changed, Verdict
from wrenchgap.learn.health.health import Health
from wrenchgap.learn.identify.trend import Trend
from wrenchgap.plant.vehicle import PART
from wrenchgap.replay.present import (
    answer,
    changed,
    comparison,
    fitted_effects,
    health,
    parameters,
    season,
    staircase,
    trend,
    what_to_inspect,
)
from wrenchgap.replay.present.documents import claim
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.figures import vehicle as top_view
from wrenchgap.replay.present.notes import findings, grouped, warnings
from wrenchgap.replay.present.numbers import capitalised, quantity, signed
from wrenchgap.replay.present.posterior import classes_in_words
from wrenchgap.replay.present.report.repetition import Repetition
from wrenchgap.replay.present.report.sections import SECTIONS, Image
from wrenchgap.replay.present.statements import statements
from wrenchgap.replay.present.tables import Table, captioned, styled, table
from wrenchgap.replay.report import Report


def save(report: Report, path: Path, *, force: bool = False, repetition: Repetition | None = None) -> None:
    """Write the page. Raises UsageError where the file exists and `force` is not given."""
    claim({"report": path}, force=force, inputs=[str(f.flight.path) for f in (*report.flights, *report.unseen)])
    write_text(path, page(report, repetition or Repetition.of(report)))


def page(report: Report, repetition: Repetition) -> str:
    """The whole page."""
    found, tested = report.explanation, report.explanation.validation
    flights = ", ".join(f.records[0].flight for f in report.flights)
    unknown = any(line.startswith("wrenchgap discover") for line in repetition.commands)
    law = " wrenchgap discover looks for its law: the command is under How to repeat this." if unknown else ""
    return (
        environment()
        .get_template("page.html.jinja")
        .render(
            title=f"{report.model.name}: {flights}",
            date=repetition.date,
            vehicle=report.model.vehicle.name,
            verdict=str(found.verdict),
            summary=answer.in_full(found) + law,
            evidence=answer.evidence(found),
            errors=" ".join(map(staircase.sentence, report.staircases)),
            already=fitted_effects.already_in(report.model),
            warnings=[
                *warnings(findings(report)),
                *([] if tested is None else comparison.validation_warnings(tested)),
            ],
            sections=[(anchor, title, content(report, repetition)) for anchor, title, content in SECTIONS],
        )
    )


def environment() -> Environment:
    """The templates; texts are escaped, and nothing may be missing."""
    return html_templates(PackageLoader("wrenchgap.replay.present.report"))


def flights_page(tool: str, logs: Sequence[Flight | Inspection], flights: Sequence[Any] = (), **parts: Any) -> str:
    """The page of a command, with today's date, the logs, and at the top what the checks of `flights` warn of."""
    rows = [(k, log.path.name, styled(log.content_hash, "code")) for k, log in enumerate(logs, 1)]
    usual = {
        "tool": tool,
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "files": table("", ("", "log", "SHA-256"), rows, left=3, caption="Logs."),
        "warnings": [f"check: {text}" for text in warnings(findings(list(flights)))],
        "inspect": [],
        "caveat": "",
        "view": None,
    }
    return environment().get_template("flights.html.jinja").render(**{**usual, **parts})


BOXES = {Verdict.CHANGED: "effect", Verdict.NOTHING: "nothing", Verdict.UNKNOWN: "unknown"}
"""How the box of the verdict looks: as that of `explain`."""


def changed_page(found: Changed, command: str = "") -> str:
    """The whole page."""
    differences = parameters.of_flights(found.flights)
    caption = (
        "Left: what the given model leaves on average of each flight, in what healthy flights differ by. Middle: each "
        "change by itself. Right: where it is."
    )
    return flights_page(
        "changed",
        [one.flight for one in found.flights],
        found.flights,
        title=f"{found.model.name}: what changed on {', '.join(found.suspect)}",
        vehicle=found.model.vehicle.name,
        verdict=BOXES[found.verdict],
        summary=[changed.summary(found), *changed.outliers(found), *classes_in_words(found.classes)],
        caveat=" ".join(map(capitalised, (changed.baseline(found), *changed.feedback(found)))),
        chart=Image.of(changed.picture(found), "Flights, changes, and the vehicle from above.", caption, "svg"),
        tables=[*_changed_tables(found), *_differences(differences)],
        inspect=what_to_inspect.sentences(found),
        notes=[*changed.not_compared(found), *parameters.sentences(differences), *changed.notes(found)],
        command=command,
    )


def _changed_tables(found: Changed) -> Iterator[Table]:
    for sizes in changed.sizes(found):
        yield captioned(sizes, f"Changes. {changed.SIZES_LEGEND}.")
    yield captioned(changed.alone(found), f"Each change by itself. {changed.ALONE_LEGEND}.")
    yield captioned(changed.flights(found), "Mean residual of the given model by flight, signed.")
    for values in changed.by_flight(found):
        yield captioned(values, "What changed, on each flight by itself.")


def health_page(found: Health, command: str = "") -> str:
    """The whole page of `check`."""
    levels = {one.level for log in found.logs for one in statements(log)}
    notes = [text for log in found.logs for text in grouped(log.inspection.notes)]
    caption = "Left: commanded thrust of each motor. Right: power spectral density of the logged specific force."
    return flights_page(
        "check",
        [log.inspection for log in found.logs],
        title=", ".join(log.name for log in found.logs),
        vehicle="as its logs show it, without a model",
        verdict="effect" if "bad" in levels else "unknown" if levels else "nothing",
        summary=[text for text, _ in health.answer(found)],
        chart=Image.of(
            health.picture(found), "Thrust of the motors, and spectrum of the vibration, by log.", caption, "svg"
        ),
        tables=[health.overview(found), *_differences(found.parameters)],
        inspect=[f"{log.name}: {one.words}" for log in found.logs for one in statements(log)],
        notes=[*parameters.sentences(found.parameters), *notes],
        command=command,
    )


def _differences(found: ParameterDifferences) -> list[Table]:
    """Which parameters of the autopilot differ; no table where none does."""
    return [captioned(one, "Parameters that differ.") for one in parameters.differences(found)]


def trend_page(found: Trend, command: str = "") -> str:
    """The whole page."""
    differences = parameters.of_flights(found.flights)
    caption = (
        f"Every flight fitted by itself. Band: {season.SIGMAS:g} times the scatter of the flights about their level; "
        "dashed: a step."
    )
    return flights_page(
        "trend",
        [one.flight for one in found.flights],
        found.flights,
        title=f"{found.model.name}: {', '.join(found.effects)} over {len(found.flights)} flights",
        vehicle=found.model.vehicle.name,
        verdict="unknown" if found.changed else "nothing",
        summary=trend.summary(found),
        caveat=trend.CAVEAT if found.changed else "",
        chart=Image.of(trend.picture(found), "Parameters over the flights.", caption, "svg"),
        view=_view(found),
        tables=[
            *([captioned(season.health(found), f"Health of parts. {season.LEGEND}.")] if found.by_part else []),
            captioned(trend.overview(found), f"Parameters. {trend.LEGEND}."),
            *(captioned(one, "Steps.") for one in trend.steps(found)),
            captioned(trend.values(found, len(found.parameters)), "Values by flight; > the first flight after a step."),
            *_differences(differences),
        ],
        notes=[*parameters.sentences(differences), *trend.notes(found)],
        command=command,
    )


def _view(found: Trend) -> Image | None:
    """The vehicle from above with the rotors and arms whose parameters changed; None where none did."""
    marks, moved = vehicle_marks(found)
    if not marks:
        return None
    alt = f"The vehicle from above; marked: {', '.join(trend.places(found))}."
    caption = "The change from the first flights to the last; an arrow shows a direction, no size."
    return Image.of(top_view.picture(found.model.vehicle, marks, moved_B=moved), alt, caption, "svg")


def vehicle_marks(found: Trend) -> tuple[dict[str, str], np.ndarray | None]:
    """Parts of the vehicle to mark, with their change in words; by how much the centre of mass moved (3,) [m]."""
    marks, moved = {}, np.zeros(3)
    for p in found.changed:
        change = float(p.course.level[-1] - p.course.level[0])
        if PART.fullmatch(p.name):
            marks[p.name] = f"{p.effect} {signed(change, quantity(change, p.unit, 2))}"
        elif p.effect == "com_offset":
            moved["xyz".index(p.name)] = change
    if np.any(moved):
        marks["com"] = f"moved by {style.written(float(np.linalg.norm(moved)), 'm')}"
    return marks, moved if np.any(moved) else None


PAGES: dict[type, Callable[[Any, str], str]] = {Health: health_page, Changed: changed_page, Trend: trend_page}
"""The page of a result, with the command that asked for it."""
