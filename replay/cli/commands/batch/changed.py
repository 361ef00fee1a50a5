"""`wrenchgap batch changed`: what differs on each of thousands of flights from healthy ones."""

from __future__ import annotations

from typing import Annotated

import typer

from wrenchgap.replay.cli import batches as b
from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, Run

MANY = ("--healthy",)


def changed(
    logs: b.Sources,
    model: b.Models,
    healthy: Annotated[
        list[str],
        typer.Option(
            "--healthy", metavar="LOG...", help="Logs of the same vehicle when all was well.", show_default=False
        ),
    ],
    output: b.Output,
    effects_only: Annotated[
        str | None, typer.Option("--effects-only", metavar="A,B", help="Try changes of these effects only.")
    ] = None,
    *,
    reading: Reading,
    where: b.Where,
    run: Run,
) -> None:
    """What changed on every flight, each by itself, against the same healthy flights of that vehicle.

    Example: `wrenchgap batch changed flights/ --healthy first/*.mcap -m my_quadrotor -o changed`
    """
    from wrenchgap.replay.batch.plan import Plan, parsed_models
    from wrenchgap.replay.batch.sources import found

    good = tuple(one.url for one in found(healthy))
    names = o.parse_effects(effects_only)
    plan = Plan("changed", parsed_models(model), reading.options.to_json(), names, good)
    b.batch(plan, [*logs], output, where, run)
