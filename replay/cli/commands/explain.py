"""`wrenchgap explain`: which physical effect is missing."""

from __future__ import annotations

from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, show_result, write_result


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("explain", cls=o.many("--validate"))(explain)


def explain(
    logs: o.Logs,
    model: o.ModelOption,
    validate: o.Validate = None,
    effects_only: Annotated[
        str | None, typer.Option("--effects-only", metavar="A,B", help="Try only these effects.")
    ] = None,
    topic: o.Topics = None,
    shift: o.Shift = None,
    cutoff: o.Cutoff = 8.0,
    between: o.Between = None,
    own: o.OwnEffects = None,
    json: o.JsonFile = None,
    force: o.Force = False,
    quiet: o.Quiet = False,
) -> None:
    """Rank the effects that could explain what the model misses, by the reduction of the error on held-out time.

    Effects already in MODEL stay, fitted together with each candidate. Effects that are indistinguishable on these logs
    are reported as one group. Put the result into a model file with `wrenchgap add`.

    Example: `wrenchgap explain train.mcap -m tilt_hexarotor --validate test.mcap`
    """
    from wrenchgap.learn.parallel import cores, get_ready
    from wrenchgap.replay import api
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.present.documents import claim
    from wrenchgap.replay.present.explanation import what_next

    unseen = validate or []
    claim({"--json": json}, force=force, inputs=[*logs, *unseen, model])
    base, reading = api.load_model(model), Reading.of(topic, shift, cutoff, between)
    names = o.parse_effects(effects_only)
    with progress("explaining", quiet) as report:
        report(0.0, "reading logs")
        get_ready(cores())  # workers start while logs are read
        every = reading.open([*logs, *unseen], base)
        flights, tests = every[: len(logs)], every[len(logs) :]
        found = api.explain(flights, base, names=names, validate=tests, progress=report)
    printer = Printer(quiet)
    show_result(printer, found)
    printer.show(*what_next(found, str(model), [str(p) for p in logs]))
    printer.notes([*base.notes, *(note for f in tests for note in f.notes)])
    body = found.to_json()
    write_result(
        json, "explain", body, force=force, flights=flights, validation=tests, models=[(base, "model")]
    )  # fmt: skip
    printer.wrote(result=json)
