"""`wrenchgap design`: the flight that tells effects apart."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wrenchgap.replay.cli.options import (
    Between,
    Effects,
    Force,
    JsonFile,
    ModelOption,
    OwnEffects,
    Quiet,
    Topics,
    complete_effects,
    many,
    parse_between,
    parse_topics,
)

if TYPE_CHECKING:
    from wrenchgap.learn.design.designer import Design
    from wrenchgap.plant.model import Model
    from wrenchgap.replay.cli.console import Printer


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("design", cls=many("--from", "--also"))(design)


def design(
    effects: Effects,
    model: ModelOption,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FLIGHT", help="Trajectory to write (.toml).", show_default=False)
    ],
    logs: Annotated[
        list[Path] | None,
        typer.Option("--from", metavar="LOG...", help="Logs to take the effects' sizes from, and to compare with."),
    ] = None,
    duration: Annotated[float, typer.Option("--duration", metavar="S", help="Length of the flight.")] = 30.0,
    room: Annotated[
        str | None,
        typer.Option("--room", metavar="X,Y,Z", help="Free space in metres, floor at z = 0 (default 4,4,3)."),
    ] = None,
    max_tilt: Annotated[
        float | None, typer.Option("--max-tilt", metavar="DEG", help="Default 60; 30 for fixed rotors.")
    ] = None,
    max_speed: Annotated[float, typer.Option("--max-speed", metavar="M/S", help="Largest speed.")] = 2.0,
    also: Annotated[
        list[str] | None,
        typer.Option(
            "--also",
            metavar="EFFECT...",
            help="What may be there besides, fitted along (default: inertia and a command delay; none: nothing).",
            autocompletion=complete_effects,
        ),
    ] = None,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Write the best flight found even if it separates nothing.")
    ] = False,
    csv: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="The sampled reference, for other flight stacks.")
    ] = None,
    figure: Annotated[Path | None, typer.Option("--figure", metavar="PNG", help="Plot it.")] = None,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Of the sensor noise.")] = 0,
    topic: Topics = None,
    between: Between = None,
    own: OwnEffects = None,
    json: JsonFile = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Find the reference trajectory that tells effects apart, and check it on the simulated vehicle.

    Sizes of the effects are those of MODEL, else fitted to the logs, else typical. Where no trajectory can tell them
    apart, that is said with what would, and no file is written. Fly the result with `wrenchgap simulate -t FLIGHT`.

    Example: `wrenchgap design com_offset constant_wrench -m tilt_hexarotor -o flight.toml`
    """
    from dataclasses import replace

    import numpy as np

    from wrenchgap.flight.errors import UsageError
    from wrenchgap.learn.data.opening import open_flights
    from wrenchgap.learn.design import designer as search
    from wrenchgap.learn.design.manoeuvres import usual
    from wrenchgap.plant import model_file, trajectory_file
    from wrenchgap.plant.effects import find
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.present import design as designing
    from wrenchgap.replay.present.documents import atomic, claim, document, log_input, model_input, write_json

    outputs = {"--output": output, "--csv": csv, "--figure": figure, "--json": json}
    claim(outputs, force=force, inputs=[*(logs or ()), model])
    if output.suffix != ".toml":
        raise UsageError(f"--output {output}: trajectories are written as TOML; expected a name that ends in .toml")
    if seed < 0:
        raise UsageError(f"--seed {seed}: expected a whole number that is not negative")
    base = model_file.load(model)
    along = None if also is None else tuple(n for n in also if n != "none")
    for name in (*effects, *(along or ())):
        find(name)
    limits = usual(base.vehicle)
    tilt = limits.tilt if max_tilt is None else float(np.radians(max_tilt))
    limits = replace(limits, room=designing.parse_room(room, limits), tilt=tilt, speed=max_speed)
    with progress("designing", quiet) as report:
        report(0.0, "reading logs")
        flights = open_flights(logs or [], base, topics=parse_topics(topic), between=parse_between(between))
        found = search.design(
            effects,
            base,
            records=[r for f in flights for r in f.records],
            limits=limits,
            duration=duration,
            also=along,
            seed=seed,
            progress=report,
        )
    written = found.separable or anyway
    file = designing.finished(found, base, flights, output.stem)
    if written:
        with atomic(output) as partial:
            partial.write_text(trajectory_file.dumps(file), encoding="utf-8")
        if csv is not None:
            with atomic(csv) as partial:
                trajectory_file.write_csv(file, partial, base.controller.rate_hz)
        if figure is not None:
            designing.figure(found, figure, force=force)
    printer = Printer(quiet)
    _print(printer, found, base)
    notes = list(dict.fromkeys(note for f in flights for note in f.notes))
    printer.notes(notes)
    if json is not None:
        body = {**designing.to_json(found, base), "notes": notes, "trajectory": str(output) if written else None}
        write_json(
            json, document("design", body, [*(log_input(f.flight) for f in flights), model_input(base)]), force=force
        )
    printer.wrote(trajectory=output if written else None, csv=csv if written else None, result=json)
    if figure is not None and written:
        printer.wrote(figure=figure)
    if written:
        printer.line(f"next: wrenchgap simulate -m {model} -t {output} -o flight.mcap, or fly it")


def _print(printer: Printer, found: Design, model: Model) -> None:
    from wrenchgap.replay.present import design as designing
    from wrenchgap.replay.present import tables

    printer.line(designing.sentence(found), style="bold")
    if not found.separable:
        for words in found.advice:
            printer.line(f"  instead: {words}")
    printer.line()
    heads = ("if it is", "can this imitate it?", "cosine", found.baseline, "cosine", "this flight", "simulated")
    title = "separation of the two explanations"
    printer.show(tables.plain(title, (*heads, "shows on"), designing.directions(found), left=2))
    printer.show(tables.parameters(designing.sizes(found, model), "sizes that were assumed"))
    printer.line(f"moves: {', '.join(map(str, found.segments))}")
    printer.line(f"on the simulated vehicle: {designing.flown(found)}")
