"""`wrenchgap simulate`: fly the plant and write a log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wrenchgap.replay.cli.options import (
    Force,
    JsonFile,
    OwnEffects,
    Quiet,
    complete_models,
    complete_trajectories,
    many,
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("simulate", cls=many("--hide"))(simulate)


def _list(asked: bool) -> None:
    if not asked:
        return
    from wrenchgap.plant.trajectory import TRAJECTORIES
    from wrenchgap.replay.cli.console import Printer
    from wrenchgap.replay.present import tables

    rows = [(name, f"{seconds:g} s", words) for name, (_, seconds, words) in TRAJECTORIES.items()]
    Printer().show(tables.plain("trajectories", ("name", "length", "what it is"), rows, left=3))
    raise typer.Exit()


def simulate(
    model: Annotated[
        str,
        typer.Option("--model", "-m", metavar="MODEL", help="Believed model.", autocompletion=complete_models),
    ],
    trajectory: Annotated[
        str,
        typer.Option(
            "--trajectory",
            "-t",
            metavar="NAME",
            help="See --list; or a file of `wrenchgap design`.",
            autocompletion=complete_trajectories,
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="LOG", help="Log to write (.mcap).")],
    duration: Annotated[float | None, typer.Option("--duration", metavar="S", help="Length in seconds.")] = None,
    excitation: Annotated[
        float, typer.Option("--excitation", metavar="SIZE", help="Multisine on all axes: 1 is usual for training logs.")
    ] = 0.0,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Of sensor noise and excitation.")] = 0,
    integral: Annotated[bool | None, typer.Option("--integral/--no-integral", help="Controller's integral.")] = None,
    hide: Annotated[
        list[str] | None,
        typer.Option("--hide", metavar="EFFECT=P:V,...", help="Fly with an effect that MODEL does not have."),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="FILE", help="Write the model that really flew.")
    ] = None,
    list_: Annotated[
        bool, typer.Option("--list", callback=_list, is_eager=True, help="List the trajectories and leave.")
    ] = False,
    own: OwnEffects = None,
    json: JsonFile = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Fly a simulated vehicle along a trajectory and write its log.

    The controller believes MODEL. With --hide the plant flies MODEL and the hidden effects, which the log does not
    reveal: parameters by name, or all of them in order.

    Example: `wrenchgap simulate -m voliro_x -t multi_axis --excitation 1 --hide com_offset=x:-0.004,y:0.007 -o a.mcap`
    """
    from wrenchgap import flight
    from wrenchgap.flight.errors import UsageError
    from wrenchgap.plant import model_file
    from wrenchgap.plant.flight_plan import Plan, fly, prepare, provenance, summary
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.present import simulation
    from wrenchgap.replay.present.documents import claim, document, model_input, write_json

    claim({"--output": output, "--truth": truth, "--json": json}, force=force, inputs=[trajectory])
    if output.suffix != ".mcap":
        raise UsageError(f"--output {output}: logs are written as MCAP; expected a name that ends in .mcap")
    believed = model_file.load(model)
    plan = Plan(believed, trajectory, duration, excitation, seed, integral, tuple(hide or ()))
    flown_model = prepare(plan).truth
    with progress("flying", quiet) as report:
        flown = fly(plan, name=output.stem, progress=lambda fraction: report(fraction, "flying"))
    flight.write(flown, output, metadata=provenance(plan), force=force)
    if truth is not None:
        model_file.save(flown_model, truth, force=force)
    went = summary(flown)
    printer = Printer(quiet)
    printer.line(simulation.line(output, plan, went))
    printer.notes(flown.notes, "warning")
    if json is not None:
        body = simulation.to_json(output, plan, flown, went)
        write_json(json, document("simulate", body, [model_input(believed)]), force=force)
    printer.wrote(log=output, true_model=truth, result=json)
