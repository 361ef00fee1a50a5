"""`wrenchgap replay`: the compensation, re-run on a recorded flight."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from wrenchgap.replay.cli.options import (
    Between,
    Force,
    JsonFile,
    Lead,
    ModelOption,
    OwnEffects,
    Quiet,
    Shift,
    Topics,
    parse_between,
    parse_cutoff,
    parse_shifts,
    parse_topics,
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("replay")(replay)


def replay(
    log: Annotated[
        Path, typer.Argument(metavar="LOG", help="Log: .mcap, .bag, or a ROS 2 bag folder.", show_default=False)
    ],
    model: ModelOption,
    gp: Annotated[Path, typer.Option("--gp", metavar="GP", help="A GP of `wrenchgap learn`.", show_default=False)],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="LOG2", help="Log to write (.mcap).", show_default=False)
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(
            "--source",
            metavar="desired|commanded",
            help="Which logged wrench goes in; default: desired where it is logged.",
            autocompletion=lambda incomplete: [n for n in ("desired", "commanded") if n.startswith(incomplete)],
        ),
    ] = None,
    no_filter: Annotated[
        bool, typer.Option("--no-filter", help="Take the optimum as it is, whatever its uncertainty.")
    ] = False,
    sigma_threshold: Annotated[
        float | None, typer.Option(help="Standard deviation at which half of the optimum is taken.")
    ] = None,
    kappa: Annotated[
        float | None, typer.Option(help="Gate slope: how sharply the correction fades around the threshold.")
    ] = None,
    decay_time: Annotated[
        float, typer.Option(help="Time constant with which a distrusted correction dies out, in seconds.")
    ] = 0.15,
    lead: Lead = None,
    csv: Annotated[Path | None, typer.Option("--csv", metavar="FILE", help="Every step as a table.")] = None,
    parquet: Annotated[Path | None, typer.Option("--parquet", metavar="FILE", help="The same as Parquet.")] = None,
    figure: Annotated[
        Path | None, typer.Option("--figure", metavar="PNG", help="Draw wrenches, correction, sigma and beta.")
    ] = None,
    topic: Topics = None,
    shift: Shift = None,
    cutoff: Annotated[
        float | None, typer.Option("--cutoff", metavar="HZ", help="Low-pass in Hz; default: the one of the GP.")
    ] = None,
    between: Between = None,
    own: OwnEffects = None,
    json: JsonFile = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Re-run optimiser and uncertainty filter on the logged wrenches, at the log's own stamps.

    LOG2 holds the flight as flown and, under /replay/, what the compensation would have commanded and why. Two runs
    give identical files; solve times are printed and put into the JSON only.

    Example: `wrenchgap replay test.mcap -m tilt_hexarotor --gp torque.gp -o replayed.mcap --figure replay.png`
    """
    from wrenchgap.compensate import Settings
    from wrenchgap.learn.data.measurement import CUTOFF_HZ
    from wrenchgap.learn.data.opening import open_flight
    from wrenchgap.learn.process import store
    from wrenchgap.plant import model_file
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.compensation import replay as engine
    from wrenchgap.replay.compensation.source import checked
    from wrenchgap.replay.present import replay as replay_report
    from wrenchgap.replay.present.documents import claim, document, file_input, log_input, model_input, write_json

    outputs = {"--output": output, "--csv": csv, "--parquet": parquet, "--figure": figure, "--json": json}
    claim(outputs, force=force, inputs=[log, model, gp])
    settings = Settings(
        filter_uncertain=not no_filter, sigma_threshold=sigma_threshold, kappa=kappa, decay_time=decay_time
    )
    printer, asked = Printer(quiet), checked(source)
    base, process = model_file.load(model), store.load(gp)
    process.check_vehicle(base.vehicle.name)
    with progress("replaying", quiet) as report:
        report(0.0, "reading the log")
        opened = open_flight(
            log,
            base,
            topics=parse_topics(topic),
            cutoff_hz=parse_cutoff(cutoff or process.provenance.cutoff_hz or CUTOFF_HZ),
            rate_hz=math.inf,
            between=parse_between(between),
            shifts=parse_shifts(shift),
            incomplete=True,
        )
        result = engine.replay(opened, base, process, settings, source=asked, lead=lead, progress=report)
        summary = replay_report.summarise(result)
    if output is not None:
        replay_report.write_log(result, output, force=force)
    if csv is not None:
        replay_report.write_csv(result, csv)
    if parquet is not None:
        replay_report.write_parquet(result, parquet)
    if figure is not None:
        replay_report.write_figure(result, figure)
    if json is not None:
        read = [log_input(result.flight), model_input(base), file_input(gp, "gp")]
        write_json(json, document("replay", replay_report.to_json(result, summary), read), force=force)
    printer.show(*replay_report.tables(result, summary))
    printer.notes(replay_report.notes(result))
    printer.notes(summary.warnings(), "warning")
    printer.wrote(log=output, table=csv, parquet=parquet, figure=figure, result=json)
