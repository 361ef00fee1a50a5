"""The HTML report of a working session, as `wrenchgap report` writes it: the flight in view, the current model."""

from __future__ import annotations

import shlex
from collections.abc import Callable

from wrenchgap.replay.session.working_model import WorkingModel

UNSAVED = "MODEL"
"""What a model is called in the commands of a report while no file says the same."""


def report_page(working: WorkingModel, flight: str, progress: Callable[[float, str], None]) -> str:
    """A self-contained page: fitted on the flight, tested on all other flights of the session. Takes minutes.

    A GP belongs to the model that it was learnt on, and is left out once that has changed.
    """
    from wrenchgap.replay.present.report import Repetition, Request, page
    from wrenchgap.replay.report.contents import report

    model, one = working.model, working.flight(flight)
    others = [opened for name, opened in working.opened.items() if name != flight]
    name = str(model.path) if working.saved and model.path is not None else UNSAVED
    words = ["wrenchgap", "report", str(one.flight.path), "-m", name]
    words += ["--validate", *(str(o.flight.path) for o in others)] if others else []
    gp = working.gp if model is working.given else None
    made = report([one], model, validation=others, gp=gp, progress=progress)
    return page(made, Repetition.of(made, Request(name, shlex.join([*words, "-o", "report.html"]))))
