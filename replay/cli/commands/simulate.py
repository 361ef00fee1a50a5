"""`wrenchgap simulate`: fly the plant and write a log."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Run

MANY = ("--hide",)


def _list(asked: bool) -> None:
    if not asked:
        return
    from wrenchgap.plant.trajectory import TRAJECTORIES
    from wrenchgap.replay.present.tables import plain

    rows = [(name, f"{seconds:g} s", words) for name, (_, seconds, words) in TRAJECTORIES.items()]
    Run().show(plain("trajectories", ("name", "length", "description"), rows, left=3))
    raise typer.Exit()


TrajectoryName = Annotated[
    str,
    typer.Option(
        "--trajectory",
        "-t",
        metavar="NAME",
        help="See --list; or a file of `wrenchgap design`.",
        autocompletion=o.complete_trajectories,
    ),
]
Output = Annotated[Path, typer.Option("--output", "-o", metavar="LOG", help="Log to write (.mcap).")]
Duration = Annotated[float | None, typer.Option("--duration", metavar="S", help="Length in seconds.")]
Excitation = Annotated[
    float, typer.Option("--excitation", metavar="SIZE", help="Multisine on all axes: 1 is usual for training logs.")
]
Seed = Annotated[int, typer.Option("--seed", metavar="N", help="Seed of sensor noise and excitation.")]
Integral = Annotated[bool | None, typer.Option("--integral/--no-integral", help="Integral action of the controller.")]
Hide = Annotated[
    list[str] | None,
    typer.Option("--hide", metavar="EFFECT=P:V,...", help="Effect of the plant that MODEL does not have."),
]
Truth = Annotated[
    Path | None, typer.Option("--truth", metavar="FILE", help="Write the true model, with the hidden effects.")
]
List = Annotated[bool, typer.Option("--list", callback=_list, is_eager=True, help="List the trajectories and exit.")]


def simulate(
    model: o.ModelOption,
    trajectory: TrajectoryName,
    output: Output,
    duration: Duration = None,
    excitation: Excitation = 0.0,
    seed: Seed = 0,
    integral: Integral = None,
    hide: Hide = None,
    truth: Truth = None,
    list_: List = False,
    *,
    run: Run,
) -> None:
    """Fly a simulated vehicle along a trajectory and write its log.

    The controller believes MODEL. With --hide the plant flies MODEL and the hidden effects, which the log does not
    reveal: parameters by name, or all of them in order.

    Example: `wrenchgap simulate -m voliro_x -t multi_axis --excitation 1 --hide com_offset=x:-0.004,y:0.007 -o a.mcap`
    """
    from wrenchgap.flight.write import write
    from wrenchgap.plant import model_file
    from wrenchgap.plant.flight_plan import Plan, fly, prepare, provenance, summary
    from wrenchgap.replay.present import simulation

    run.claim({"--output": output, "--truth": truth}, trajectory)
    if output.suffix != ".mcap":
        raise o.usage_error(f"--output {output}: logs are written as MCAP; expected a name that ends in .mcap")
    plan = Plan(run.model(model), trajectory, duration, excitation, seed, integral, tuple(hide or ()))
    true, _, _ = prepare(plan)
    with run.progress("flying", "flying") as report:
        flown = fly(plan, name=output.stem, progress=lambda fraction: report(fraction, "flying"))
    write(flown, output, metadata=provenance(plan), force=run.force)
    if truth is not None:
        model_file.save(true, truth, force=run.force)
    went = summary(flown)
    run.line(simulation.line(output, plan, went))
    run.notes(flown.notes, "warning")
    run.write("simulate", simulation.to_json(output, plan, flown, went))
    run.wrote(log=output, true_model=truth)
