"""The HTML report of a working session, as `wrenchgap report` writes it: the flight in view, the present model."""

from __future__ import annotations

import shlex
from collections.abc import Callable

from wrenchgap.replay.session.working_model import Bench

UNSAVED = "MODEL"
"""What a model is called in the commands of a report while no file says the same."""


def report_page(bench: Bench, flight: str, progress: Callable[[float, str], None]) -> str:
    """A self-contained page: fitted on the flight, tested on all other flights of the session. Takes minutes.

    A GP belongs to the model that it was learnt on, and is left out once that has changed.
    """
    from wrenchgap.replay.present.report.page import page
    from wrenchgap.replay.report.contents import gather

    model = bench.model
    one = bench.flight(flight)
    others = [opened for name, opened in bench.opened.items() if name != flight]
    name = str(model.path) if bench.saved and model.path is not None else UNSAVED
    words = ["wrenchgap", "report", str(one.flight.path), "-m", name]
    words += ["--validate", *(str(o.flight.path) for o in others)] if others else []
    progress(0.0, "looking for what is missing")
    contents = gather(
        [one],
        others,
        model,
        model_name=name,
        gp=bench.gp if model is bench.given else None,
        command=shlex.join([*words, "-o", "report.html"]),
        cutoff_hz=bench.cutoff_hz,
        progress=progress,
    )
    return page(contents)
