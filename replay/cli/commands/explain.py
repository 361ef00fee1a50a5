"""`wrenchgap explain`: which physical effect is missing."""

from __future__ import annotations

from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, Run

MANY = ("--validate",)


def explain(
    ctx: typer.Context,
    logs: o.Logs,
    model: o.ModelOption,
    validate: o.Validate = None,
    effects_only: Annotated[
        str | None, typer.Option("--effects-only", metavar="A,B", help="Try only these effects.")
    ] = None,
    *,
    reading: Reading,
    run: Run,
) -> None:
    """Rank the effects that could explain what the model misses, by the reduction of the error on held-out time.

    Effects already in MODEL stay, fitted together with each candidate. Effects that are indistinguishable on these logs
    are reported as one group. Put the result into a model file with `wrenchgap add`.

    Example: `wrenchgap explain train.mcap -m tilt_hexarotor --validate test.mcap`
    """
    from wrenchgap.learn.parallel import cores, get_ready
    from wrenchgap.replay import api
    from wrenchgap.replay.present.explanation import what_next

    run.claim({}, *logs, *(validate or ()), model)
    base, names = run.model(model), o.parse_effects(effects_only)
    with run.progress("explaining") as report:
        get_ready(cores())  # workers start while logs are read
        flights, tests = run.open(reading.options, logs, base, validate)
        found = api.explain(flights, base, names=names, validate=tests, progress=report)
    run.result(found)
    read = (o.common_options(ctx), o.common_options(ctx, "cutoff"))
    run.show(*what_next(found, model, [str(p) for p in logs], *read))
    run.notes([*base.notes, *(note for f in tests for note in f.notes)])
    run.write("explain", found.to_json())
    run.wrote()
