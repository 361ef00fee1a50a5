"""`wrenchgap counterfactual`: a recorded flight, re-simulated with something changed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.commands.replay import DespiteVerdict
from wrenchgap.replay.cli.requests import Omit, Reading, Run

MANY = ("--without", "--with", "--gains")
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
        autocompletion=o.complete_effects,
    ),
]
With = Annotated[
    list[str] | None,
    typer.Option(
        "--with",
        metavar="EFFECT=P:V,...",
        help="Re-simulate it with this effect as well.",
        autocompletion=o.complete_effects,
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
        autocompletion=o.complete_models,
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
    despite_verdict: DespiteVerdict = False,
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
    run.write("counterfactual", result.to_json())
    run.result(result)
    run.wrote(log=output)
