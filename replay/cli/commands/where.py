"""`wrenchgap where`: where a model fails, and what the error is made of."""

from __future__ import annotations

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, Run


def where(
    logs: o.Logs,
    model: o.ModelOption,
    gp: o.GpOption = None,
    figure: o.Figure = None,
    *,
    reading: Reading,
    run: Run,
) -> None:
    """Show where MODEL fails: on which tilt, thrust, speed, height ... its error depends, and what it is made of.

    Prints an error budget (noise, effects in the model, what a Gaussian process would add, unexplained), the quantities
    that the error depends on most, the worst stretches, whether the residual is white, and the inputs that predict it
    on held-out time. docs/where.md says how to read it.

    Example: `wrenchgap where flight.mcap -m tilt_hexarotor --figure where.png`
    """
    from wrenchgap.replay import api

    run.claim({"--json": run.json, "--figure": figure}, *logs, model, gp)
    base, process = run.model(model), run.gp(gp)
    with run.progress("where") as report:
        flights, _ = run.open(reading.options, logs, base)
        result = api.where(flights, base, gp=process, progress=report)
    run.result(result)
    run.notes(base.notes)
    run.draw(result, figure)
    run.write("where", result.to_json())
    run.wrote(figure=figure)
