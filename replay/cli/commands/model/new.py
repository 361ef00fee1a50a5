"""`wrenchgap model new`: a model file from a log, an autopilot's parameters, a robot description or answers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Run


def new(
    ctx: typer.Context,
    output: o.ModelOut,
    source: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="SOURCE",
            help="PX4 log (.ulg), ArduPilot log or parameters (.bin, .param), URDF, SDF or MuJoCo XML.",
            show_default=False,
        ),
    ] = None,
    mass: Annotated[
        float | None, typer.Option("--mass", metavar="KG", help="What the vehicle weighs, with its battery.")
    ] = None,
    mass_tolerance: Annotated[
        float | None, typer.Option("--mass-tolerance", metavar="KG", help="How well that is known, e.g. 0.005.")
    ] = None,
    name: Annotated[str | None, typer.Option("--name", metavar="NAME", help="Name of the vehicle.")] = None,
    frame: Annotated[
        str | None,
        typer.Option("--frame", metavar="FRAME", help="Frame with --arm, e.g. quad_x."),
    ] = None,
    arm: Annotated[float | None, typer.Option("--arm", help="From the middle to a motor, in metres.")] = None,
    radius: Annotated[float | None, typer.Option("--rotor-radius", help="Of the rotors, in metres.")] = None,
    thrust_max: Annotated[
        float | None, typer.Option("--thrust-max", metavar="N", help="Thrust of one rotor at full throttle.")
    ] = None,
    interactive: Annotated[bool, typer.Option("--interactive", "-i", help="Ask for what SOURCE does not say.")] = False,
    figure: o.Figure = None,
    budget: o.BudgetOption = None,
    *,
    run: Run,
) -> None:
    """Write a model file from what is known: every number in it carries a comment that says where it is from.

    What nobody said is marked ASSUMED, in the file and on the screen: replace it where you know better. Inertia is
    estimated from mass and geometry, with a tolerance, where nothing is known of it. The level of the thrust curve is
    fitted where SOURCE is a log in which the vehicle flies.

    Example: `wrenchgap model new --from flight.ulg --mass 1.52 --mass-tolerance 0.005 -o vehicle.toml`
    """
    from wrenchgap.replay import modelling
    from wrenchgap.replay.cli.interview import questions

    run.claim({"--output": output, "--figure": figure}, source)
    if source is None and not interactive:
        raise o.usage_error("model new: nothing to start from; say --from SOURCE, or --interactive to be asked")
    given = modelling.Given(name, mass, mass_tolerance, frame, arm, radius, thrust_max)
    ask = questions if interactive else None
    allowed = o.parse_budget(budget)
    sheet = modelling.draft_model(source, given=given, command=o.command_line(ctx), ask=ask, budget=allowed)
    saved = modelling.save_draft(sheet, output, force=run.force)
    if source is not None:
        run.note_input(source, "source")
    run.result(saved)
    run.draw(saved, figure)
    run.write("model", {**saved.to_json(), "model": str(output)})
    run.wrote(model=output, figure=figure)
