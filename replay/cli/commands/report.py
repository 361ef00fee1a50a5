"""`wrenchgap report`: everything about some flights and a model, on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wrenchgap.replay.cli.options import (
    Between,
    Cutoff,
    Force,
    JsonFile,
    Logs,
    ModelOption,
    OwnEffects,
    Quiet,
    Shift,
    Topics,
    command_line,
    common_options,
    many,
    parse_between,
    parse_shifts,
    parse_topics,
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("report", cls=many("--validate"))(report)


def report(
    ctx: typer.Context,
    logs: Logs,
    model: ModelOption,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="HTML", help="Page to write (.html).", show_default=False)
    ],
    validate: Annotated[
        list[Path] | None,
        typer.Option("--validate", metavar="LOG...", help="Flights to test the result on; never fitted."),
    ] = None,
    gp: Annotated[Path | None, typer.Option("--gp", metavar="GP", help="A GP of `wrenchgap learn`, on MODEL.")] = None,
    topic: Topics = None,
    shift: Shift = None,
    cutoff: Cutoff = 8.0,
    between: Between = None,
    own: OwnEffects = None,
    json: JsonFile = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Write one page that says which effect is missing, how sure that is, and how the error falls.

    The page needs nothing else: verdict, error step by step on time and flights that were not fitted, ranking,
    parameters, where the model fails before and after, what is left, what to fly next, and how to repeat it all.

    Example: `wrenchgap report train.mcap -m tilt_hexarotor --validate test.mcap -o report.html`
    """
    from wrenchgap.flight.errors import UsageError
    from wrenchgap.learn.data import comparison
    from wrenchgap.learn.data.opening import open_flights
    from wrenchgap.learn.process import store
    from wrenchgap.plant import model_file
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.present import explanation
    from wrenchgap.replay.present.documents import (
        atomic,
        claim,
        document,
        file_input,
        log_input,
        model_input,
        write_json,
    )
    from wrenchgap.replay.present.report.page import page
    from wrenchgap.replay.report.contents import gather

    unseen = validate or []
    inputs: list[str | Path] = [*logs, *unseen, model, *([gp] if gp else [])]
    claim({"--output": output, "--json": json}, force=force, inputs=inputs)
    if output.suffix.lower() not in (".html", ".htm"):
        raise UsageError(f"--output {output}: the report is a web page; expected a name that ends in .html")
    base = model_file.load(model)
    process = store.load(gp) if gp is not None else None
    hz = comparison.cutoff_checked(cutoff)
    with progress("reporting", quiet) as told:
        told(0.0, "reading logs")
        topics = parse_topics(topic)
        every = open_flights(
            [*logs, *unseen],
            base,
            topics=topics,
            cutoff_hz=hz,
            between=parse_between(between),
            shifts=parse_shifts(shift),
        )
        flights, tests = every[: len(logs)], every[len(logs) :]
        said = {
            "between": between,
            "topics": ", ".join(topic or []) or None,
            "shift": ", ".join(shift or []) or None,
        }
        contents = gather(
            flights,
            tests,
            base,
            model_name=model,
            gp=process,
            gp_file=gp,
            command=command_line(ctx),
            common=common_options(ctx),
            options={key: value for key, value in said.items() if value},
            cutoff_hz=hz,
            progress=told,
        )
        told(1.0, "writing the page")
        text = page(contents)
    with atomic(output) as partial:
        partial.write_text(text, encoding="utf-8")
    printer = Printer(quiet)
    printer.line(explanation.sentence(contents.found), style="bold")
    for case in contents.staircases:
        first, last = case.falling[0], case.falling[-1]
        printer.line(f"{case.title}: {100 * last.in_all / max(first.in_all, 1e-30):.3g} % of the nominal error remain")
    if json is not None:
        read = [*(log_input(f.flight) for f in flights), *(log_input(f.flight, "validation") for f in tests)]
        read += [model_input(base), *([file_input(gp, "gp")] if gp else [])]
        body = {**contents.to_json(), "page": str(output)}
        write_json(json, document("report", body, read), force=force)
    printer.wrote(report=output, result=json)
