"""`wrenchgap replay`: the compensation, re-run on a recorded flight."""

from __future__ import annotations

import inspect
import math
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Omit, Reading, Run

if TYPE_CHECKING:
    from wrenchgap.flight.budget import Budget

FOUND_OTHER = 3
"""Exit code where the command did its work and the records are not what the export makes."""
Model = Annotated[
    str | None,
    typer.Option(
        "--model",
        "-m",
        metavar="MODEL",
        help="Model file (.toml), or the name of a shipped model.",
        autocompletion=o.complete_models,
        show_default=False,
    ),
]
Process = Annotated[
    Path | None, typer.Option("--gp", metavar="GP", help="A GP of `wrenchgap learn`.", show_default=False)
]
Exported = Annotated[
    Path | None,
    typer.Option(
        "--export",
        metavar="FOLDER",
        help="Instead of -m and --gp: prove that the code of this folder of `wrenchgap export` made LOG's records "
        "(it is compiled and run).",
        show_default=False,
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
NoFilter = Annotated[bool, typer.Option("--no-filter", help="Apply the optimum in full, whatever its uncertainty.")]
Threshold = Annotated[float | None, typer.Option(help="Standard deviation at which half of the optimum is withheld.")]
Slope = Annotated[float | None, typer.Option(help="Gate slope: how sharply the correction fades around the threshold.")]
DecayTime = Annotated[float, typer.Option(help="Time constant with which a withheld correction fades, in seconds.")]
DespiteVerdict = Annotated[
    bool, typer.Option("--despite-verdict", help="Compensate in full, also where the verdict of learn is against it.")
]
CutoffOfGp = Annotated[
    float | None, typer.Option("--cutoff", metavar="HZ", help="Low-pass in Hz; default: the one of the GP.")
]
Parquet = Annotated[Path | None, typer.Option("--parquet", metavar="FILE", help="Every step as Parquet.")]


def replay(
    log: o.Log,
    model: Model = None,
    gp: Process = None,
    export: Exported = None,
    output: o.LogOut = None,
    source: Source = None,
    no_filter: NoFilter = False,
    sigma_threshold: Threshold = None,
    kappa: Slope = None,
    decay_time: DecayTime = 0.15,
    lead: o.Lead = None,
    despite_verdict: DespiteVerdict = False,
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
        _prove(log, export, csv, reading.options.budget, run, idle=_said(locals()))
        return
    from wrenchgap.compensate import Settings
    from wrenchgap.flight.errors import UsageError
    from wrenchgap.learn.process.predictors import cutoff_of
    from wrenchgap.replay import api
    from wrenchgap.replay.compensation.source import checked
    from wrenchgap.replay.present.replay import write_files

    if model is None or gp is None:
        missing = "--model MODEL" if model is None else "--gp GP"
        raise UsageError(f"replay {log}: {missing} is missing; give --model and --gp, or --export for a flown export")
    run.claim({"--output": output, "--csv": csv, "--parquet": parquet, "--figure": figure}, log, model, gp)
    settings = Settings(
        filter_uncertain=not no_filter,
        sigma_threshold=sigma_threshold,
        kappa=kappa,
        decay_time=decay_time,
        despite_verdict=despite_verdict,
    )
    base, process, wanted = run.model(model), run.gp(gp), checked(source)
    assert process is not None
    process.check_vehicle(base.vehicle.name)
    options = reading.options.changed(cutoff_hz=cutoff_of(process) if cutoff is None else o.parse_cutoff(cutoff))
    with run.progress("replaying", "reading the log") as report:
        ((opened,), _) = run.open(options, [log], base, rate_hz=math.inf, incomplete=True)
        result = api.replay_compensation(opened, base, process, settings, source=wanted, lead=lead, progress=report)
    write_files(result, output, csv, parquet, figure, force=run.force)
    run.write("replay", result.to_json())
    run.result(result)
    run.wrote(log=output, table=csv, parquet=parquet, figure=figure)


def _said(values: dict[str, Any]) -> list[str]:
    """Options of `replay` that were given and that --export has no use for."""
    usual = {one.name: one.default for one in fields(Reading)}
    usual |= {name: one.default for name, one in inspect.signature(replay).parameters.items()}
    given = {**values, **asdict(values["reading"]), "cutoff": values["cutoff"]}
    idle = set(usual) - {"log", "export", "csv", "budget", "reading", "run"}
    return sorted(f"--{name.replace('_', '-')}" for name in idle if given[name] not in (usual[name], None, []))


def _prove(log: Path, folder: Path, csv: Path | None, budget: Budget | str | None, run: Run, idle: list[str]) -> None:
    """Whether the records in a log are what an exported folder makes of them."""
    from wrenchgap.flight.errors import UsageError
    from wrenchgap.replay.onboard import prove_flown
    from wrenchgap.replay.present.documents import write_csv

    if idle:
        raise UsageError(f"replay --export: {', '.join(idle)} says nothing about a flown export; leave it out")
    run.claim({"--csv": csv}, log, *(folder.iterdir() if folder.is_dir() else ()))
    with run.progress("proving", "reading the log"):
        found = prove_flown(log, folder, budget=budget)
    if log.is_file():
        run.note_input(log, "log")
    run.write("replay-export", {**found.to_json(), "folder": str(folder)})
    run.result(found)
    if csv is not None:
        write_csv(found.to_frame(), csv)
    run.wrote(table=csv)
    if not found.proved:
        raise typer.Exit(FOUND_OTHER)
