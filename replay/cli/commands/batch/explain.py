"""`wrenchgap batch explain`: which effects a fleet's model is missing."""

from __future__ import annotations

from typing import Annotated

import typer

from wrenchgap.replay.cli import batches as b
from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, Run


def explain(
    logs: b.Sources,
    model: b.Models,
    output: b.Output,
    effects_only: Annotated[
        str | None, typer.Option("--effects-only", metavar="A,B", help="Try these effects only.")
    ] = None,
    passes: Annotated[
        int,
        typer.Option(
            "--passes",
            metavar="N",
            min=1,
            help="Most passes over the logs: each linearises candidates where the last found them.",
        ),
    ] = 2,
    each: Annotated[
        bool, typer.Option("--each", help="Search every log by itself as well, as `wrenchgap explain` does.")
    ] = False,
    *,
    reading: Reading,
    where: b.Where,
    run: Run,
) -> None:
    """Rank the effects that the model is missing, vehicle by vehicle, on all flights together.

    Every log is read once a pass; its evidence is kept with its row, merged, and cross-validated by flight without
    reading a log again.

    Example: `wrenchgap batch explain s3://flights/2026/ -m my_quadrotor -o s3://results/explained --scheduler
    tcp://10.0.0.1:8786`
    """
    from wrenchgap.replay.batch.plan import Plan, parsed_models

    names = o.parse_effects(effects_only)
    plan = Plan("explain", parsed_models(model), reading.options.to_json(), names, each=each)
    b.batch(plan, logs, output, where, run, passes)
