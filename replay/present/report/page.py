"""The report as one HTML page: nothing is fetched, every image is inside, readable on paper.

Templates (templates/) escape whatever they are given, so that nothing of a log becomes markup
(docs/decisions/0015-report-templates.md).
"""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined

from wrenchgap.replay.present import explanation, staircase
from wrenchgap.replay.present.report.repetition import Repetition
from wrenchgap.replay.present.report.sections import SECTIONS
from wrenchgap.replay.report.contents import Report


def page(report: Report, repetition: Repetition) -> str:
    """The whole page."""
    found = report.explanation
    tested = found.validation
    flights = ", ".join(f.records[0].flight for f in report.flights)
    return (
        _environment()
        .get_template("page.html.jinja")
        .render(
            title=f"{report.model.name}: {flights}",
            date=repetition.date,
            vehicle=report.model.vehicle.name,
            verdict=str(found.verdict),
            summary=explanation.summary(found),
            errors=" ".join(map(staircase.sentence, report.staircases)),
            warnings=[] if tested is None else explanation.validation_warnings(tested),
            sections=[(anchor, title, content(report, repetition)) for anchor, title, content in SECTIONS],
        )
    )


def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("wrenchgap.replay.present.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
