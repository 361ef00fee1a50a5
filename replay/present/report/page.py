"""The report as one HTML page: nothing is fetched, every image is inside, readable on paper.

Templates (templates/) escape whatever they are given, so that nothing of a log becomes markup
(docs/decisions/0015-report-templates.md).
"""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, PackageLoader

from wrenchgap._escaping import html_templates
from wrenchgap.flight.atomic import atomic
from wrenchgap.replay.present import explanation, staircase
from wrenchgap.replay.present.documents import claim
from wrenchgap.replay.present.notes import findings, warnings
from wrenchgap.replay.present.report.repetition import Repetition, Request
from wrenchgap.replay.present.report.sections import SECTIONS
from wrenchgap.replay.report import Report


def save(report: Report, path: Path, *, force: bool = False, repetition: Repetition | None = None) -> None:
    """Write the page. Raises UsageError where the file exists and `force` is not given."""
    claim({"report": path}, force=force, inputs=[str(f.flight.path) for f in (*report.flights, *report.unseen)])
    model = str(report.model.path or report.model.name)
    text = page(report, repetition or Repetition.of(report, Request(model)))
    with atomic(path) as partial:
        partial.write_text(text, encoding="utf-8")


def page(report: Report, repetition: Repetition) -> str:
    """The whole page."""
    found, tested = report.explanation, report.explanation.validation
    flights = ", ".join(f.records[0].flight for f in report.flights)
    return (
        environment()
        .get_template("page.html.jinja")
        .render(
            title=f"{report.model.name}: {flights}",
            date=repetition.date,
            vehicle=report.model.vehicle.name,
            verdict=str(found.verdict),
            summary=explanation.summary(found),
            errors=" ".join(map(staircase.sentence, report.staircases)),
            warnings=[
                *warnings(findings(report)),
                *([] if tested is None else explanation.validation_warnings(tested)),
            ],
            sections=[(anchor, title, content(report, repetition)) for anchor, title, content in SECTIONS],
        )
    )


def environment() -> Environment:
    """The templates; texts are escaped, and nothing may be missing."""
    return html_templates(PackageLoader("wrenchgap.replay.present.report"))
