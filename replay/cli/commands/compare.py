"""`wrenchgap compare`: how well models predict what was measured."""

from __future__ import annotations

import shlex
from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, Run

MANY = ("--against",)


def compare(
    ctx: typer.Context,
    logs: o.Logs,
    model: o.ModelOption,
    against: o.Against = None,
    gp: o.GpOption = None,
    figure: o.Figure = None,
    csv: o.Csv = None,
    by_flight: Annotated[
        bool, typer.Option("--by-flight", help="Signed mean and rms of the residual by flight and axis, in one table.")
    ] = False,
    *,
    reading: Reading,
    run: Run,
) -> None:
    """Errors of models on flights, per axis and per flight, and where they are worst.

    Always shown first: "nominal", the vehicle without effects. Effects of MODEL, other models and a GP follow, with the
    change of rms against it, and the noise of the sensors.

    Example: `wrenchgap compare test.mcap -m tilt_hexarotor --against fitted.toml --figure compare.png`
    """
    from wrenchgap.replay import api
    from wrenchgap.replay.present.checks import banner
    from wrenchgap.replay.present.comparison import parts
    from wrenchgap.replay.present.documents import write_csv

    run.claim({"--json": run.json, "--figure": figure, "--csv": csv}, *logs, model, *(against or ()), gp)
    base, others = run.model(model), [run.model(name, "against") for name in against or ()]
    process = run.gp(gp)
    with run.progress("reading") as report:
        flights, _ = run.open(reading.options, logs, base)
        report(0.7, "comparing")
        result = api.compare(flights, base, *others, gp=process)
    run.show(*banner(result), *parts(result, signed=by_flight))
    look = shlex.join(["wrenchgap", "where", *map(str, logs), "-m", model])
    run.line(f"why there: {look}{o.common_options(ctx)}", style="dim")
    run.draw(result, figure)
    if csv is not None:
        write_csv(result.to_frame(), csv)
    run.write("compare", result.to_json())
    run.wrote(figure=figure, table=csv)
