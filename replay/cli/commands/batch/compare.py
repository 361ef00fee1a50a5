"""`wrenchgap batch compare`: errors of models on thousands of flights."""

from __future__ import annotations

from typing import Annotated

import typer

from wrenchgap.replay.cli import batches as b
from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, Run


def compare(
    logs: b.Sources,
    model: b.Models,
    output: b.Output,
    fit: Annotated[
        str | None,
        typer.Option(
            "--fit",
            metavar="A,B",
            help="Effects to fit to each flight, for `trend`. Default: those of MODEL, else thrust_scale,com_offset.",
        ),
    ] = None,
    *,
    reading: Reading,
    where: b.Where,
    run: Run,
) -> None:
    """Errors of the model on every flight, and each flight's own parameters: `wrenchgap trend FOLDER` follows them.

    Example: `wrenchgap batch compare 'flights/*/*.mcap' -m my_quadrotor -o compared`
    """
    from wrenchgap.replay.batch.plan import Plan, parsed_models

    plan = Plan("compare", parsed_models(model), reading.options.to_json(), o.parse_effects(fit))
    b.batch(plan, logs, output, where, run)
