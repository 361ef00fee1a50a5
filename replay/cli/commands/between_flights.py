"""`wrenchgap changed` and `trend`: what differs between flights."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Run
from wrenchgap.replay.cli.values import parse_effects, usage_error

if TYPE_CHECKING:
    from wrenchgap.learn.identify.trend import Trend
    from wrenchgap.plant.model import Model


def changed(
    suspects: Annotated[
        list[Path],
        typer.Argument(metavar="SUSPECT...", help="Logs of flights with something wrong.", callback=o.existing_paths),
    ],
    model: o.ModelOption,
    healthy: Annotated[
        list[Path],
        typer.Option(
            metavar="LOG...",
            help="Logs of the same vehicle when all was well; several say what is usual.",
            callback=o.existing_paths,
        ),
    ],
    effects_only: o.ChangesOnly = None,
    injections: o.Injections = 1,
    figure: o.Figure = None,
    page: o.Page = None,
    details: o.Details = False,
    *,
    reading: o.Reading,
    run: Run,
) -> None:
    """Find what changed on suspect flights against healthy flights of the same vehicle, and what to inspect.

    What MODEL is wrong by in all of the flights drops out. A change must exceed what healthy flights differ by among
    themselves. Changes that are indistinguishable on these flights are one class. MODEL may be poor; it stays as it is.

    Example: `wrenchgap changed bad.mcap --healthy monday.mcap tuesday.mcap -m tilt_hexarotor`
    """
    from wrenchgap.learn.parallel import cores, get_ready
    from wrenchgap.replay import api_flights

    run.claim({"--figure": figure, "--page": page}, *suspects, *healthy, model)
    base, names = run.model(model), parse_effects(effects_only)
    with run.progress("comparing") as report:
        good, bad = run.open(reading.options, healthy, base, suspects, ("healthy", "suspect"), unseen_first=True)
        get_ready(cores(), "wrenchgap.learn.changed.changed")  # no earlier: an error would wait for them
        found = api_flights.changed(bad, good, base, names=names, injections=injections, progress=report)
    run.result(found, details=details)
    run.notes(base.notes)
    run.save("changed", found, figure=figure, page=page)


def trend(
    logs: o.Logs,
    model: o.ModelOption,
    fit: Annotated[
        str | None,
        typer.Option(
            metavar="A,B",
            help="Effects to fit to each flight. Default: those of MODEL, else thrust_scale,com_offset.",
        ),
    ] = None,
    figure: o.Figure = None,
    table: Annotated[Path | None, typer.Option(metavar="FILE", help="Every value as a table (.parquet).")] = None,
    page: o.Page = None,
    vehicle: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of rows of `batch compare`: whose flights.")
    ] = None,
    details: o.Details = False,
    *,
    reading: o.Reading,
    run: Run,
) -> None:
    """Fit each flight by itself and say which parameters stepped or drifted over the flights.

    Give the logs in the order in which they were flown, or the folder of `wrenchgap batch compare`. A step is told with
    its flight, its size with a 95 % interval, and its significance against the scatter between flights; with fewer than
    four flights nothing is said of steps.

    Example: `wrenchgap trend monday.mcap tuesday.mcap wednesday.mcap friday.mcap -m my_quadrotor --page season.html`
    """
    from wrenchgap.replay import api_flights
    from wrenchgap.replay.present.documents import check_tables

    run.claim({"--figure": figure, "--table": table, "--page": page}, *logs, model)
    if table is not None and table.suffix.lower() != ".parquet":
        raise usage_error(f"--table {table}: the table is a Parquet file; expected a name that ends in .parquet")
    check_tables(table)
    names = parse_effects(fit)
    base = run.model(model)
    with run.progress("following") as report:
        if len(logs) == 1 and (logs[0] / "run.json").is_file():
            found = _of_rows(run, logs[0], base, names, vehicle)
        elif vehicle is not None:
            raise usage_error(f"--vehicle {vehicle}: does nothing with logs; leave it out")
        else:
            flights, _ = run.open(reading.options, logs, base)
            found = api_flights.trend(flights, base, names, progress=report)
    run.result(found, details=details)
    run.save("trend", found, figure=figure, parquet=table, page=page)


def _of_rows(run: Run, folder: Path, base: Model, names: tuple[str, ...], vehicle: str | None) -> Trend:
    """The trend of rows of `batch compare`; raises UsageError for options of how logs are read."""
    from wrenchgap.flight.extras import needed_for

    if idle := run.common_options("own").strip():
        raise usage_error(f"{idle}: does nothing with rows of `batch compare`, whose logs are read; leave it out")
    with needed_for("rows of a batch", extra="batch"):
        from wrenchgap.replay.batch.fleet import trend_of_rows
        from wrenchgap.replay.batch.store import Store

    found = trend_of_rows(Store(str(folder)), base, names, vehicle)
    run.note_input(folder / "run.json", "batch")
    return found
