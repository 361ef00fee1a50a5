"""`wrenchgap trend`: what stepped or drifted over many flights."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.batches import OneVehicle
from wrenchgap.replay.cli.requests import Reading, Run


def trend(
    ctx: typer.Context,
    logs: o.Logs,
    model: o.ModelOption,
    fit: Annotated[
        str | None,
        typer.Option(
            "--fit",
            metavar="A,B",
            help="Effects to fit to each flight. Default: those of MODEL, else thrust_scale,com_offset.",
        ),
    ] = None,
    figure: o.Figure = None,
    table: Annotated[
        Path | None, typer.Option("--table", metavar="FILE", help="Every value as a table (.parquet).")
    ] = None,
    page: Annotated[
        Path | None, typer.Option("--page", metavar="FILE", help="All of it as a web page (.html).")
    ] = None,
    vehicle: OneVehicle = None,
    *,
    reading: Reading,
    run: Run,
) -> None:
    """Fit each flight by itself and say which parameters stepped or drifted over the flights.

    Give the logs in the order in which they were flown, or the folder of `wrenchgap batch compare`. A step is told with
    its flight, its size with a 95 % interval, and its significance against the scatter between flights; with fewer than
    four flights nothing is said of steps.

    Example: `wrenchgap trend monday.mcap tuesday.mcap wednesday.mcap friday.mcap -m my_quadrotor --page season.html`
    """
    from wrenchgap.replay import between_flights
    from wrenchgap.replay.present import trend as words
    from wrenchgap.replay.present.report import flights as page_file
    from wrenchgap.replay.present.report import trend as pages

    run.claim({"--figure": figure, "--table": table, "--page": page}, *logs, model)
    words.check_table(table)
    page_file.check(page)
    names = o.parse_effects(fit)
    base = run.model(model)
    with run.progress("following") as report:
        if len(logs) == 1 and (logs[0] / "run.json").is_file():
            from wrenchgap.replay.batch.followed import trend_of_rows
            from wrenchgap.replay.batch.store import Store

            found = trend_of_rows(Store(str(logs[0])), base, names, vehicle)
            run.note_input(logs[0] / "run.json", "batch")
        else:
            flights, _ = run.open(reading.options, logs, base)
            found = between_flights.trend(flights, base, names, progress=report)
    run.result(found)
    run.draw(found, figure)
    if table is not None:
        words.save_table(found, table)
    if page is not None:
        page_file.save(pages.page(found, o.command_line(ctx)), page)
    run.write("trend", found.to_json())
    run.wrote(figure=figure, table=table, page=page)
