"""`wrenchgap where`: where a model fails, and what the error is made of."""

from __future__ import annotations

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, load_gp, show_result, write_result


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("where")(where)


def where(
    logs: o.Logs,
    model: o.ModelOption,
    gp: o.GpOption = None,
    figure: o.Figure = None,
    topic: o.Topics = None,
    shift: o.Shift = None,
    cutoff: o.Cutoff = 8.0,
    between: o.Between = None,
    own: o.OwnEffects = None,
    json: o.JsonFile = None,
    force: o.Force = False,
    quiet: o.Quiet = False,
) -> None:
    """Show where MODEL fails: on which tilt, thrust, speed, height ... its error depends, and what it is made of.

    Prints an error budget (noise, effects in the model, what a Gaussian process would add, unexplained), the quantities
    that the error depends on most, the worst stretches, whether the residual is white, and the inputs that predict it
    on held-out time. docs/where.md says how to read it.

    Example: `wrenchgap where flight.mcap -m tilt_hexarotor --figure where.png`
    """
    from wrenchgap.replay import api
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.present.documents import claim

    claim({"--json": json, "--figure": figure}, force=force, inputs=[*logs, model, *([gp] if gp else ())])
    base, process = api.load_model(model), load_gp(gp)
    reading = Reading.of(topic, shift, cutoff, between)
    with progress("where", quiet) as report:
        report(0.0, "reading logs")
        flights = reading.open(logs, base)
        result = api.where(flights, base, gp=process, progress=report)
    printer = Printer(quiet)
    show_result(printer, result)
    printer.notes(base.notes)
    if figure is not None:
        from wrenchgap.replay.present.figures import save

        save(result, figure, force=force)
    body = result.to_json()
    write_result(json, "where", body, force=force, flights=flights, models=[(base, "model")], files=[(gp, "gp")])
    printer.wrote(figure=figure, result=json)
