"""`wrenchgap report`: everything about some flights and a model, on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, load_gp, show_result, write_result


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("report", cls=o.many("--validate"))(report)


def report(
    ctx: typer.Context,
    logs: o.Logs,
    model: o.ModelOption,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="HTML", help="Page to write (.html).", show_default=False)
    ],
    validate: o.Validate = None,
    gp: o.GpOption = None,
    topic: o.Topics = None,
    shift: o.Shift = None,
    cutoff: o.Cutoff = 8.0,
    between: o.Between = None,
    own: o.OwnEffects = None,
    json: o.JsonFile = None,
    force: o.Force = False,
    quiet: o.Quiet = False,
) -> None:
    """Write one page that says which effect is missing, with what confidence, and how far the error is reduced.

    The page needs nothing else: verdict, error step by step on held-out time and unseen flights, ranking, parameters,
    where the model fails before and after, residual, what to fly next, and how to repeat it all.

    Example: `wrenchgap report train.mcap -m tilt_hexarotor --validate test.mcap -o report.html`
    """
    from wrenchgap.flight.errors import UsageError
    from wrenchgap.replay import api
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.present.documents import claim
    from wrenchgap.replay.present.report import Repetition, Request, save, to_json

    unseen = validate or []
    read: list[Path | str] = [*logs, *unseen, model, *([gp] if gp else [])]
    claim({"--output": output, "--json": json}, force=force, inputs=read)
    if output.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"--output {output}: the report is a web page; expected a name that ends in .html")
    base, process, reading = api.load_model(model), load_gp(gp), Reading.of(topic, shift, cutoff, between)
    said = {"between": between, "topics": ", ".join(topic or []), "shift": ", ".join(shift or [])}
    options = {key: value for key, value in said.items() if value}
    with progress("reporting", quiet) as told:
        told(0.0, "reading logs")
        every = reading.open([*logs, *unseen], base)
        flights, tests = every[: len(logs)], every[len(logs) :]
        found = api.report(flights, base, validate=tests, gp=process, progress=told)
        told(1.0, "writing the page")
        request = Request(model, o.command_line(ctx), o.common_options(ctx), options, gp)
        repetition = Repetition.of(found, request)
        save(found, output, force=force, repetition=repetition)
    printer = Printer(quiet)
    show_result(printer, found)
    body = {**to_json(found, repetition), "page": str(output)}
    model_read, gp_read = [(base, "model")], [(gp, "gp")]
    write_result(json, "report", body, force=force, flights=flights, validation=tests, models=model_read, files=gp_read)
    printer.wrote(report=output, result=json)
