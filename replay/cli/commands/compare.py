"""`wrenchgap compare`: how well models predict what was measured."""

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
    complete_models,
    many,
    parse_between,
    parse_shifts,
    parse_topics,
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("compare", cls=many("--against"))(compare)


def compare(
    logs: Logs,
    model: ModelOption,
    against: Annotated[
        list[str] | None,
        typer.Option(
            "--against", metavar="MODEL2", help="Further models of the same vehicle.", autocompletion=complete_models
        ),
    ] = None,
    gp: Annotated[Path | None, typer.Option("--gp", metavar="GP", help="A GP of `wrenchgap learn`.")] = None,
    figure: Annotated[
        Path | None, typer.Option("--figure", metavar="PNG", help="Draw commanded, measured, predicted.")
    ] = None,
    csv: Annotated[Path | None, typer.Option("--csv", metavar="FILE", help="Every sample as a table.")] = None,
    topic: Topics = None,
    shift: Shift = None,
    cutoff: Cutoff = 8.0,
    between: Between = None,
    own: OwnEffects = None,
    json: JsonFile = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Errors of models on flights, per axis and per flight, and where they are worst.

    Always shown first: "nominal", the vehicle without effects. Effects of MODEL, other models and a GP follow, with the
    change of rms against it, and the noise of the sensors.

    Example: `wrenchgap compare test.mcap -m tilt_hexarotor --against fitted.toml --figure compare.png`
    """
    from wrenchgap.learn.data import comparison
    from wrenchgap.learn.data.opening import open_flights
    from wrenchgap.learn.process import store
    from wrenchgap.plant import model_file
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.present import tables
    from wrenchgap.replay.present import wrench_figure as figures
    from wrenchgap.replay.present.documents import claim, document, file_input, log_input, model_input, write_json

    inputs: list[str | Path] = [*logs, model, *(against or ()), *([gp] if gp else ())]
    claim({"--json": json, "--figure": figure, "--csv": csv}, force=force, inputs=inputs)
    printer = Printer(quiet)
    base = model_file.load(model)
    others = [model_file.load(name) for name in against or ()]
    process = store.load(gp) if gp is not None else None
    found, notes = comparison.predictors(base, others, process, comparison.cutoff_checked(cutoff))
    with progress("reading", quiet) as report:
        report(0.0, "reading logs")
        topics, shifts = parse_topics(topic), parse_shifts(shift)
        flights = open_flights(
            logs, base, topics=topics, cutoff_hz=cutoff, between=parse_between(between), shifts=shifts
        )
        report(0.7, "comparing")
        result = comparison.compare(flights, base, found)

    printer.show(tables.errors(result))
    if len(flights) > 1:
        printer.show(tables.by_flight(result))
    last = result.evaluations[-1]
    printer.show(tables.worst(last.name, last.worst))
    printer.line(f"why there: wrenchgap where {' '.join(map(str, logs))} -m {model}", style="dim")
    printer.notes([*base.notes, *notes, *result.notes])
    if figure is not None:
        title = f"{base.name}: {', '.join(result.flights)}"
        figures.wrench_figure(figures.traces(result), figure, title=title, residuals=result, force=force)
    if csv is not None:
        from wrenchgap.replay.present.sample_table import write_csv

        write_csv(result, csv, force=force)
    if json is not None:
        read = [*(log_input(f.flight) for f in flights), model_input(base)]
        read += [model_input(other, "against") for other in others]
        read += [file_input(gp, "gp")] if gp is not None else []
        body = result.to_json()
        body["notes"] = [*notes, *body["notes"]]
        write_json(json, document("compare", {**body, "cutoff_hz": cutoff}, read), force=force)
    printer.wrote(figure=figure, table=csv, result=json)
