"""`wrenchgap report`: everything about some flights and a model, on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, Run

MANY = ("--validate",)


def report(
    ctx: typer.Context,
    logs: o.Logs,
    model: o.ModelOption,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="HTML", help="Page to write (.html).", show_default=False)
    ],
    validate: o.Validate = None,
    gp: o.GpOption = None,
    *,
    reading: Reading,
    run: Run,
) -> None:
    """Write one page that says which effect is missing, with what confidence, and how far the error is reduced.

    The page needs nothing else: verdict, error step by step on held-out time and unseen flights, ranking, parameters,
    where the model fails before and after, residual, what to fly next, and how to repeat it all.

    Example: `wrenchgap report train.mcap -m tilt_hexarotor --validate test.mcap -o report.html`
    """
    from wrenchgap.replay import api
    from wrenchgap.replay.present.report import Repetition, Request, save, to_json

    run.claim({"--output": output}, *logs, *(validate or ()), model, gp)
    if output.suffix.lower() not in (".html", ".htm"):
        raise o.usage_error(f"--output {output}: the report is a web page; expected a name that ends in .html")
    base, process = run.model(model), run.gp(gp)
    topics, shifts, between = (", ".join(t or []) for t in (reading.topic, reading.shift, reading.between))
    said = {"between": between, "topics": topics, "shift": shifts, "unmeasured": reading.unmeasured}
    options = {key: value for key, value in said.items() if value}
    with run.progress("reporting") as told:
        flights, tests = run.open(reading.options, logs, base, validate)
        found = api.report(flights, base, validate=tests, gp=process, progress=told)
        told(1.0, "writing the page")
        request = Request(model, o.command_line(ctx), o.common_options(ctx), options, gp)
        repetition = Repetition.of(found, request)
        save(found, output, force=run.force, repetition=repetition)
    run.result(found)
    run.write("report", {**to_json(found, repetition), "page": str(output)})
    run.wrote(report=output)
