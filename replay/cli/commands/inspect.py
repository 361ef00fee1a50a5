"""`wrenchgap inspect`: what is in a log."""

from __future__ import annotations

from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, show_result, write_result


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("inspect")(inspect)


def inspect(
    logs: o.Logs,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            "-m",
            metavar="MODEL",
            help="Check the log against this model too.",
            autocompletion=o.complete_models,
        ),
    ] = None,
    topic: o.Topics = None,
    shift: o.Shift = None,
    cutoff: o.Cutoff = 8.0,
    own: o.OwnEffects = None,
    json: o.JsonFile = None,
    force: o.Force = False,
    quiet: o.Quiet = False,
) -> None:
    """What is in a log: topics, the roles they play, rates, gaps, clocks, and whether the values are plausible.

    Each check that fails says what to do. With a model, its mass, rotors and actuation are checked as well. Then the
    delays between the topics and, with a model, of the response behind its commands (docs/timing.md).

    Example: `wrenchgap inspect flight.mcap -m crazyflie --topic imu=/my/imu`
    """
    from wrenchgap.replay import api
    from wrenchgap.replay.cli.console import Printer
    from wrenchgap.replay.present.documents import claim

    claim({"--json": json}, force=force, inputs=logs)
    reading = Reading.of(topic, shift, cutoff)
    known = None if model is None else api.load_model(model)
    printer = Printer(quiet)
    bodies = []
    for path in logs:
        seen = api.inspect(path, known, topics=reading.topics, shifts=reading.shifts, cutoff_hz=reading.cutoff_hz)
        show_result(printer, seen)
        bodies.append(seen.to_json())
    inputs = [{"role": "log", "file": b["path"], "sha256": b["sha256"]} for b in bodies]
    models = [] if known is None else [(known, "model")]
    write_result(json, "inspect", {"logs": bodies}, force=force, inputs=inputs, models=models)
    printer.wrote(result=json)
