"""The report of a search: a few lines, JSON, and one self-contained HTML page.

`page` fills the templates of templates/ with the tables and figures of `sections`; `repetition` has what is needed to
come to the same numbers again, `summary` the sentences that are the page's own, lines, JSON and frame.
"""

from wrenchgap.replay.present.figures.report import picture
from wrenchgap.replay.present.report.page import page, save
from wrenchgap.replay.present.report.repetition import Repetition
from wrenchgap.replay.present.report.summary import frame, parts, to_json

__all__ = ["Repetition", "frame", "page", "parts", "picture", "save", "to_json"]
