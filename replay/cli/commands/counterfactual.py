"""`wrenchgap counterfactual`: a recorded flight, re-simulated with something changed."""

from __future__ import annotations

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
    complete_effects,
    complete_models,
    many,
    parse_between,
    parse_shifts,
    parse_topics,
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("counterfactual", cls=many("--without", "--with", "--gains"))(counterfactual)


def counterfactual(
    log: Annotated[
        Path, typer.Argument(metavar="LOG", help="Log: .mcap, .bag, or a ROS 2 bag folder.", show_default=False)
    ],
    model: ModelOption,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="LOG2", help="Log to write (.mcap).", show_default=False)
    ] = None,
    gp: Annotated[
        Path | None, typer.Option("--gp", metavar="GP", help="Compensate with this GP of `wrenchgap learn`.")
    ] = None,
    lead: Lead = None,
    baselines: Annotated[
        bool, typer.Option("--baselines", help="Fly what a GP must be better than: observer, effects, straight line.")
    ] = False,
    without: Annotated[
        list[str] | None,
        typer.Option(
            "--without",
            metavar="EFFECT",
            help="What if the vehicle did not have this effect of MODEL?",
            autocompletion=complete_effects,
        ),
    ] = None,
    with_: Annotated[
        list[str] | None,
        typer.Option(
            "--with", metavar="EFFECT=P:V,...", help="What if it had this one?", autocompletion=complete_effects
        ),
    ] = None,
    gains: Annotated[
        list[str] | None,
        typer.Option("--gains", metavar="NAME=VALUE", help="Other gains, e.g. integral=0 or omega_attitude=5,5,4."),
    ] = None,
    believe: Annotated[
        str | None,
        typer.Option(
            "--believe",
            metavar="MODEL2",
            help="Controller and allocation know mass, inertia and centre of mass of MODEL2.",
            autocompletion=complete_models,
        ),
    ] = None,
    start: Annotated[float, typer.Option("--start", metavar="S", help="Where to begin, in seconds.")] = 0.0,
    duration: Annotated[
        float | None, typer.Option("--duration", metavar="S", help="How long, in seconds; default: to the end.")
    ] = None,
    topic: Topics = None,
    shift: Shift = None,
    between: Between = None,
    own: OwnEffects = None,
    json: JsonFile = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Re-simulate a recorded flight with something changed.

    What MODEL does not explain of the recorded motion is inferred as a disturbance over time and acts in the
    re-simulation too, from the recorded initial state, along the recorded reference. The null run, with nothing
    changed, must end up where the recorded flight did; its error is printed first.

    Example: `wrenchgap counterfactual test.mcap -m tilt_hexarotor --gp torque.gp -o compensated.mcap`
    """
    from wrenchgap.learn.data.opening import open_flight
    from wrenchgap.learn.process import store
    from wrenchgap.plant import model_file
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.counterfactual import counterfactual as engine
    from wrenchgap.replay.present import counterfactual as reports
    from wrenchgap.replay.present.documents import claim, document, file_input, log_input, model_input, write_json

    claim({"--output": output, "--json": json}, force=force, inputs=[log, *([] if gp is None else [gp])])
    base = model_file.load(model)
    other = None if believe is None else model_file.load(believe)
    process = None if gp is None else store.load(gp)
    with progress("counterfactual", quiet) as report:
        report(0.0, "reading the log")
        topics, shifts = parse_topics(topic), parse_shifts(shift)
        found = open_flight(log, base, topics=topics, shifts=shifts, between=parse_between(between))
        recording = engine.read_recording(found, base.vehicle, start=start, duration=duration)
        change = reports.change(
            base,
            period=recording.dt,
            gp=None if gp is None or process is None else (gp.name, process),
            lead=lead,
            baselines=baselines,
            without=without or (),
            with_=with_ or (),
            gains=gains or (),
            believe=other,
        )
        result = engine.counterfactual(recording, base, change, progress=report)
    inputs = [log_input(found.flight), model_input(base)]
    inputs += [] if gp is None else [file_input(gp, "gp")]
    inputs += [] if other is None else [model_input(other, "believed")]
    if output is not None:
        reports.write_log(result, output, inputs, force=force)
    if json is not None:
        write_json(json, document("counterfactual", reports.to_json(result, process), inputs), force=force)
    printer = Printer(quiet)
    printer.show(*reports.show(result))
    printer.notes(reports.notes(result, process))
    printer.wrote(log=output, result=json)
