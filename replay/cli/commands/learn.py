"""`wrenchgap learn`: a Gaussian process on what the model leaves."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, show_result, write_result


class Subsample(StrEnum):
    """k-medoids libraries."""

    fasterpam = "fasterpam"
    pyclustering = "pyclustering"


class Mean(StrEnum):
    """Mean functions of the process."""

    physics = "physics"
    zero = "zero"
    linear = "linear"
    constant = "constant"


class Inference(StrEnum):
    """Which samples count."""

    exact = "exact"
    sparse = "sparse"


class Scale(StrEnum):
    """Inputs for the distance between samples."""

    standardised = "standardised"
    raw = "raw"


Points = Annotated[int, typer.Option("--points", metavar="N", min=2, help="Training points kept.")]
Outputs = Annotated[
    str, typer.Option("--outputs", metavar="WHAT", help="torque, wrench, or axes like torque_x,force_z.")
]
Library = Annotated[Subsample, typer.Option("--subsample", help="k-medoids library; pyclustering is the paper's.")]
Inputs = Annotated[
    str | None,
    typer.Option(
        "--inputs",
        metavar="WHAT",
        help="Inputs besides the command: past, velocity, rates, position, with commas; or auto.",
    ),
]
MeanFunction = Annotated[
    Mean | None,
    typer.Option(
        "--mean",
        help="Mean function; zero is the paper's, physics the effects of MODEL.",
        show_default="physics if MODEL has effects, else zero",
    ),
]
Samples = Annotated[
    Inference, typer.Option("--inference", help="exact: on N samples, as in the paper; sparse: on all, through N.")
]
Scaling = Annotated[Scale, typer.Option("--scale", help="Inputs of k-medoids; raw is the paper's.")]
Restarts = Annotated[int, typer.Option("--restarts", metavar="N", min=0, help="Random starts of the likelihood.")]
Seed = Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Seed of k-medoids and restarts.")]
NoGuard = Annotated[
    bool,
    typer.Option("--no-guard", help="Search neither for better inputs nor for an effect that the GP absorbs."),
]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("learn", cls=o.many("--validate"))(learn)


def learn(
    logs: o.Logs,
    model: o.ModelOption,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="GP", help="File to write.", show_default=False)],
    validate: o.Validate = None,
    points: Points = 200,
    outputs: Outputs = "torque",
    subsample: Library = Subsample.fasterpam,
    inputs: Inputs = None,
    mean: MeanFunction = None,
    inference: Samples = Inference.exact,
    scale: Scaling = Scale.standardised,
    restarts: Restarts = 1,
    seed: Seed = 0,
    no_guard: NoGuard = False,
    topic: o.Topics = None,
    shift: o.Shift = None,
    cutoff: o.Cutoff = 8.0,
    between: o.Between = None,
    own: o.OwnEffects = None,
    json: o.JsonFile = None,
    force: o.Force = False,
    quiet: o.Quiet = False,
) -> None:
    """Learn the wrench residual of the model, as a function of the commanded wrench.

    With physics as its mean the process learns the residual of MODEL's effects; the compensation contains both. So name
    effects first, then learn the residual. If the process reproduces an effect of the catalogue, the result names it.

    Example: `wrenchgap learn train.mcap -m fitted.toml --validate test.mcap -o rest.gp`
    """
    # Long because typer reads the options from the signature, one a line.
    from wrenchgap.learn.identify.learning import default_mean, physics_of
    from wrenchgap.learn.process.gp import FitSettings
    from wrenchgap.replay import api
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.present.documents import claim

    unseen = validate or []
    claim({"--output": output, "--json": json}, force=force, inputs=[*logs, *unseen, model])
    wanted, reading, base = o.parse_outputs(outputs), Reading.of(topic, shift, cutoff, between), api.load_model(model)
    names = () if inputs == "auto" else o.parse_names(inputs)
    kind = default_mean(base) if mean is None else mean.value
    settings = FitSettings(points, subsample.value, scale.value, kind, names, inference.value, True, restarts, seed)
    physics_of(base, settings)  # or it raises, before any log is read
    with progress("learning", quiet) as report:
        report(0.0, "reading logs")
        every = reading.open([*logs, *unseen], base)
        flights, tests = every[: len(logs)], every[len(logs) :]
        learnt = api.learn_gp(
            flights,
            base,
            outputs=wanted,
            settings=settings,
            validate=tests,
            best_inputs=inputs == "auto",
            guard=not no_guard,
            progress=report,
        )
    api.save_gp(learnt, output, force=force)
    printer = Printer(quiet)
    show_result(printer, learnt)
    printer.notes(base.notes)
    body = {**learnt.to_json(), "gp": str(output)}
    write_result(json, "learn", body, force=force, flights=flights, validation=tests, models=[(base, "model")])
    printer.wrote(GP=output, result=json)
