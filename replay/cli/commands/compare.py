"""`wrenchgap compare`: how well models predict what was measured."""

from __future__ import annotations

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, load_gp, show_result, write_result


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("compare", cls=o.many("--against"))(compare)


def compare(
    logs: o.Logs,
    model: o.ModelOption,
    against: o.Against = None,
    gp: o.GpOption = None,
    figure: o.Figure = None,
    csv: o.Csv = None,
    topic: o.Topics = None,
    shift: o.Shift = None,
    cutoff: o.Cutoff = 8.0,
    between: o.Between = None,
    own: o.OwnEffects = None,
    json: o.JsonFile = None,
    force: o.Force = False,
    quiet: o.Quiet = False,
) -> None:
    """Errors of models on flights, per axis and per flight, and where they are worst.

    Always shown first: "nominal", the vehicle without effects. Effects of MODEL, other models and a GP follow, with the
    change of rms against it, and the noise of the sensors.

    Example: `wrenchgap compare test.mcap -m tilt_hexarotor --against fitted.toml --figure compare.png`
    """
    from wrenchgap.replay import api
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.present.documents import claim, write_csv

    claim(
        {"--json": json, "--figure": figure, "--csv": csv},
        force=force,
        inputs=[*logs, model, *(against or ()), *([gp] if gp else ())],
    )
    base, others = api.load_model(model), [api.load_model(name) for name in against or ()]
    process, reading = load_gp(gp), Reading.of(topic, shift, cutoff, between)
    with progress("reading", quiet) as report:
        report(0.0, "reading logs")
        flights = reading.open(logs, base)
        report(0.7, "comparing")
        result = api.compare(flights, base, *others, gp=process)
    printer = Printer(quiet)
    show_result(printer, result)
    printer.line(f"why there: wrenchgap where {' '.join(map(str, logs))} -m {model}", style="dim")
    if figure is not None:
        from wrenchgap.replay.present.figures import save

        save(result, figure, force=force)
    if csv is not None:
        write_csv(result.to_frame(), csv)
    models = [(base, "model"), *((other, "against") for other in others)]
    write_result(json, "compare", result.to_json(), force=force, flights=flights, models=models, files=[(gp, "gp")])
    printer.wrote(figure=figure, table=csv, result=json)
