"""`wrenchgap replay` and `counterfactual`: the compensation on a recorded flight."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.completion import complete_effects, complete_models
from wrenchgap.replay.cli.requests import FOUND_BAD, Omit, Reading, Run
from wrenchgap.replay.cli.values import parse_cutoff, usage_error

if TYPE_CHECKING:
    from wrenchgap.flight.budget import Budget

Process = Annotated[Path | None, typer.Option("--gp", metavar="GP", help="A GP of `wrenchgap learn`.")]
Exported = Annotated[
    Path | None,
    typer.Option(
        "--export",
        metavar="FOLDER",
        help="Instead of -m and --gp: prove that the code of this folder of `wrenchgap export` made LOG's records "
        "(it is compiled and run).",
    ),
]
Source = Annotated[
    str | None,
    typer.Option(
        "--source",
        metavar="desired|commanded",
        help="Logged wrench to compensate; default: desired where it is logged.",
        autocompletion=lambda incomplete: [n for n in ("desired", "commanded") if n.startswith(incomplete)],
    ),
]
CutoffOfGp = Annotated[
    float | None, typer.Option("--cutoff", metavar="HZ", help="Low-pass in Hz; default: the one of the GP.")
]
Parquet = Annotated[Path | None, typer.Option("--parquet", metavar="FILE", help="Every step as Parquet.")]


def replay(
    log: o.Log,
    model: o.OptionalModel = None,
    gp: Process = None,
    export: Exported = None,
    output: o.LogOut = None,
    source: Source = None,
    no_filter: o.NoFilter = False,
    sigma_threshold: o.Threshold = None,
    kappa: o.Slope = None,
    decay_time: o.DecayTime = 0.15,
    lead: o.Lead = None,
    despite_verdict: o.DespiteVerdict = False,
    csv: o.Csv = None,
    parquet: Parquet = None,
    figure: o.Figure = None,
    *,
    reading: Annotated[Reading, Omit("cutoff")],
    cutoff: CutoffOfGp = None,
    run: Run,
) -> None:
    """Re-run optimiser and uncertainty filter on the logged wrenches, at the log's own stamps.

    LOG2 holds the recorded flight and, under /replay/, what the compensation would have commanded and why. Two runs
    give identical files; solve times are printed and put into the JSON only.

    With --export, LOG holds records of an exported compensation in flight: its C is stepped again from the state and
    input of each, and must give what was flown. The exit code is 3 where it does not.

    Example: `wrenchgap replay test.mcap -m tilt_hexarotor --gp torque.gp -o replayed.mcap --figure replay.png`
    """
    # Long because every option is one line of the signature.
    if export is not None:
        _prove(log, export, csv, reading.options.budget, run)
        return
    from wrenchgap.compensate import Settings
    from wrenchgap.learn.process.predictors import cutoff_of
    from wrenchgap.replay import api
    from wrenchgap.replay.compensation.source import source_by_name
    from wrenchgap.replay.present.documents import check_tables, write_csv, write_parquet
    from wrenchgap.replay.present.replay import write_log

    if model is None or gp is None:
        missing = "--model MODEL" if model is None else "--gp GP"
        raise usage_error(f"replay {log}: {missing} is missing; give --model and --gp, or --export for a flown export")
    check_tables(csv, parquet)
    run.claim({"--output": output, "--csv": csv, "--parquet": parquet, "--figure": figure}, log, model, gp)
    settings = Settings(
        filter_uncertain=not no_filter,
        sigma_threshold=sigma_threshold,
        kappa=kappa,
        decay_time=decay_time,
        despite_verdict=despite_verdict,
    )
    base, process, wanted = run.model(model), run.gp(gp), source_by_name(source)
    assert process is not None
    process.check_vehicle(base.vehicle.name)
    options = reading.options.changed(cutoff_hz=cutoff_of(process) if cutoff is None else parse_cutoff(cutoff))
    with run.progress("replaying", "reading the log") as report:
        ((opened,), _) = run.open(options, [log], base, rate_hz=math.inf, incomplete=True)
        result = api.replay_compensation(opened, base, process, settings, source=wanted, lead=lead, progress=report)
    if output is not None:
        write_log(result, output, force=run.force)
    if csv is not None:
        write_csv(result.to_frame(), csv, digits=None)
    if parquet is not None:
        write_parquet(result.to_frame(), parquet)
    run.draw(result, figure)
    run.result(result)
    run.write("replay", result.to_json(), log=output, table=csv, parquet=parquet, figure=figure)


def _prove(log: Path, folder: Path, csv: Path | None, budget: Budget | str | None, run: Run) -> None:
    """Whether the records in a log are what an exported folder makes of them."""
    from wrenchgap.replay.api_export import prove_flown
    from wrenchgap.replay.present.documents import check_tables, write_csv

    used = ("log", "export", "csv", "budget", "own", "json", "force", "quiet")
    if idle := sorted(filter(None, run.given(lambda name: name not in used))):
        raise usage_error(f"replay --export: {', '.join(idle)} says nothing about a flown export; leave it out")
    check_tables(csv)
    run.claim({"--csv": csv}, log, *(folder.iterdir() if folder.is_dir() else ()))
    with run.progress("proving", "reading the log"):
        found = prove_flown(log, folder, budget=budget)
    if log.is_file():
        run.note_input(log, "log")
    run.result(found)
    if csv is not None:
        write_csv(found.to_frame(), csv)
    run.write("replay-export", {**found.to_json(), "folder": str(folder)}, table=csv)
    if not found.proved:
        raise typer.Exit(FOUND_BAD)


Compensate = Annotated[
    Path | None, typer.Option("--gp", metavar="GP", help="Compensate with this GP of `wrenchgap learn`.")
]
Baselines = Annotated[
    bool,
    typer.Option("--baselines", help="Re-simulate with the baselines of a GP too: observer, effects, straight line."),
]
Without = Annotated[
    list[str] | None,
    typer.Option(
        "--without",
        metavar="EFFECT",
        help="Re-simulate the vehicle without this effect of MODEL.",
        autocompletion=complete_effects,
    ),
]
With = Annotated[
    list[str] | None,
    typer.Option(
        "--with",
        metavar="EFFECT=P:V,...",
        help="Re-simulate it with this effect as well.",
        autocompletion=complete_effects,
    ),
]
Gains = Annotated[
    list[str] | None,
    typer.Option("--gains", metavar="NAME=VALUE", help="Other gains, e.g. integral=0 or omega_attitude=5,5,4."),
]
Believe = Annotated[
    str | None,
    typer.Option(
        "--believe",
        metavar="MODEL2",
        help="Controller and allocation know mass, inertia and centre of mass of MODEL2.",
        autocompletion=complete_models,
    ),
]
Start = Annotated[float, typer.Option("--start", metavar="S", help="Start of the re-simulation, in seconds.")]
Duration = Annotated[
    float | None, typer.Option("--duration", metavar="S", help="Its length, in seconds; default: to the end.")
]


def counterfactual(
    log: o.Log,
    model: o.ModelOption,
    output: o.LogOut = None,
    gp: Compensate = None,
    lead: o.Lead = None,
    baselines: Baselines = False,
    despite_verdict: o.DespiteVerdict = False,
    without: Without = None,
    with_: With = None,
    gains: Gains = None,
    believe: Believe = None,
    start: Start = 0.0,
    duration: Duration = None,
    *,
    reading: Annotated[Reading, Omit("cutoff")],
    run: Run,
) -> None:
    """Re-simulate a recorded flight with something changed.

    What MODEL does not explain of the recorded motion is inferred as a disturbance over time and acts in the
    re-simulation too, from the recorded initial state, along the recorded reference. The null run, with nothing
    changed, must reproduce the recorded flight; its error, printed first, bounds the accuracy of what follows.

    Example: `wrenchgap counterfactual test.mcap -m tilt_hexarotor --gp torque.gp -o compensated.mcap`
    """
    # Long because typer reads the options from the signature, one a line.
    from wrenchgap.replay import api
    from wrenchgap.replay.present.counterfactual import write_log

    run.claim({"--output": output}, log, gp)
    base, other = run.model(model), None if believe is None else run.model(believe, "believed")
    process = run.gp(gp)
    with run.progress("counterfactual", "reading the log") as report:
        ((flight,), _) = run.open(reading.options, [log], base)
        result = api.counterfactual(
            flight,
            base,
            gp=process,
            gp_name="" if gp is None else gp.name,
            lead=lead,
            without=without or (),
            having=with_ or (),
            gains=gains or (),
            believe=other,
            baselines=baselines,
            despite_verdict=despite_verdict,
            start=start,
            duration=duration,
            progress=report,
        )
    if output is not None:
        write_log(result, output, run.read, force=run.force)
    run.result(result)
    run.write("counterfactual", result.to_json(), log=output)
