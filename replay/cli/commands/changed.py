"""`wrenchgap changed`: what is different between flights that went well and one that did not."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.logs import existing
from wrenchgap.replay.cli.requests import Reading, Run

MANY = ("--healthy",)

Suspects = Annotated[
    list[Path],
    typer.Argument(
        metavar="SUSPECT...",
        help="Logs of flights with something wrong.",
        show_default=False,
        callback=existing,
    ),
]
Healthy = Annotated[
    list[Path],
    typer.Option(
        "--healthy",
        metavar="LOG...",
        help="Logs of the same vehicle when all was well; several say what is usual.",
        show_default=False,
        callback=existing,
    ),
]


def changed(
    ctx: typer.Context,
    suspects: Suspects,
    model: o.ModelOption,
    healthy: Healthy,
    effects_only: Annotated[
        str | None, typer.Option("--effects-only", metavar="A,B", help="Try changes of these effects only.")
    ] = None,
    figure: o.Figure = None,
    page: Annotated[
        Path | None, typer.Option("--page", metavar="FILE", help="All of it as a web page (.html).")
    ] = None,
    *,
    reading: Reading,
    run: Run,
) -> None:
    """Find what changed on suspect flights against healthy flights of the same vehicle, and what to inspect.

    What MODEL is wrong by in all of the flights drops out. A change must exceed what healthy flights differ by among
    themselves. Changes that are indistinguishable on these flights are one class. MODEL may be poor; it stays as it is.

    Example: `wrenchgap changed bad.mcap --healthy monday.mcap tuesday.mcap -m tilt_hexarotor`
    """
    from wrenchgap.learn.parallel import cores, get_ready
    from wrenchgap.replay import between_flights
    from wrenchgap.replay.present.report import changed as pages
    from wrenchgap.replay.present.report import flights as page_file

    run.claim({"--figure": figure, "--page": page}, *suspects, *healthy, model)
    page_file.check(page)
    base, names = run.model(model), o.parse_effects(effects_only)
    with run.progress("comparing") as report:
        good, bad = run.open(reading.options, healthy, base, suspects, ("healthy", "suspect"), unseen_first=True)
        get_ready(cores(), "wrenchgap.learn.changed.changed")  # no earlier: an error would wait for them
        found = between_flights.changed(bad, good, base, names=names, progress=report)
    run.result(found)
    run.notes(base.notes)
    run.draw(found, figure)
    if page is not None:
        page_file.save(pages.page(found, o.command_line(ctx)), page)
    run.write("changed", found.to_json())
    run.wrote(figure=figure, page=page)
